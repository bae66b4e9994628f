"""Quasi-static skid steering: motion of a tracked chair at given belt speeds under Coulomb friction.

``Stance, friction, belt speeds -> SteadyMotion``, in the axes of ``stance``; integrated over time, a ``QuasiStaticRun``.

Belt speeds change slowly against friction's deceleration (5 m/s²), so friction balances gravity at every instant. By the principle
of maximum dissipation the balancing velocity q = (v_x, v_y, ω) minimises the convex function

    Σ N_i |M u_i(q)| - G·q,    M = diag(μ along, μ across),    u_i = (v_x - ω y_i - belt speed, v_y + ω x_i),

with N_i the share of the normal force at contact i and G gravity's wrench along the plane per unit of normal force. The theory is
independent of the simulator, which is tested against it.

The yaw rate depends on the nosings under the belts and on the heading (at 25° with Table I's friction it falls by a quarter in one
degree), so a run of some seconds is integrated.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle._stance import Stance, floor_stance, nosing_stance, stair_stance

__all__ = [
    "QuasiStaticRun",
    "Stance",
    "SteadyMotion",
    "floor_stance",
    "nosing_stance",
    "quasi_static_run",
    "stair_stance",
    "steady_motion",
]

ROUNDING = np.geomspace(1e-1, 1e-8, 8)
"""Rounding of the kink at zero slip, relative to the faster belt's speed; a sticking contact creeps at about the last value."""
NEWTON_STEPS = 100
"""Limit of the Newton steps at each rounding; six to seven are usual with 200 phases."""
RUNAWAY = 1e3
"""Ratio of the chair's speed to the faster belt's above which no steady motion exists: gravity outweighs friction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SteadyMotion:
    """Velocity of B's origin over the ground and yaw rate, one value per nosing phase."""

    along_m_s: Float[np.ndarray, " p"]
    """Speed along the belts, positive forward [m/s]."""
    across_m_s: Float[np.ndarray, " p"]
    """Speed across the belts, positive to the left [m/s]."""
    yaw_rad_s: Float[np.ndarray, " p"]
    """Yaw rate, positive to the left [rad/s]."""
    climb_m_s: Float[np.ndarray, " p"]
    """Speed up the slope [m/s]."""

    @property
    def mean(self) -> tuple[float, float, float]:
        """Speed along, speed across and yaw rate, averaged over the nosing phases."""
        return float(self.along_m_s.mean()), float(self.across_m_s.mean()), float(self.yaw_rad_s.mean())


def steady_motion(stance: Stance, friction: tuple[float, float], left_m_s: float, right_m_s: float) -> SteadyMotion:
    """Return the motion at given belt speeds.

    Args:
        friction: Coefficients along and across the belts.

    Raises:
        MechanicsError: If friction cannot hold the chair on its slope, or an argument is not a valid speed or coefficient.
    """
    if not (0.0 < friction[0] < math.inf and 0.0 < friction[1] < math.inf):
        raise MechanicsError(f"friction {friction[0]:g} along and {friction[1]:g} across; both coefficients must be positive")
    if not (math.isfinite(left_m_s) and math.isfinite(right_m_s)):
        raise MechanicsError(f"belt speeds {left_m_s:g} and {right_m_s:g} m/s; both must be finite")
    x, y = stance.x_m, stance.y_m
    zero, one = np.zeros_like(x), np.ones_like(x)
    # M u = slip @ q - drive, for every phase and contact.
    slip = np.stack([np.stack([one, zero, -y], axis=-1), np.stack([zero, one, x], axis=-1)], axis=-2)
    slip *= np.array(friction)[:, None]
    drive = np.stack([friction[0] * np.where(stance.on_left, left_m_s, right_m_s), zero], axis=-1)
    scale = max(abs(left_m_s), abs(right_m_s)) or 1.0
    q = np.zeros((len(x), 3))
    for rounding in scale * ROUNDING:
        for _ in range(NEWTON_STEPS):
            q, decrement = _newton_step(stance, slip, drive, q, float(rounding), 0.1 * RUNAWAY * scale)
            if decrement < 1e-4 * rounding or np.abs(q).max() > RUNAWAY * scale:
                break
    if not np.abs(q).max() <= RUNAWAY * scale:
        raise MechanicsError(
            f"friction {friction[0]:.2f} along and {friction[1]:.2f} across cannot hold a slope that needs "
            f"{math.hypot(*stance.wrench[:2]):.2f} at this heading: the chair slides faster and faster; roughen the nosings"
        )
    return SteadyMotion(along_m_s=q[:, 0], across_m_s=q[:, 1], yaw_rad_s=q[:, 2], climb_m_s=q[:, :2] @ stance.uphill)


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
    step_s: float = 0.02,
) -> QuasiStaticRun:
    """Return heading and distance of a run at constant belt speeds.

    Args:
        heading_rad: Initial heading.
        nosing_ahead_m: Initial distance of a nosing ahead of B's origin, up the slope.
        step_s: Integration step: 0.02 s is 3 to 5 mm of travel, a hundredth of a nosing pitch.

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


def _newton_step(
    stance: Stance,
    slip: Float[np.ndarray, "p n 2 3"],
    drive: Float[np.ndarray, "p n 2"],
    q: Float[np.ndarray, "p 3"],
    rounding: float,
    reach: float,
) -> tuple[Float[np.ndarray, "p 3"], float]:
    """Return the motions after one damped Newton step each, and the largest Newton decrement."""

    def cost(at: Float[np.ndarray, "p 3"]) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p n 2"], Float[np.ndarray, "p n"]]:
        u = np.einsum("pnij,pj->pni", slip, at) - drive
        size = np.sqrt(np.square(u).sum(axis=-1) + rounding**2)
        return (stance.load * size).sum(axis=1) - at @ stance.wrench, u, size

    value, u, size = cost(q)
    weight = stance.load / size
    gradient = np.einsum("pn,pnij,pni->pj", weight, slip, u) - stance.wrench
    # The Hessian of |M u|: across the slip only, but for the rounding.
    along = np.einsum("pnij,pni->pnj", slip, u / size[..., None])
    hessian = np.einsum("pn,pnij,pnik->pjk", weight, slip, slip) - np.einsum("pn,pnj,pnk->pjk", weight, along, along)
    hessian += 1e-14 * np.trace(hessian, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    step = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
    decrement = -(gradient * step).sum(axis=1)
    # Where gravity outweighs friction the Hessian vanishes as the minimiser runs away: steps are bounded.
    share = np.minimum(1.0, reach / (np.abs(step).max(axis=1) + 1e-300))
    for _ in range(40):
        too_far = cost(q + share[:, None] * step)[0] > value - 0.25 * share * decrement + 1e-16
        if not too_far.any():
            break
        share[too_far] *= 0.5
    return q + share[:, None] * step, float(decrement.max())
