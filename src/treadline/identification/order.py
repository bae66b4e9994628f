"""How many states: from the singular values, by a rule that is written down.

The order is where the ratio of neighbouring singular values is largest, among values that stand above the noise floor
(the median of the lower half). A ratio below ``CLEAR_GAP`` is no gap: the answer is then said to be unclear.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CLEAR_GAP = 4.0
"""Ratio of neighbours that noise alone hardly shows: white noise stays below 2."""
NUMERICAL_ZERO = 1e-12
"""Relative size at which a singular value is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderChoice:
    """An order, and how clear it is."""

    order: int
    gap: float
    """σ_n / σ_{n+1}."""
    clear: bool


def choose_order(singular_values: Float[np.ndarray, " k"], largest: int | None = None) -> OrderChoice:
    """Return the order that the largest gap shows."""
    s = np.maximum(singular_values, NUMERICAL_ZERO * singular_values[0])
    candidates = min(len(s) - 1, largest or len(s) - 1)
    if candidates < 1:
        return OrderChoice(order=1, gap=float("inf"), clear=False)
    floor = float(np.median(s[len(s) // 2 :]))
    ratios = s[:candidates] / s[1 : candidates + 1]
    above = s[:candidates] > floor
    above[0] = True
    best = int(np.argmax(np.where(above, ratios, 0.0)))
    return OrderChoice(order=best + 1, gap=float(ratios[best]), clear=bool(ratios[best] >= CLEAR_GAP))
