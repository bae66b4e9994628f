"""Dead zone of skid steering on a flight: Coulomb friction prevents a turn at any difference of belt speeds.

``chair, loading, slope, friction -> rows of yaw rate over heading and belt difference``, from ``quasi_static``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.quasi_static import steady_motion
from treadline.vehicle.stance import PHASES, Stance, stair_stance

HEADINGS_RAD = tuple(heading * DEG for heading in (0.0, 5.0, 10.0, 15.0, 30.0))
"""Headings of the table [rad]."""
SLOW_BELT_M_S = (0.05, 0.1, 0.2)
"""Speeds of the slower belt in the table [m/s]."""
DIFFERENCES_M_S = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 1.0)
"""Belt speed differences of the table [m/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringResponse:
    """Steady motion at one heading and one pair of belt speeds."""

    heading_rad: float
    slow_m_s: float
    """Speed of the slower belt."""
    difference_m_s: float
    """Right belt speed minus left belt speed [m/s]: a positive one steers to the left."""
    yaw_rad_s: float
    """Yaw rate, averaged over the nosing phases."""
    along_m_s: float
    """Speed of mid-track along the belts, averaged over the nosing phases."""
    turning_share: float
    """Fraction of the nosing phases with a yaw rate above 0.01 °/s."""


def dead_zone_table(
    chair: ChairDescription,
    loading: Chair,
    slope_rad: float,
    run_m: float,
    friction: tuple[float, float],
    *,
    headings_rad: Sequence[float] = HEADINGS_RAD,
    slow_m_s: Sequence[float] = SLOW_BELT_M_S,
    differences_m_s: Sequence[float] = DIFFERENCES_M_S,
    phases: int = PHASES,
) -> list[SteeringResponse]:
    """Return the yaw rate at each heading, slow belt speed and belt difference of either sign.

    Args:
        differences_m_s: Positive magnitudes; each is tried to the right and to the left.

    Raises:
        MechanicsError: If a difference is not positive, or friction cannot hold the chair at one of the headings.
    """
    if not min(differences_m_s) > 0.0:
        raise MechanicsError(f"belt difference {min(differences_m_s):g} m/s; magnitudes must be positive, either sign is tried")
    signed = sorted([-difference for difference in differences_m_s] + list(differences_m_s))
    rows = []
    for heading in headings_rad:
        stance = stair_stance(chair, loading, slope_rad, run_m / math.cos(slope_rad), heading, phases)
        for slow in slow_m_s:
            for difference in signed:
                motion = steady_motion(stance, friction, slow + max(-difference, 0.0), slow + max(difference, 0.0))
                along, _, yaw = motion.mean
                rows.append(
                    SteeringResponse(
                        heading_rad=heading,
                        slow_m_s=slow,
                        difference_m_s=difference,
                        yaw_rad_s=yaw,
                        along_m_s=along,
                        turning_share=motion.turning_share(0.01 * DEG),
                    )
                )
    return rows


def turning_room_m(slope_rad: float, friction: tuple[float, float], gauge_m: float) -> float:
    """Return the mean distance of the carrying contacts from their median below which a chair square to the flight turns [m].

    The slow belt sticks, and the chair starts to turn about the median of that belt's contacts at a rate ω. The fast belt slides
    lengthwise; its drag across is of second order in ω. With half the load on either belt, friction under the fast belt gains
    μ_along B ω/2, the chair's rise costs tan β B ω/2, and dragging the slow belt's contacts across costs μ_across m̄ ω/2, with m̄
    their mean distance from the median. Hence the chair turns if (μ_along - tan β) B > μ_across m̄. The condition is sufficient,
    not necessary: a few more phases turn about other centres of rotation, found by ``steady_motion``.
    """
    return (friction[0] - math.tan(slope_rad)) * gauge_m / friction[1]


def mean_distance_m(stance: Stance) -> Float[np.ndarray, " p"]:
    """Return the load-weighted mean distance of the contacts from their median along the belts, for each nosing phase."""
    order = np.argsort(stance.x_m, axis=1)
    x, load = np.take_along_axis(stance.x_m, order, axis=1), np.take_along_axis(stance.load, order, axis=1)
    middle = np.argmax(np.cumsum(load, axis=1) >= 0.5 - 1e-9, axis=1)
    return (load * np.abs(x - np.take_along_axis(x, middle[:, None], axis=1))).sum(axis=1)
