"""Quasi-static skid steering: motion of a tracked chair at given belt speeds under Coulomb friction.

``Stance, friction, belt speeds -> SteadyMotion``, in the axes of ``stance``.

Belt speeds change slowly against friction's deceleration (5 m/s²), so friction balances gravity at every instant. By the principle
of maximum dissipation the balancing velocity q = (v_x, v_y, ω) minimises the convex function

    Σ N_i |M u_i(q)| - G·q,    M = diag(μ along, μ across),    u_i = (v_x - ω y_i - belt speed, v_y + ω x_i),

with N_i the share of the normal force at contact i and G gravity's wrench along the plane per unit of normal force. The theory is
independent of the simulator, which is tested against it.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.vehicle.stance import Stance

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

    @property
    def mean_over_time(self) -> tuple[float, float, float]:
        """Speed along, speed across and yaw rate averaged over time: a faster phase has a shorter duration.

        Raises:
            MechanicsError: If the chair stops or slides back in some phase, so that it never leaves that phase.
        """
        if self.climb_m_s.min() <= 0.0:
            raise MechanicsError(
                f"the chair climbs at {self.climb_m_s.min():.4f} m/s in one nosing phase; an average over time needs it to pass all"
            )
        duration = 1.0 / self.climb_m_s
        means = [float(np.average(value, weights=duration)) for value in (self.along_m_s, self.across_m_s, self.yaw_rad_s)]
        return means[0], means[1], means[2]

    def turning_share(self, least_rad_s: float) -> float:
        """Return the fraction of the nosing phases with a yaw rate above a limit."""
        return float((np.abs(self.yaw_rad_s) > least_rad_s).mean())


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


def dissipation(
    stance: Stance, friction: tuple[float, float], left_m_s: float, right_m_s: float, q: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, " p"]:
    """Return the minimised function at any motion q: power of friction minus power of gravity, over the normal force [m/s]."""
    ux = q[:, :1] - q[:, 2:] * stance.y_m - np.where(stance.on_left, left_m_s, right_m_s)
    uy = q[:, 1:2] + q[:, 2:] * stance.x_m
    return (stance.load * np.hypot(friction[0] * ux, friction[1] * uy)).sum(axis=1) - q @ stance.wrench


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
