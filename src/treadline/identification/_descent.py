"""Descent of a sum of squares by damped Gauss-Newton steps (Levenberg, 1944; Marquardt, 1963)."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

TRIES = 8
"""Largest number of damping increases per step before the descent ends."""
STEPS_MOST = 60
"""Largest number of steps."""

Point = TypeVar("Point")
Linearised = tuple[
    Float[np.ndarray, "d d"], Float[np.ndarray, " d"], Float[np.ndarray, " d"], Callable[[Float[np.ndarray, " d"]], Point]
]
"""J'J and J'e at a point, for which a full step would solve J'J step = J'e; the damping's diagonal; the point after a step.

Of parameters with units the diagonal is that of J'J (Marquardt); of parameters in a basis that means nothing it is the same for
all (Levenberg), so that the step does not depend on the basis.
"""


def descended(
    start: Point,
    cost: Callable[[Point], float],
    linearised: Callable[[Point], Linearised[Point]],
    *,
    enough: float,
) -> Point:
    """Return the local minimum of a sum of squares.

    Args:
        start: Initial point.
        cost: Sum of squares at a point; infinite where it is not allowed.
        linearised: Normal equations at a point.
        enough: Relative decrease of the cost at which the descent ends.
    """
    best, now = start, cost(start)
    damping, rise = 1e-3, 2.0
    for _ in range(STEPS_MOST if np.isfinite(now) else 0):
        H, g, size, moved = linearised(best)
        if not size.sum() > 0.0:  # nothing changes the residuals
            break
        before, scale = now, np.diag(np.where(size > 0.0, size, 1.0))
        for _ in range(TRIES):
            step = np.linalg.solve(H + damping * scale, g)
            trial = moved(step)
            there = cost(trial)
            if there < now:
                # Nielsen (1999): the better the quadratic model predicted the gain, the smaller the next damping.
                predicted_gain = float(2.0 * step @ g - step @ H @ step)
                damping *= max(0.1, 1.0 - (2.0 * (now - there) / predicted_gain - 1.0) ** 3)
                best, now, rise = trial, there, 2.0
                break
            damping, rise = damping * rise, rise * 2.0
        if before - now <= enough * before:
            break
    return best
