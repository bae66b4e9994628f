"""Scores of a stair detector's headings against ground truth: results table and truth table in, scores and a summary out."""

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.arrays import NORMAL_95
from treadline.core.errors import SettingsError

LEAST_SHARE = 0.15
"""Least share of the image covered by the stair for a rejection to count as a miss, as in docs/evidence/perception.md."""
MOST_DEG = 360.0
"""Largest magnitude of a heading in a results table [deg]: one turn; a larger value is in another unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingResult:
    """Answer of a detector to one frame."""

    heading_deg: float | None
    """Heading; None if the frame was rejected."""
    sigma_deg: float | None = None
    """Declared standard deviation of the heading; None if not declared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueFrame:
    """Ground truth of one frame."""

    heading_deg: float | None
    """Heading; None without a stair."""
    share: float = 0.0
    """Share of the image covered by the stair."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fraction:
    """Number of frames with a property, of all that could have it."""

    hits: int
    count: int

    @property
    def share(self) -> float | None:
        """Fraction; None of no frames."""
        return self.hits / self.count if self.count else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the fraction (Wilson)."""
        return wilson(self.hits, self.count)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingScores:
    """Scores of a detector. Errors are of all accepted frames with a stair; None if there are none."""

    accepted: Fraction
    """Accepted frames, of those whose stair covers at least ``LEAST_SHARE`` of the image."""
    rmse_deg: float | None
    p95_deg: float | None
    """95 % quantile of the error magnitude."""
    worst_deg: float | None
    inside_95: Fraction
    """Errors inside the declared 95 % interval, of the frames with a declared standard deviation."""
    false_accepts: Fraction
    """Accepted frames, of those without a stair."""


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a fraction (Wilson, JASA 22, 1927)."""
    if count == 0:
        return (0.0, 1.0)
    share, square = hits / count, NORMAL_95**2
    middle = (share + 0.5 * square / count) / (1.0 + square / count)
    half = NORMAL_95 / (1.0 + square / count) * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count**2)
    # Rounding leaves 1e-17 at the ends, where the interval is exact.
    return (0.0 if hits == 0 else middle - half, 1.0 if hits == count else middle + half)


def percent(hits: int, count: int, digits: int = 0) -> str:
    """Return a fraction with its 95 % interval, in percent."""
    low, high = wilson(hits, count)
    return f"{100 * hits / count:.{digits}f} % [{100 * low:.{digits}f}, {100 * high:.{digits}f}]" if count else ""


def score(results: dict[str, HeadingResult], truth: dict[str, TrueFrame]) -> HeadingScores:
    """Return the scores of a detector; ``results`` has an entry for each frame of ``truth``."""
    in_view = [name for name, true in truth.items() if true.heading_deg is not None and true.share >= LEAST_SHARE]
    stairless = [name for name, true in truth.items() if true.heading_deg is None]
    errors, inside = [], []
    for name, true in truth.items():
        answer = results[name]
        if true.heading_deg is None or answer.heading_deg is None:
            continue
        error = abs((answer.heading_deg - true.heading_deg + 180.0) % 360.0 - 180.0)
        errors.append(error)
        if answer.sigma_deg is not None:
            inside.append(error <= NORMAL_95 * answer.sigma_deg)
    return HeadingScores(
        accepted=_accepted(results, in_view),
        rmse_deg=float(np.sqrt(np.mean(np.square(errors)))) if errors else None,
        p95_deg=float(np.quantile(errors, 0.95)) if errors else None,
        worst_deg=max(errors, default=None),
        inside_95=Fraction(hits=sum(inside), count=len(inside)),
        false_accepts=_accepted(results, stairless),
    )


def _accepted(results: dict[str, HeadingResult], names: Sequence[str]) -> Fraction:
    return Fraction(hits=sum(results[name].heading_deg is not None for name in names), count=len(names))


def read_truth(path: Path) -> dict[str, TrueFrame]:
    """Return the ground truth of a truth.csv with a row per frame.

    Raises:
        SettingsError: If the table is invalid.
    """
    table = {}
    for where, row in _rows(path, ("name", "heading_deg", "share")):
        table[row["name"]] = TrueFrame(
            heading_deg=_number(where, "heading_deg", row["heading_deg"]), share=_number(where, "share", row["share"]) or 0.0
        )
    return table


def read_results(path: Path, truth: dict[str, TrueFrame]) -> dict[str, HeadingResult]:
    """Return the results of a detector, one for each frame of the ground truth.

    Raises:
        SettingsError: If the table is invalid, or its frames are not those of the ground truth.
    """
    table = {}
    for where, row in _rows(path, ("name", "heading_deg")):
        name = row["name"]
        if name not in truth:
            raise SettingsError(f"{where}: '{name}' is no frame of the truth; its names look like '{next(iter(truth), '')}'")
        heading = _number(where, "heading_deg", row["heading_deg"])
        sigma = _number(where, "sigma_deg", row.get("sigma_deg") or "")
        if heading is not None and not abs(heading) <= MOST_DEG:
            raise SettingsError(f"{where}: heading_deg is {heading:g}; it must be from -360 to 360 degrees")
        if sigma is not None and not sigma > 0.0:
            raise SettingsError(f"{where}: sigma_deg is {sigma:g}; it must be above 0, or empty if not known")
        table[name] = HeadingResult(heading_deg=heading, sigma_deg=sigma)
    lacking = [name for name in truth if name not in table]
    if lacking:
        raise SettingsError(
            f"{path}: {len(lacking)} of {len(truth)} frames are missing, first '{lacking[0]}'; "
            "a rejected frame has a row with an empty heading_deg"
        )
    return table


def _rows(path: Path, needed: tuple[str, ...]) -> list[tuple[str, dict[str, str]]]:
    """Return place and cells of each row of a CSV file with the needed columns."""
    try:
        reader = csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines())
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from None
    for column in needed:
        if column not in (reader.fieldnames or ()):
            raise SettingsError(f"{path}: no column '{column}'; needed: {', '.join(needed)}")
    return [(f"{path}:{reader.line_num}", row) for row in reader]


def _number(where: str, column: str, cell: str) -> float | None:
    """Return the number of a cell; None if it is empty."""
    try:
        return float(cell) if cell.strip() else None
    except ValueError:
        raise SettingsError(f"{where}: {column} is '{cell}'; write a number, or leave it empty for a rejected frame") from None


def scored_table(results: Path, truth: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the scores of a results table, of all frames and of each condition, and a summary."""
    true = read_truth(truth)
    answers = read_results(results, true)
    scores = score(answers, true)
    conditions = _by_condition(answers, true)
    values = _values(scores) | {"frames": len(true), "conditions": {name: _values(part) for name, part in conditions.items()}}
    return values, [*_summary(scores), *(f"  {name}: {_short(part)}" for name, part in conditions.items())]


def _by_condition(answers: dict[str, HeadingResult], true: dict[str, TrueFrame]) -> dict[str, HeadingScores]:
    """Return the scores of each folder in the frames' names; nothing for names without a folder."""
    folders = dict.fromkeys(name.rpartition("/")[0] for name in true if "/" in name)
    return {
        folder: score(answers, {name: frame for name, frame in true.items() if name.rpartition("/")[0] == folder})
        for folder in folders
    }


def _values(scores: HeadingScores) -> dict[str, Any]:
    fractions = {"accepted": scores.accepted, "inside_95": scores.inside_95, "false_accepts": scores.false_accepts}
    return {key: value for key, value in asdict(scores).items() if key not in fractions} | {
        key: {"hits": part.hits, "count": part.count, "share": part.share, "interval_95": list(part.interval)}
        for key, part in fractions.items()
    }


def _summary(scores: HeadingScores) -> list[str]:
    return [
        f"accepted: {_percent(scores.accepted)} of the frames with a stair on at least {100 * LEAST_SHARE:.0f} % of the image",
        f"heading error: {_errors(scores)}",
        f"inside the declared 95 % interval: {_percent(scores.inside_95)}",
        f"false accepts: {_percent(scores.false_accepts)} of the frames without a stair",
    ]


def _short(scores: HeadingScores) -> str:
    if scores.false_accepts.count:
        return f"false accepts {scores.false_accepts.hits}/{scores.false_accepts.count}"
    return f"accepted {scores.accepted.hits}/{scores.accepted.count}, {_errors(scores)}"


def _errors(scores: HeadingScores) -> str:
    if scores.rmse_deg is None:
        return "no accepted frame"
    return f"RMSE {scores.rmse_deg:.3f}°, p95 {scores.p95_deg:.3f}°, worst {scores.worst_deg:.3f}°"


def _percent(part: Fraction) -> str:
    return f"{part.hits}/{part.count} = {percent(part.hits, part.count, 1)}" if part.count else "no frames"
