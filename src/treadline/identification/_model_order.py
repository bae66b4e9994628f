"""Model order from the gap in the singular values.

The order is at the largest ratio of neighbouring singular values, among values above the noise floor: the median of the
lower half, and 1.5 times the noise level estimated from half of the data. The choice is unclear for a ratio below
``CLEAR_GAP``, or if half of the data and all data disagree on the largest singular value.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CLEAR_GAP = 4.0
"""Smallest ratio of neighbouring singular values that counts as a gap; white noise stays below 2."""
ABOVE_NOISE = 3.0
"""Ratio of the largest singular value to the noise level above which the data show a system; white noise reaches 2."""
FURTHER_ABOVE_NOISE = 1.5
"""Ratio to the noise level for further states; on stairs the second reached 8.6 in a minute of data, the third at most 1.2."""
NUMERICAL_ZERO = 1e-12
"""Relative size below which a singular value is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderChoice:
    """Model order and whether the gap at that order is clear."""

    order: int
    gap: float | None
    """Gap σ_n / σ_{n+1}; None for a given order until requested (``gap_of``)."""
    clear: bool


def gap_at(singular_values: Float[np.ndarray, " k"], order: int) -> float:
    """Return the gap σ_n / σ_{n+1} at order n."""
    s = singular_values
    return float(s[order - 1] / s[order]) if order < s.size and s[order] > 0.0 else float("inf")


def stands_out(singular_values: Float[np.ndarray, " k"], noise: float) -> bool:
    """Whether the largest singular value exceeds the noise level significantly."""
    return bool(singular_values[0] > ABOVE_NOISE * noise)


def choose_order(singular_values: Float[np.ndarray, " k"], *, noise: float = 0.0) -> OrderChoice:
    """Return the order at the largest gap.

    Args:
        singular_values: Singular values of the Hankel matrix, in descending order.
        noise: Largest singular value of noise alone.
    """
    s = np.maximum(singular_values, NUMERICAL_ZERO * singular_values[0])
    candidates = len(s) - 1
    if candidates < 1:
        return OrderChoice(order=1, gap=float("inf"), clear=stands_out(s, noise))
    lower = s[len(s) // 2 :]  # already sorted, so the median is in the middle
    floor = 0.5 * float(lower[(len(lower) - 1) // 2] + lower[len(lower) // 2])
    ratios = s[:candidates] / s[1 : candidates + 1]
    above = s[:candidates] > max(floor, FURTHER_ABOVE_NOISE * noise)
    above[0] = True
    best = int(np.argmax(np.where(above, ratios, 0.0)))
    clear = bool(ratios[best] >= CLEAR_GAP and stands_out(s, noise))
    return OrderChoice(order=best + 1, gap=float(ratios[best]), clear=clear)
