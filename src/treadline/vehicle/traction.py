"""Traction on the nosing plane: friction available along and across the belts.

Paper: Section II.A, Table I (μ = 0.62 along, μ₂ = 0.5 across). Gravity pulls down the slope with tan β per unit of normal force; at
a heading ψ the components are cos ψ along the belts and sin ψ across. The chair holds inside the friction ellipse (cos ψ tan β /
μ)² + (sin ψ tan β / μ₂)² < 1.
"""

import math

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import GRAVITY_M_S2


def friction_use(slope_rad: float, heading_rad: float, friction: tuple[float, float]) -> float:
    """Return the used fraction of the friction ellipse at a heading; the chair slides at 1."""
    along, across = friction
    pull = math.tan(slope_rad)
    return math.hypot(math.cos(heading_rad) * pull / along, math.sin(heading_rad) * pull / across)


def steepest_slope_rad(friction: tuple[float, float]) -> float:
    """Return the slope at which the chair starts to slide along its belts [rad]."""
    return math.atan(friction[0])


def slide_acceleration_m_s2(slope_rad: float, friction: tuple[float, float]) -> float:
    """Return the acceleration g (sin β - μ cos β) of a chair sliding along its belts [m/s²]; 0 if friction holds."""
    return max(0.0, GRAVITY_M_S2 * (math.sin(slope_rad) - friction[0] * math.cos(slope_rad)))


def largest_heading_rad(slope_rad: float, friction: tuple[float, float]) -> float:
    """Return the largest heading at which friction holds the chair on a slope [rad]; π/2 without a limit.

    Raises:
        MechanicsError: If the chair slides even at zero heading.
    """
    if friction_use(slope_rad, 0.0, friction) >= 1.0:
        raise MechanicsError(
            f"friction {friction[0]:.2f} cannot hold a slope that needs {math.tan(slope_rad):.2f}; roughen the nosings"
        )
    pull = math.tan(slope_rad)
    lengthwise, sidewise = (pull / friction[0]) ** 2, (pull / friction[1]) ** 2
    if sidewise <= 1.0:
        return 0.5 * math.pi
    # lengthwise cos² + sidewise sin² = 1, solved for sin².
    return math.asin(math.sqrt((1.0 - lengthwise) / (sidewise - lengthwise)))
