"""Heights of a flight's nosings from the upper ends of its risers, without treads or lines.

Near the camera height treads vanish, and an overhanging nosing hides the end of its riser. The visible risers are evenly spaced,
each cut off at the same distance under its nosing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.perception.nosings import STEP_RISE_M, TREAD_ABOVE_M, Axes, NosingObservation

RISERS = 3
"""Least number of risers: the foot of a wall behind a bench must not count as a second riser."""
EVEN = 0.12
"""Relative tolerance of places and upper ends, as a fraction of a step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiserRow:
    """Upper ends of risers, one per step."""

    first_m: float
    run_m: float
    foot_m: float
    rise_m: float

    def top_m(self, nosing: NosingObservation) -> float:
        """Return the height of the riser's end under a nosing."""
        return self.foot_m + self.rise_m * round((nosing.ahead_m - self.first_m) / self.run_m)


def with_heights(row: list[NosingObservation], axes: Axes) -> list[NosingObservation]:
    """Return an ascending sequence of nosings with heights from its risers, if fewer than two are known."""
    known = sum(nosing.up_m is not None for nosing in row)
    ladder = _riser_row_of([nosing for nosing in row if nosing.riser is not None]) if known < 2 else None
    if ladder is None:
        return row
    # The hidden part of a riser under its nosing is equal at all steps; without any known height it is assumed to be zero.
    hidden_m = sum(nosing.up_m - ladder.top_m(nosing) for nosing in row if nosing.up_m is not None)
    if not -EVEN * ladder.rise_m < hidden_m < TREAD_ABOVE_M[1]:
        return row
    return [_raised(nosing, ladder.top_m(nosing) + hidden_m, axes) for nosing in row]


def _riser_row_of(risers: Sequence[NosingObservation]) -> RiserRow | None:
    """Return the steps of these risers, or None without even spacing."""
    if len(risers) < RISERS:
        return None
    places = np.array([nosing.ahead_m for nosing in risers])
    number = np.round((places - places[0]) / np.median(np.diff(places)))
    tops = np.array([np.nan if nosing.top_m is None else nosing.top_m for nosing in risers])
    seen = np.isfinite(tops)
    if np.unique(number).size < number.size or np.count_nonzero(seen) < 2:
        return None
    run_m, first_m = _evenly(number, places)
    rise_m, foot_m = _evenly(number[seen], tops[seen])
    if not (STEP_RISE_M[0] <= rise_m <= STEP_RISE_M[1] and rise_m <= run_m):  # NaN is not
        return None
    return RiserRow(first_m=first_m, run_m=run_m, foot_m=foot_m, rise_m=rise_m)


def _evenly(number: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return step and start of evenly spaced values; a step of NaN otherwise."""
    step, start = np.polyfit(number, values, 1).tolist()
    off = float(np.abs(values - start - step * number).max())
    return (step, start) if off <= EVEN * abs(step) else (np.nan, np.nan)


def _raised(nosing: NosingObservation, up_m: float, axes: Axes) -> NosingObservation:
    if nosing.up_m is not None:
        return nosing
    return replace(nosing, up_m=up_m, point=nosing.point + (up_m - float(nosing.point @ axes.up)) * axes.up)
