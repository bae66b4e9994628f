"""Words of the pages: names of runs, labels and units of channels and of scores in ``result.json``, explanations of terms."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from treadline.core.files import DATA
from treadline.core.printing import UNITS, unit_ending

LONGEST = 26
"""Longest name that fits a panel [characters]."""
DIGITS = {"m": 3, "m/s": 3, "m/s³": 1, "mm/min": 3, "N": 0, "W": 0, "ms": 1, "×": 1}
"""Decimals by unit; two for every other. A value below 0.1 has one more."""
_TABLE = tomllib.loads((DATA / "score_labels.toml").read_text(encoding="utf-8"))
_GLOSSARY = tomllib.loads((DATA / "terms.toml").read_text(encoding="utf-8"))
GROUPS: dict[str, dict[str, str]] = _TABLE["groups"]
"""Labels of the scores by key, in groups; the heading's come first."""
SEAT: dict[str, str] = _TABLE["seat"]
"""Labels of the scores of a seat run (Fig. 11)."""
LABELS = {key: label for labels in GROUPS.values() for key, label in labels.items()}
TERMS: dict[str, dict[str, Any]] = _GLOSSARY["terms"]
"""Explanation (``text``) of each term, and the ``labels`` of the player page that carry it as a tooltip."""
PHASES: dict[str, str] = _GLOSSARY["phases"]
"""Explanation of each phase of a traversal."""
FAULTS: dict[str, str] = _GLOSSARY["faults"]
"""Name of each kind of fault."""
OF_NO_SEAT = ("Safety", "Computing")
"""Groups that also apply to a run of the seat alone; the chair does not move in such a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnLabel:
    """Label of one column of a record."""

    name: str
    """Name in the record."""
    quantity: str
    """Quantity in a figure: the name without its unit suffix, shortened, printable characters only."""
    unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreGroup:
    """Group of related scores."""

    title: str
    rows: list[tuple[str, str, str]]
    """Key in ``result.json``, label and formatted value of each score."""
    aside: bool = False
    """Whether the group is secondary for this kind of run."""


def channel(name: str) -> ColumnLabel:
    """Return the label of a channel."""
    ending = unit_ending(name)
    quantity = name if ending is None else name[: -len(ending) - 1]
    shown = "".join(letter for letter in quantity if letter.isprintable())
    shown = shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + "…"
    return ColumnLabel(name=name, quantity=shown, unit=None if ending is None else UNITS[ending])


def suffix(unit: str) -> str:
    """Return a unit with the space that separates it from a number."""
    return unit if unit in ("", "°") else f" {unit}"


def score_name(key: str) -> str:
    """Return the label of a score outside its group; the key if there is no label."""
    label = LABELS.get(key, key)
    return f"heading, {label}" if key in next(iter(GROUPS.values())) else label


def score_unit(key: str) -> str:
    """Return the unit of a score; empty for a number without unit."""
    return _TABLE["units"].get(key) or channel(key).unit or ""


def score_groups(figures: Mapping[str, int | float | None], seat: Mapping[str, int | float | None] | None) -> list[ScoreGroup]:
    """Return all scores of a run in groups; those of the seat first in a run of the seat alone.

    Args:
        figures: Scores of the run by key; None is a score that the run does not have.
        seat: Scores of the seat; None for a run that is not of the seat alone.
    """
    unknown = {key: key for key in figures if key not in LABELS}
    groups = [
        ScoreGroup(title=title, rows=_rows(figures, labels), aside=seat is not None and title not in OF_NO_SEAT)
        for title, labels in {**GROUPS, "Other figures of result.json": unknown}.items()
    ]
    if seat is not None:
        own = [(f"seat.{key}", label, value) for key, label, value in _rows(seat, SEAT)]
        groups = [ScoreGroup(title="Seat", rows=own), *sorted(groups, key=lambda group: group.aside)]
    return [group for group in groups if group.rows]


def _rows(figures: Mapping[str, int | float | None], labels: Mapping[str, str]) -> list[tuple[str, str, str]]:
    return [(key, label, _written(key, figures[key])) for key, label in labels.items() if key in figures]


def _written(key: str, value: int | float | None) -> str:  # noqa: PYI041 - to the tests' type checker an int is no float
    unit = score_unit(key) if key in LABELS or key in SEAT else ""
    if value is None:
        return str(_TABLE["absent"].get(key, "–"))
    if isinstance(value, int):
        return f"{value}{suffix(unit)}"
    digits = DIGITS.get(unit, 2) + (abs(value) < 0.1)
    return f"{round(value, digits) + 0.0:.{digits}f}{suffix(unit)}"


RUN_WORDS = (
    (r"^literal-(\d+)", r"printed controller at \1°"),
    (r"^turn-rollback-(\d+)", r"turn at \1° with roll-back allowed"),
    (r"^(turn|seat)-(\d+)", r"\1 at \2°"),
    (r"^excite-(\d+)", r"random belt speeds at \1°"),
    (r"^straight-(\d+)-(open|closed)", r"straight up \1°, \2 loop"),
    (r"^(up|down)-(\d+)-", r"traversal \1 \2°-"),
    (r"-mu([\d.]+)-([\d.]+)", r", friction \1/\2"),
    (r"-plus(\d+)", r", from +\1°"),
    (r"-minus(\d+)", r", from −\1°"),
    (r"-seed(\d+)", r", seed \1"),
    (r"-smooth", ", smooth belts"),
    (r"-lugs-(\d+)-(\d+)-([\d.]+)ms", r", lugs \1/\2 mm, rubber \3 ms"),
)
"""Patterns in the names of a reproduction's run folders, with the words for them."""


def run_words(name: str) -> str:
    """Return the name of a run folder of a reproduction in words."""
    for pattern, words in RUN_WORDS:
        name = re.sub(pattern, words, name)
    return name
