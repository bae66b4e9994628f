"""Quasi-static skid steering: motion of a tracked chair at given belt speeds under Coulomb friction.

``chair, centre of mass, slope, heading -> Stance``: contact points of the belts on a flight or a floor, and the normal force at
each. All quantities are in B, in the plane of the belts' underside: x forward, y left, origin mid-track. ``Stance, friction, belt
speeds -> SteadyMotion``, in the same axes; integrated over time, a ``QuasiStaticRun``.

Belt speeds change slowly against friction's deceleration (5 m/s²), so friction balances gravity at every instant. By the principle
of maximum dissipation the balancing velocity q = (v_x, v_y, ω) minimises the convex function

    Σ N_i |M u_i(q)| - G·q,    M = diag(μ along, μ across),    u_i = (v_x - ω y_i - belt speed, v_y + ω x_i),

with N_i the share of the normal force at contact i and G gravity's wrench along the plane per unit of normal force. The theory is
independent of the simulator, which is tested against it.

The yaw rate depends on the nosings under the belts and on the heading (at 25° with Table I's friction it falls by a quarter in one
degree), so a run of some seconds is integrated.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.errors import MechanicsError
from treadline.core.rotations import Vector3
from treadline.scenario.chair import ChairDescription, Tracks
from treadline.vehicle.tracks import bearing_ends_m, road_wheels

ROUNDING = np.geomspace(1e-1, 1e-8, 8)
"""Rounding of the kink at zero slip, relative to the faster belt's speed; a sticking contact creeps at about the last value."""
NEWTON_STEPS = 100
"""Limit of the Newton steps at each rounding; six to seven are usual with 200 phases."""
RUNAWAY = 1e3
"""Ratio of the chair's speed to the faster belt's above which no steady motion exists: gravity outweighs friction."""
PHASES = 200
"""Number of nosing phases in an average. The yaw rate jumps when a nosing enters or leaves the belts: 1 % error with 200, 12 % with
20."""
HEADING_LIMIT_RAD = math.radians(80.0)
"""Largest heading of a stance on nosings [rad]: beyond it a belt lies along a nosing or between two."""
LOAD_STEPS = 100
"""Limit of the Newton steps for the loads; none is needed if all contacts carry."""
Centre = Callable[[float], tuple[float, float, float]]
"""Centre of mass in B [m] at a forward seat angle [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stance:
    """Contact points of both belts and their loads, one row per nosing phase, padded with points without load."""

    x_m: Float[np.ndarray, "p n"]
    y_m: Float[np.ndarray, "p n"]
    load: Float[np.ndarray, "p n"]
    """Share of each contact in the normal force; each row sums to 1."""
    wrench: Vector3
    """Gravity along the plane divided by the normal force: forward, left [-], and moment about B's origin [m]."""
    uphill: Float[np.ndarray, " 2"]
    """Unit vector up the slope."""

    @property
    def on_left(self) -> Bool[np.ndarray, "p n"]:
        """Whether each contact belongs to the left belt."""
        return self.y_m > 0.0


def nosing_contacts(
    tracks: Tracks, pitch_m: float, heading_rad: float, phase: float, ends_m: tuple[float, float] | None = None
) -> Float[np.ndarray, "n 2"]:
    """Return the intersections of the two edges of each belt with the nosing lines within the flat run.

    Args:
        phase: Distance of a nosing ahead of B's origin, up the slope, in pitches.
        ends_m: Rear and front end of what bears in line with the flat run [m]; None: the flat run alone.

    Raises:
        MechanicsError: If the pitch is not positive, or the belts are parallel to the nosings.
    """
    if not pitch_m > 0.0:
        raise MechanicsError(f"nosings {pitch_m:g} m apart; their pitch √(rise² + run²) must be positive")
    if not abs(heading_rad) <= HEADING_LIMIT_RAD:
        raise MechanicsError(
            f"heading {math.degrees(heading_rad):.1f}°; up to ±{math.degrees(HEADING_LIMIT_RAD):.0f}° belts cross the nosings"
        )
    half_m, c, s = 0.5 * tracks.flat_run_m, math.cos(heading_rad), math.sin(heading_rad)
    edges_m = _edges(tracks)
    rear_m, front_m = ends_m or (-half_m, half_m)
    reach = math.ceil((max(-rear_m, front_m) * c + edges_m.max() * abs(s)) / pitch_m) + 1
    lines_m = (np.arange(-reach, reach + 1) + phase) * pitch_m
    # Points (x, y) of the line at distance d up the slope: x cos ψ - y sin ψ = d.
    x = (lines_m[None, :] + edges_m[:, None] * s) / c
    points = np.stack([x, np.broadcast_to(edges_m[:, None], x.shape)], axis=-1)
    return points[(rear_m <= x) & (x <= front_m)]


def contact_loads(
    points: Float[np.ndarray, "n 2"], centre_m: Float[np.ndarray, " 2"], stiffness: Float[np.ndarray, " n"] | None = None
) -> Float[np.ndarray, " n"]:
    """Return the normal force shares of springs under a rigid chair with unilateral contacts.

    The loads are k max(0, c0 + c1 x + c2 y), sum to 1 and have their centre at ``centre_m``. They minimise Σ N_i²/(2 k_i) under
    these conditions; a Newton method on the convex dual in (c0, c1, c2) finds the carrying contacts.

    Args:
        stiffness: Relative stiffnesses k of the springs; None: equal.

    Raises:
        MechanicsError: If the centre lies outside the contacts' convex hull: the chair tips over.
    """
    # With rows and loads scaled by √k the springs are equal.
    root = np.ones(len(points)) if stiffness is None else np.sqrt(stiffness)
    rows = np.column_stack([np.ones(len(points)), points]) * root[:, None]
    wanted = np.array([1.0, *centre_m])
    plane = np.linalg.lstsq(rows.T @ rows, wanted, rcond=None)[0]
    for _ in range(LOAD_STEPS):
        load = np.maximum(rows @ plane, 0.0)
        left = wanted - rows.T @ load
        if np.abs(left).max() < 1e-12:
            return root * load
        carrying = rows[load > 0.0]
        step = np.linalg.lstsq(carrying.T @ carrying + 1e-12 * np.eye(3), left, rcond=None)[0]
        share, value = 1.0, _dual(rows, wanted, plane)
        while _dual(rows, wanted, plane + share * step) > value - 0.1 * share * float(left @ step) and share > 1e-6:
            share *= 0.5
        plane = plane + share * step
    raise MechanicsError(
        f"the weight passes ({centre_m[0]:.3f}, {centre_m[1]:.3f}) m from mid-track, outside all contacts: the chair tips over"
    )


def stair_stance(
    chair: ChairDescription, centre: Centre, slope_rad: float, pitch_m: float, heading_rad: float = 0.0, phases: int = PHASES
) -> Stance:
    """Return a chair's contacts on the nosings of a flight, seat level, at evenly spaced nosing phases."""
    return nosing_stance(chair, centre, slope_rad, pitch_m, heading_rad, [(k + 0.5) / phases for k in range(phases)])


def nosing_stance(
    chair: ChairDescription, centre: Centre, slope_rad: float, pitch_m: float, heading_rad: float, phases: Sequence[float]
) -> Stance:
    """Return a chair's contacts on the nosings of a flight, seat level, at given nosing phases.

    Raises:
        MechanicsError: If the chair tips over in one of them.
    """
    contacts = [nosing_contacts(chair.tracks, pitch_m, heading_rad, phase, bearing_ends_m(chair)) for phase in phases]
    return _stance(centre, contacts, slope_rad, heading_rad)


def floor_stance(chair: ChairDescription, centre: Centre, slope_rad: float = 0.0, heading_rad: float = 0.0) -> Stance:
    """Return a chair's contacts on a floor or an even ramp: both edges of each belt on its road wheels, as in the plant."""
    x, stiffness = road_wheels(chair.tracks)
    edges = _edges(chair.tracks)
    points = np.column_stack([np.tile(x, len(edges)), np.repeat(edges, len(x))])
    return _stance(centre, [points], slope_rad, heading_rad, np.tile(stiffness, len(edges)))


def _edges(tracks: Tracks) -> Float[np.ndarray, " 4"]:
    gauge, width = 0.5 * tracks.gauge_m, 0.5 * tracks.belt_width_m
    return np.array([gauge + width, gauge - width, -gauge + width, -gauge - width])


def _stance(
    centre: Centre,
    contacts: list[Float[np.ndarray, "_ 2"]],
    slope_rad: float,
    heading_rad: float,
    stiffness: Float[np.ndarray, " n"] | None = None,
) -> Stance:
    uphill = np.array([math.cos(heading_rad), -math.sin(heading_rad)])
    pull = -math.tan(slope_rad) * uphill
    seat_rad = math.asin(math.sin(slope_rad) * math.cos(heading_rad))
    com = np.array(centre(seat_rad))
    plumb = com[:2] + com[2] * pull
    padded = np.zeros((3, len(contacts), max(len(points) for points in contacts)))
    for k, points in enumerate(contacts):
        padded[:2, k, : len(points)] = points.T
        padded[2, k, : len(points)] = contact_loads(points, plumb, stiffness)
    wrench = np.array([pull[0], pull[1], com[0] * pull[1] - com[1] * pull[0]])
    return Stance(x_m=padded[0], y_m=padded[1], load=padded[2], wrench=wrench, uphill=uphill)


def _dual(rows: Float[np.ndarray, "n 3"], wanted: Vector3, plane: Vector3) -> float:
    return float(0.5 * np.square(np.maximum(rows @ plane, 0.0)).sum() - wanted @ plane)


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
    centre: Centre,
    slope_rad: float,
    pitch_m: float,
    friction: tuple[float, float],
    left_m_s: float,
    right_m_s: float,
    duration_s: float,
    *,
    heading_rad: float = 0.0,
    nosing_ahead_m: float = 0.0,
    step_s: float = 0.005,
) -> QuasiStaticRun:
    """Return heading and distance of a run at constant belt speeds.

    Args:
        heading_rad: Initial heading.
        nosing_ahead_m: Initial distance of a nosing ahead of B's origin, up the slope.
        step_s: Integration step: 0.005 s is 1 mm of travel; half the step changes the heading gained in a pitch by less than 0.3 %.

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
        stance = nosing_stance(chair, centre, slope_rad, pitch_m, float(heading[k]), [phase])
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
