"""From what the controller asks to what the belts can do.

Turning on a stair slides the chair downhill unless both belts keep pulling up. ``climb-safe`` keeps the slower belt at
half the climb speed at least and the faster at its limit at most: steering decides, the common speed follows.
``back_safe`` backs down: each belt lets down at half the pace at least and at one and a half times the pace at most.
``paper`` only clips, as the paper's "do not exceed the maximum speed" asks.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltLimits:
    """Speeds the belts may have."""

    climb_speed_m_s: float
    max_speed_m_s: float
    max_mean_m_s: float = 0.55

    @property
    def slowest_m_s(self) -> float:
        """Speed below which the slower belt would let the chair slide."""
        return 0.5 * self.climb_speed_m_s


def clipped(asked: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return each belt within ± the limit."""
    return np.clip(asked, -limits.max_speed_m_s, limits.max_speed_m_s)


def climb_safe(asked: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return belt speeds (left, right) [m/s] with the steering asked for, as far as the limits let it be.

    The common part asked for is replaced: climb speed, or as much more as keeps the slower belt from sliding.
    """
    most = min(
        0.5 * (limits.max_speed_m_s - limits.slowest_m_s),
        limits.max_mean_m_s - limits.slowest_m_s,
    )
    half = float(np.clip(0.5 * (asked[1] - asked[0]), -most, most))
    common = max(limits.climb_speed_m_s, abs(half) + limits.slowest_m_s)
    return np.array([common - half, common + half])


def back_safe(asked: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return belt speeds (left, right) [m/s] for backing down at the climb speed, steering as far as both belts let down."""
    most = limits.climb_speed_m_s - limits.slowest_m_s
    half = float(np.clip(0.5 * (asked[1] - asked[0]), -most, most))
    return np.array([-limits.climb_speed_m_s - half, -limits.climb_speed_m_s + half])
