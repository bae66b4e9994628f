"""What a body follows: means over 50 ms, of pitch rate and passenger (ISO 2631-1 weighs vertical motion below some 10 Hz)."""

import numpy as np
from jaxtyping import Float

from treadline.signals import TICK_S

COMFORT_TICKS = 5
"""50 ms at 100 Hz."""


def lasting(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " t"]:
    """Return the running mean over 50 ms."""
    if len(values) < COMFORT_TICKS:
        return values
    return np.convolve(values, np.full(COMFORT_TICKS, 1.0 / COMFORT_TICKS), "valid")


def lasting_change(
    values: Float[np.ndarray, "... T"], dt_s: float | Float[np.ndarray, " t"] = TICK_S
) -> Float[np.ndarray, "... t"]:
    """Return how fast values change, per second, over 50 ms: of velocities the acceleration that lasts.

    Args:
        dt_s: Between two values; where it is not always the same, its mean over each window.
    """
    return np.asarray((values[..., COMFORT_TICKS:] - values[..., :-COMFORT_TICKS]) / (COMFORT_TICKS * dt_s))
