"""Traction on the nosing plane: friction available along and across the belts, and lugs that the pulleys bend.

Paper: Section II.A, Table I (μ = 0.62 along, μ₂ = 0.5 across). Gravity pulls down the slope with tan β per unit of normal force; at
a heading ψ the components are cos ψ along the belts and sin ψ across. The chair holds inside the friction ellipse (cos ψ tan β /
μ)² + (sin ψ tan β / μ₂)² < 1.
"""

import math

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import Tracks
from treadline.scenario.scenario import Belts


def friction_use(slope_rad: float, heading_rad: float, friction: tuple[float, float]) -> float:
    """Return the used fraction of the friction ellipse at a heading; the chair slides at 1."""
    along, across = friction
    pull = math.tan(slope_rad)
    return math.hypot(math.cos(heading_rad) * pull / along, math.sin(heading_rad) * pull / across)


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


def oversized_lugs(belts: Belts, tracks: Tracks) -> str | None:
    """Return why the lugs are too large for the chair's pulleys, or None."""
    # The belt solid of 0.05 m shrinks by the lug height.
    height, most = belts.measures_m[0], min(0.5 * tracks.pulley_radius_m, 0.04)
    if height <= most:
        return None
    return (
        f"belts.height_m is {height:.3f}, the pulleys' radius {tracks.pulley_radius_m:.3f} m; lugs up to {most:.3f} m fit, "
        "half that radius and 0.04 m at most: a belt bends at the lugs' feet"
    )
