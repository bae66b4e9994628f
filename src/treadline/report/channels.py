"""Labels of channels: quantity and unit, from the suffix of the name."""

from collections.abc import Sequence
from dataclasses import dataclass

from treadline.core.units import UNITS, unit_ending

UNKNOWN = "own unit"
"""Unit label of a channel whose name has no unit suffix."""
LONGEST = 26
"""Longest name that fits a panel [characters]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnLabel:
    """Label of one column of a record."""

    name: str
    """Name in the record."""
    quantity: str
    """Quantity in a figure: the name without its unit suffix, shortened, printable characters only."""
    unit: str | None


def channel(name: str) -> ColumnLabel:
    """Return the label of a channel."""
    ending = unit_ending(name)
    if ending is None:
        return ColumnLabel(name=name, quantity=_drawable(name), unit=None)
    return ColumnLabel(name=name, quantity=_drawable(name[: -len(ending) - 1]), unit=UNITS[ending])


def suffix(unit: str) -> str:
    """Return a unit with the space that separates it from a number."""
    return unit if unit in ("", "°") else f" {unit}"


def _drawable(text: str) -> str:
    shown = "".join(letter for letter in text if letter.isprintable())
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"


def ratio_unit(output: ColumnLabel, given: ColumnLabel) -> str:
    """Return the unit of an output per unit of an input."""
    if output.unit is None or given.unit is None:
        return "own units"
    return "–" if output.unit == given.unit else f"{output.unit} per {given.unit}"


def both_angles(channels: Sequence[ColumnLabel]) -> tuple[list[str], list[str]] | None:
    """Return the names in degrees and those in radians where a record has both, else None."""
    degrees = [item.name for item in channels if item.unit is not None and "°" in item.unit]
    radians = [item.name for item in channels if item.unit is not None and "rad" in item.unit]
    return (degrees, radians) if degrees and radians else None
