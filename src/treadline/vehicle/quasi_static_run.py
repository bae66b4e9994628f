"""Quasi-static run up a flight: heading and distance over time at constant belt speeds, by Coulomb friction alone.

``chair, flight, belt speeds, start -> QuasiStaticRun``. The yaw rate of ``quasi_static`` depends on the nosings under the belts and
on the heading (at 25° with Table I's friction it falls by a quarter in one degree), so a run of some seconds is integrated.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.quasi_static import steady_motion
from treadline.vehicle.stance import nosing_stance

STEP_S = 0.02
"""Integration step [s]: 3 to 5 mm of travel, a hundredth of a nosing pitch."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuasiStaticRun:
    """Time series of a run, the start included."""

    t_s: Float[np.ndarray, " n"]
    heading_rad: Float[np.ndarray, " n"]
    climbed_m: Float[np.ndarray, " n"]
    """Distance of B's origin from its start, up the slope."""

    @property
    def yaw_rad_s(self) -> float:
        """Mean yaw rate of the run."""
        return float((self.heading_rad[-1] - self.heading_rad[0]) / self.t_s[-1])

    @property
    def climb_m_s(self) -> float:
        """Mean speed up the slope."""
        return float(self.climbed_m[-1] / self.t_s[-1])


def quasi_static_run(
    chair: ChairDescription,
    loading: Chair,
    slope_rad: float,
    pitch_m: float,
    friction: tuple[float, float],
    left_m_s: float,
    right_m_s: float,
    duration_s: float,
    *,
    heading_rad: float = 0.0,
    nosing_ahead_m: float = 0.0,
    step_s: float = STEP_S,
) -> QuasiStaticRun:
    """Return heading and distance of a run at constant belt speeds.

    Args:
        heading_rad: Initial heading.
        nosing_ahead_m: Initial distance of a nosing ahead of B's origin, up the slope.

    Raises:
        MechanicsError: If friction cannot hold the chair at some heading, the chair tips over, or the duration is not positive.
    """
    if not (duration_s > 0.0 and step_s > 0.0):
        raise MechanicsError(f"a run of {duration_s:g} s in steps of {step_s:g} s; both must be positive")
    count = max(1, round(duration_s / step_s))
    step = duration_s / count
    heading, climbed = np.full(count + 1, heading_rad), np.zeros(count + 1)
    for k in range(count):
        phase = math.fmod((nosing_ahead_m - climbed[k]) / pitch_m, 1.0)
        stance = nosing_stance(chair, loading, slope_rad, pitch_m, float(heading[k]), [phase])
        motion = steady_motion(stance, friction, left_m_s, right_m_s)
        heading[k + 1] = heading[k] + step * motion.yaw_rad_s[0]
        climbed[k + 1] = climbed[k] + step * motion.climb_m_s[0]
    return QuasiStaticRun(t_s=step * np.arange(count + 1), heading_rad=heading, climbed_m=climbed)
