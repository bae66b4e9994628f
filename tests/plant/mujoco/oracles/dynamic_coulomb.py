"""Planar motion of a tracked chair with its mass and inertia under Coulomb friction on the nosings of a flight.

The chair is one rigid body on the plane of the nosings. Its contacts are those of ``vehicle.quasi_static``; the loads on them are
those of a rigid chair on equal springs that balance weight, acceleration and the roll moment of the yaw acceleration. The equations
of motion are integrated by implicit Euler steps. By the principle of maximum dissipation the velocity q = (v_x, v_y, ω) at the end
of a step h minimises the convex function

    (q - q₀)·A (q - q₀) / 2h + Σ N_i |M u_i(q)| - G·q,

with A the chair's planar inertia per unit of normal force and the other symbols as there. Without A it is the quasi-static balance.
"""

import math
from collections.abc import Callable

import numpy as np

from treadline.core.rotations import rotation_y
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass, flipper_turns, vehicle
from treadline.vehicle.quasi_static import QuasiStaticRun, contact_loads, nosing_contacts

ROUNDING_M_S = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Rounding of the kink at zero slip, one after the other; a sticking contact creeps by the last one at most."""
LoadsAt = Callable[[float], np.ndarray]
"""Contacts at a time: place forward and left in B, and load over the sum of all loads."""


def planar_inertia(chair: ChairDescription, loading: Chair, seat_rad: float) -> tuple[np.ndarray, float]:
    """Return the mass matrix of B's origin (forward, left, yaw) and Σ m x z about the centre of mass, both over the mass."""
    x, y, _ = com = np.array(centre_of_mass(chair, loading, seat_rad))
    whole, moment, product = vehicle(chair, loading), 0.0, 0.0
    turns = {"chair": 0.0, whole.seat.name: seat_rad, **flipper_turns(chair)}
    for body in whole.bodies:
        R = rotation_y(turns[body.name])
        away = np.array(body.origin_m) + R @ np.array(body.com_m) - com
        tensor = R @ np.diag(body.inertia) @ R.T
        moment += tensor[2, 2] + body.mass_kg * (away[0] ** 2 + away[1] ** 2)
        product += body.mass_kg * away[0] * away[2] - tensor[0, 2]
    mass_kg = sum(body.mass_kg for body in whole.bodies)
    return np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [-y, x, moment / mass_kg + x * x + y * y]]), product / mass_kg


def dynamic_run(
    chair: ChairDescription,
    loading: Chair,
    slope_rad: float,
    pitch_m: float,
    friction: tuple[float, float],
    belts_m_s: tuple[float, float],
    duration_s: float,
    *,
    heading_rad: float = 0.0,
    nosing_ahead_m: float = 0.0,
    step_s: float = 0.005,
    loads_at: LoadsAt | None = None,
) -> QuasiStaticRun:
    """Return heading and distance of a run that starts in quasi-static motion.

    Args:
        loads_at: Contacts and loads from another source; None for those of a rigid chair on equal springs.
    """
    count, normal_m_s2 = round(duration_s / step_s), GRAVITY_M_S2 * math.cos(slope_rad)
    (inertia, product), com = planar_inertia(chair, loading, slope_rad), np.array(centre_of_mass(chair, loading, slope_rad))
    heading, climbed = np.full(count + 1, heading_rad), np.zeros(count + 1)
    q, acceleration = np.zeros(3), np.zeros(3)
    for k in range(count):
        uphill = np.array([math.cos(heading[k]), -math.sin(heading[k])])
        pull = -math.tan(slope_rad) * uphill
        if loads_at is None:
            points = nosing_contacts(
                chair.tracks, pitch_m, float(heading[k]), math.fmod((nosing_ahead_m - climbed[k]) / pitch_m, 1.0)
            )
            roll = np.array([0.0, product * acceleration[2] / normal_m_s2])
            load = contact_loads(points, com[:2] + com[2] * (pull - acceleration[:2] / normal_m_s2) - roll)
            contacts = np.column_stack([points, load])
        else:
            contacts = loads_at(k * step_s)
        wrench = np.array([pull[0], pull[1], com[0] * pull[1] - com[1] * pull[0]])
        if k == 0:
            q = end_of_step(contacts, friction, belts_m_s, np.zeros((3, 3)), q, wrench)
        turned = step_s * q[2]
        before = np.array([q[0] + turned * q[1], q[1] - turned * q[0], q[2]])  # the same velocity in axes that have turned
        q = end_of_step(contacts, friction, belts_m_s, inertia / (normal_m_s2 * step_s), before, wrench)
        acceleration = np.array([*(inertia @ (q - before))[:2], q[2] - before[2]]) / step_s
        heading[k + 1] = heading[k] + step_s * q[2]
        climbed[k + 1] = climbed[k] + step_s * float(q[:2] @ uphill)
    return QuasiStaticRun(t_s=step_s * np.arange(count + 1), heading_rad=heading, climbed_m=climbed)


def end_of_step(
    contacts: np.ndarray,
    friction: tuple[float, float],
    belts_m_s: tuple[float, float],
    inertia: np.ndarray,
    before: np.ndarray,
    wrench: np.ndarray,
) -> np.ndarray:
    """Return the velocity at the end of a step, for an inertia over the step and the normal force."""
    x, y, load = contacts[contacts[:, 2] > 0.0].T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = np.stack([np.stack([one, zero, -y], axis=-1) * friction[0], np.stack([zero, one, x], axis=-1) * friction[1]], axis=1)
    drive = np.stack([friction[0] * np.where(y > 0.0, *belts_m_s), zero], axis=-1)

    def cost(q: np.ndarray, rounding: float) -> tuple[float, np.ndarray, np.ndarray]:
        u = rows @ q - drive
        size = np.sqrt((u * u).sum(axis=1) + rounding**2)
        return float(0.5 * (q - before) @ inertia @ (q - before) + load @ size - wrench @ q), u, size

    q = before.copy()
    for rounding in ROUNDING_M_S:
        for _ in range(50):
            value, u, size = cost(q, rounding)
            along = np.einsum("nij,ni->nj", rows, u / size[:, None])
            gradient = inertia @ (q - before) + load @ along - wrench
            weight = load / size
            hessian = inertia + np.einsum("n,nij,nik->jk", weight, rows, rows) - np.einsum("n,nj,nk->jk", weight, along, along)
            step, share = -np.linalg.solve(hessian, gradient), 1.0
            if -gradient @ step < 1e-5 * rounding:
                break
            while cost(q + share * step, rounding)[0] > value + 1e-4 * share * float(gradient @ step) and share > 1e-6:
                share *= 0.5
            q = q + share * step
    return q
