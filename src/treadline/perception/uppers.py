"""Heights of a flight's nosings by the upper ends of its risers, where neither treads nor lines tell them.

Near the eye's height treads vanish, and a nosing that overhangs hides the end of its riser. What is left are risers, evenly apart,
each cut off at the same place under its nosing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.perception.nosings import STEP_RISE_M, TREAD_ABOVE_M, Axes, Nosing

RISERS = 3
"""So many in a row: the foot of a wall behind a bench is no second riser."""
EVEN = 0.12
"""Share of a step by which places and upper ends may be off it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ladder:
    """Upper ends of risers, one a step."""

    first_m: float
    run_m: float
    foot_m: float
    rise_m: float

    def top_m(self, nosing: Nosing) -> float:
        """Return the height at which the riser under a nosing ends."""
        return self.foot_m + self.rise_m * round((nosing.ahead_m - self.first_m) / self.run_m)


def with_heights(row: list[Nosing], axes: Axes) -> list[Nosing]:
    """Return a row of a flight that rises with the heights that its risers tell, where fewer than two are known."""
    known = sum(nosing.up_m is not None for nosing in row)
    ladder = _ladder_of([nosing for nosing in row if nosing.riser is not None]) if known < 2 else None
    if ladder is None:
        return row
    # What a nosing hides of its riser is the same at each step; where no height is known at all, it is taken for nothing.
    hidden_m = sum(nosing.up_m - ladder.top_m(nosing) for nosing in row if nosing.up_m is not None)
    if not -EVEN * ladder.rise_m < hidden_m < TREAD_ABOVE_M[1]:
        return row
    return [_raised(nosing, ladder.top_m(nosing) + hidden_m, axes) for nosing in row]


def _ladder_of(risers: Sequence[Nosing]) -> _Ladder | None:
    """Return the steps whose risers these are, or None where they are not evenly apart."""
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
    return _Ladder(first_m=first_m, run_m=run_m, foot_m=foot_m, rise_m=rise_m)


def _evenly(number: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return step and start of values that are evenly apart; a step of NaN where they are not."""
    step, start = np.polyfit(number, values, 1).tolist()
    off = float(np.abs(values - start - step * number).max())
    return (step, start) if off <= EVEN * abs(step) else (np.nan, np.nan)


def _raised(nosing: Nosing, up_m: float, axes: Axes) -> Nosing:
    if nosing.up_m is not None:
        return nosing
    return replace(nosing, up_m=up_m, point=nosing.point + (up_m - float(nosing.point @ axes.up)) * axes.up)
