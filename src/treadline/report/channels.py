"""What a channel's name says: the quantity, and the unit its ending stands for."""

from collections.abc import Sequence
from dataclasses import dataclass

from treadline.units import UNITS, unit_ending

UNKNOWN = "own unit"
"""On an axis, where a name says none."""
LONGEST = 26
"""Characters of a name that a panel has room for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnLabel:
    """One column of a record."""

    name: str
    """As recorded."""
    quantity: str
    """For a figure: without the ending that is its unit, short, printable, and no formula."""
    unit: str | None


def channel(name: str) -> ColumnLabel:
    """Return what a name says."""
    ending = unit_ending(name)
    if ending is None:
        return ColumnLabel(name=name, quantity=_drawable(name), unit=None)
    return ColumnLabel(name=name, quantity=_drawable(name[: -len(ending) - 1]), unit=UNITS[ending])


def suffix(unit: str) -> str:
    """Return a unit as it follows a number."""
    return unit if unit in ("", "°") else f" {unit}"


def _drawable(text: str) -> str:
    shown = "".join(letter for letter in text if letter.isprintable())
    shown = shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"
    return shown.replace("$", r"\$")  # matplotlib would read a formula between two


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
