"""How many states: from the singular values, by a rule that is written down.

The order is where the ratio of neighbouring singular values is largest, among values that stand above the noise: above
the median of the lower half, and half again above the noise that half of the data tell. A ratio below ``CLEAR_GAP`` is
no gap, nor is one under a largest value on which half of the data and the whole do not agree: the answer is then unclear, and said
to be so.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CLEAR_GAP = 4.0
"""Ratio of neighbours that noise alone hardly shows: white noise stays below 2."""
ABOVE_NOISE = 3.0
"""Largest singular value over the noise's, at which the data show a system: white noise reaches 2."""
FURTHER_ABOVE_NOISE = 1.5
"""The same for the states after the first: on stairs the second reached 8.6 in a minute of data, the third 1.2 at most."""
NUMERICAL_ZERO = 1e-12
"""Relative size at which a singular value is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderChoice:
    """An order, and how clear it is."""

    order: int
    gap: float | None
    """σ_n / σ_{n+1}; None where the order was given, until somebody asks (``gap_of``)."""
    clear: bool


def gap_at(singular_values: Float[np.ndarray, " k"], order: int) -> float:
    """Return σ_n / σ_{n+1} at an order n."""
    s = singular_values
    return float(s[order - 1] / s[order]) if order < s.size and s[order] > 0.0 else float("inf")


def stands_out(singular_values: Float[np.ndarray, " k"], noise: float) -> bool:
    """Whether the largest singular value is more than noise alone would show."""
    return bool(singular_values[0] > ABOVE_NOISE * noise)


def choose_order(singular_values: Float[np.ndarray, " k"], *, noise: float = 0.0) -> OrderChoice:
    """Return the order that the largest gap shows.

    Args:
        noise: Largest singular value that noise alone would show.
    """
    s = np.maximum(singular_values, NUMERICAL_ZERO * singular_values[0])
    candidates = len(s) - 1
    if candidates < 1:
        return OrderChoice(order=1, gap=float("inf"), clear=stands_out(s, noise))
    lower = s[len(s) // 2 :]  # falling, so that the median stands in the middle
    floor = 0.5 * float(lower[(len(lower) - 1) // 2] + lower[len(lower) // 2])
    ratios = s[:candidates] / s[1 : candidates + 1]
    above = s[:candidates] > max(floor, FURTHER_ABOVE_NOISE * noise)
    above[0] = True
    best = int(np.argmax(np.where(above, ratios, 0.0)))
    clear = bool(ratios[best] >= CLEAR_GAP and stands_out(s, noise))
    return OrderChoice(order=best + 1, gap=float(ratios[best]), clear=clear)
