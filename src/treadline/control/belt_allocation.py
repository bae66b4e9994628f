"""Allocation of a demanded belt speed difference to the two belts, within their limits.

Coulomb friction is rate independent: near straight the chair moves with the slower (inner) belt, whatever the speed of the
other. ``climb_safe`` therefore keeps the inner belt at a minimum ratio of the climb speed and the outer belt within its
limit: steering has priority, and the common speed follows. ``back_safe`` is for backing down: each belt runs at 0.5 to
1.5 times the commanded speed. ``clipped`` (allocation ``paper``) only limits each belt, as the paper's "do not exceed the
maximum speed".
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG

INNER_RATIO_CLIMBING = 0.25
"""Inner belt speed as a ratio of the climb speed, unless the plan sets another."""
NEAR_STRAIGHT_RAD = 10.0 * DEG
"""Heading error within which the inner belt sticks on a 28° stair with friction 0.62/0.5 and carries the chair (quasi-static
Coulomb friction, ``vehicle.quasi_static``)."""
INNER_RATIO_NEAR_STRAIGHT, INNER_RATIO_TURNING = 0.5, -0.25
"""Inner belt speed ratio near straight and while backing down, where turning is unstable, and at larger heading errors, where both
belts slide and a slow inner belt turns the chair faster (decision 0022)."""
CRUISE_M_S = 0.2
"""Mean belt speed on a flight, where nothing else is asked [m/s]."""
GENTLE_M_S2 = 0.15
"""Rate of change of the belts' speed that neither tips a chair on nosings nor takes its friction [m/s²]: on a floor with high
friction a sudden turn breaks loose with 4 m/s² at the passenger."""
MAX_MEAN_M_S = 0.55
"""Largest common speed of the belts [m/s]."""


def inner_speed_ratio(heading_error_rad: float) -> float:
    """Return the inner belt speed as a ratio of the climb speed, for a heading error [rad]."""
    return INNER_RATIO_NEAR_STRAIGHT if abs(heading_error_rad) <= NEAR_STRAIGHT_RAD else INNER_RATIO_TURNING


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltLimits:
    """Belt speed limits."""

    climb_speed_m_s: float
    max_speed_m_s: float
    min_inner_speed_ratio: float = INNER_RATIO_CLIMBING
    """Smallest inner belt speed as a ratio of the climb speed; with a slower inner belt a turning chair would slide down."""
    yaw_gain_ratio: float = 1.0
    """Measured yaw gain over the identified model's, at least 1. The largest belt speed difference is divided by the ratio: the
    chair then turns no faster than the model at the largest difference, and the end of the turn is as gentle."""


def clipped(demanded: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return each belt speed limited to the maximum."""
    return np.clip(demanded, -limits.max_speed_m_s, limits.max_speed_m_s)


def climb_safe(demanded: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return belt speeds (left, right) [m/s] with the demanded difference, within the limits.

    The demanded common speed is replaced by the climb speed, or by a higher speed that keeps the inner belt from sliding.
    """
    inner_m_s = limits.min_inner_speed_ratio * limits.climb_speed_m_s
    most = min(0.5 * (limits.max_speed_m_s - inner_m_s), MAX_MEAN_M_S - inner_m_s) / limits.yaw_gain_ratio
    half = float(np.clip(0.5 * (demanded[1] - demanded[0]), -most, most))
    common = max(limits.climb_speed_m_s, abs(half) + inner_m_s)
    return np.array([common - half, common + half])


def back_safe(demanded: Float[np.ndarray, " 2"], limits: BeltLimits) -> Float[np.ndarray, " 2"]:
    """Return belt speeds (left, right) [m/s] for backing down at the climb speed, with both belts moving down."""
    most = (1.0 - INNER_RATIO_NEAR_STRAIGHT) * limits.climb_speed_m_s
    half = float(np.clip(0.5 * (demanded[1] - demanded[0]), -most, most))
    return np.array([-limits.climb_speed_m_s - half, -limits.climb_speed_m_s + half])
