"""Physics steps of the shipped plant in Python, stage by stage, with the Gauss-Seidel solver in place of MuJoCo's.

Nothing of the compiled loop is used. Belts keep the speeds of ``set_belts``: the drives' lag belongs to the plant's tick.
"""

import mujoco
import numpy as np
from oracles.gauss_seidel import ContactSolution, apply_contacts, solve_contacts

from treadline.plant.mujoco import MujocoPlant


def set_belts(plant: MujocoPlant, left_m_s: float, right_m_s: float) -> None:
    """Give the belts' surfaces their speeds at once: three pulleys turn, two flat runs move."""
    radius = plant._chair.tracks.pulley_radius_m
    for geoms, speed in zip(plant._belts, (left_m_s, right_m_s), strict=True):
        plant._model.geom_surfacevel[geoms[:3], 5] = speed / radius
        plant._model.geom_surfacevel[geoms[3:], 0] = -speed


def stages_before_contact(plant: MujocoPlant) -> None:
    """Run a step's stages up to ``mj_fwdAcceleration``, the contacts' tangents and friction turned to the belts."""
    model, data = plant._model, plant._data
    model.opt.noslip_iterations = 0  # the plant settles under its brake, which leaves them on
    mujoco.mj_fwdKinematics(model, data)
    mujoco.mj_makeM(model, data)
    mujoco.mj_factorM(model, data)
    mujoco.mj_collision(model, data)
    _turn_to_belts(plant)
    mujoco.mj_makeConstraint(model, data)
    mujoco.mj_transmission(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)


def coulomb_step(plant: MujocoPlant, tolerance_m_s2: float = 1e-4) -> ContactSolution:
    """Advance by one physics step under Coulomb friction, and return the step's contact forces."""
    stages_before_contact(plant)
    solution = solve_contacts(plant._model, plant._data, tolerance_m_s2)
    apply_contacts(plant._model, plant._data, solution)
    mujoco.mj_implicit(plant._model, plant._data)
    return solution


def coulomb_run(plant: MujocoPlant, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose (x, y, z, quaternion) after every step of a run at constant belt speeds, and the sum of normal forces."""
    steps = round(duration_s / plant._model.opt.timestep)
    pose, normal = np.empty((steps, 7)), np.empty(steps)
    for k in range(steps):
        solution = coulomb_step(plant)
        pose[k], normal[k] = plant._data.qpos[:7], solution.force[solution.normal].sum()
    return pose, normal


def _turn_to_belts(plant: MujocoPlant) -> None:
    """Turn the tangents of each belt contact along the belt and across it, and give them Table I's pair of coefficients."""
    data, (along, across) = plant._data, plant.staircase.friction
    chair_y = data.xmat[1].reshape(3, 3)[:, 1]
    for i in range(data.ncon):
        contact = data.contact[i]
        first, second = contact.geom
        if not (plant._is_belt[first] or plant._is_belt[second]):
            continue
        frame = contact.frame.reshape(3, 3)
        outward = frame[0] if plant._is_belt[first] else -frame[0]
        travel = np.cross(chair_y, outward)
        if np.linalg.norm(travel) < 0.1:  # the belt's side: no direction of travel lies in this tangent plane
            contact.friction[:2] = across
            continue
        travel /= np.linalg.norm(travel)
        tangents = np.array([travel, np.cross(frame[0], travel)])
        moving = contact.surfacevel[:2] @ frame[1:]
        contact.surfacevel[:2] = tangents @ moving
        contact.frame[3:] = tangents.ravel()
        contact.friction[:2] = along, across
