"""Allocate a demanded belt difference to the two belts, within their limits.

Coulomb friction is rate independent: near straight the chair goes along with the slower (inner) belt, whatever the other
does. ``climb-safe`` therefore keeps the inner belt at a minimum share of the climb speed and the outer one at its limit at
most: steering decides, the common speed follows.
``back_safe`` backs down: each belt lets down at half the pace at least and at one and a half times the pace at most.
``paper`` only clips, as the paper's "do not exceed the maximum speed" asks.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG

SLOWEST_CLIMBING = 0.25
"""Share of the climb speed that the inner belt keeps where the plan sets none."""
NEAR_STRAIGHT_RAD = 10.0 * DEG
"""Heading error within which the inner belt sticks on a 28° stair with friction 0.62/0.5 and carries the chair (quasi-static
Coulomb friction, ``mechanics.quasi_static``)."""
INNER_SHARE_NEAR_STRAIGHT, INNER_SHARE_TURNING = 0.5, -0.25
"""Share of the climb speed that the inner belt keeps near straight, and further askew, where both belts slide and a small one turns
the chair faster (decision 0022)."""
SLOWEST_BACKING = 0.5
"""The share backing down, where turning runs away."""


def inner_speed_ratio(heading_error_rad: float) -> float:
    """Return the share of the climb speed that the inner belt keeps, for a heading error [rad]."""
    return INNER_SHARE_NEAR_STRAIGHT if abs(heading_error_rad) <= NEAR_STRAIGHT_RAD else INNER_SHARE_TURNING


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltLimits:
    """Speeds the belts may have."""

    climb_speed_m_s: float
    max_speed_m_s: float
    max_mean_m_s: float = 0.55
    min_inner_speed_ratio: float = SLOWEST_CLIMBING
    """Of the climb speed, kept by the slower belt."""

    @property
    def slowest_m_s(self) -> float:
        """Speed below which the slower belt would let a chair slide that turns as it climbs."""
        return self.min_inner_speed_ratio * self.climb_speed_m_s


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
