"""Traction on the nosing plane: what friction can hold, along the belt and across it.

Paper: Section II.A, Table I (μ = 0.62 along, μ₂ = 0.5 across). Weight pulls down the slope with tan β per unit of normal
force; at a heading ψ its part cos ψ lies along the belts and sin ψ across them. The friction ellipse holds both while
(cos ψ tan β / μ)² + (sin ψ tan β / μ₂)² < 1.
"""

import math

from treadline.errors import MechanicsError
from treadline.mechanics.chair import GRAVITY_M_S2


def friction_use(slope_rad: float, heading_rad: float, friction: tuple[float, float]) -> float:
    """Return the share of the friction ellipse that holding a heading takes; at 1 the chair slides."""
    along, across = friction
    pull = math.tan(slope_rad)
    return math.hypot(math.cos(heading_rad) * pull / along, math.sin(heading_rad) * pull / across)


def steepest_slope_rad(friction: tuple[float, float]) -> float:
    """Return the slope at which the chair slides straight down its belts."""
    return math.atan(friction[0])


def slide_acceleration_m_s2(slope_rad: float, friction: tuple[float, float]) -> float:
    """Return the acceleration g (sin β - μ cos β) of a chair that slides straight down its belts; 0 where friction holds it."""
    return max(0.0, GRAVITY_M_S2 * (math.sin(slope_rad) - friction[0] * math.cos(slope_rad)))


def largest_heading_rad(slope_rad: float, friction: tuple[float, float]) -> float:
    """Return the heading up to which the chair stays put on a slope (π/2 where it always does).

    Raises:
        MechanicsError: If it slides even when square.
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
