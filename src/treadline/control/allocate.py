"""From what the controller asks to what the belts can do.

Turning on a stair slides the chair downhill unless both belts keep pulling up. ``climb-safe`` keeps the slower belt at
a share of the climb speed at least and the faster at its limit at most: steering decides, the common speed follows.
``back_safe`` backs down: each belt lets down at half the pace at least and at one and a half times the pace at most.
``paper`` only clips, as the paper's "do not exceed the maximum speed" asks.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

SLOWEST_CLIMBING = 0.25
"""Share of the climb speed that the slower belt keeps where nobody sees how far the chair slides: on 30° with friction of 1.07
times its tangent a chair that turns from 30° askew then rolls back by 0.15 m at most, at a fifth by 0.25 m (decision 0022)."""
SLOWEST_WITH_GRIP, SLOWEST_SLIDING, SLID_M = -0.25, 0.6, 0.03
"""The share while nothing slides, and that once the chair has come back by so much; in between by the line through both."""
SLOWEST_BACKING = 0.5
"""The share backing down, where turning runs away."""


def slowest_share(slid_m: float) -> float:
    """Return the share of the climb speed that the slower belt keeps, for a chair that has slid back so far [m] as it turned.

    Grip is used as far as it goes, whatever slope, load and friction are: the slower belt may even run back until the chair slides.
    """
    return float(np.interp(slid_m, (0.0, SLID_M), (SLOWEST_WITH_GRIP, SLOWEST_SLIDING)))


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltLimits:
    """Speeds the belts may have."""

    climb_speed_m_s: float
    max_speed_m_s: float
    max_mean_m_s: float = 0.55
    slowest_share: float = SLOWEST_CLIMBING
    """Of the climb speed, kept by the slower belt."""

    @property
    def slowest_m_s(self) -> float:
        """Speed below which the slower belt would let a chair slide that turns as it climbs."""
        return self.slowest_share * self.climb_speed_m_s


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
    most = (1.0 - SLOWEST_BACKING) * limits.climb_speed_m_s
    half = float(np.clip(0.5 * (asked[1] - asked[0]), -most, most))
    return np.array([-limits.climb_speed_m_s - half, -limits.climb_speed_m_s + half])
