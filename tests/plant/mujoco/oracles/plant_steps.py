"""Stages of a physics step of the shipped plant in Python, up to contact. Nothing of the compiled loop is used."""

import mujoco
import numpy as np

from treadline.plant.mujoco import MujocoPlant


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
