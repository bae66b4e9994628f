"""The measure of a violated contact law against closed forms: a block at rest, one that slides, and MuJoCo's convex contact."""

from functools import cache

import mujoco
import numpy as np
import pytest
from oracles.contact_law import coulomb_error_m_s2, unbalanced

SCENE = """<mujoco>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" jacobian="dense" impratio="10" tolerance="1e-12"/>
  <worldbody><geom name="ground" type="plane" size="9 9 1"/><body pos="0 0 0.0999"><freejoint/>
  <geom name="block" type="box" size="0.2 0.1 0.1" mass="10"/></body></worldbody>
  <contact><pair geom1="ground" geom2="block" friction="0.6 0.3 0.1 0 0" solref="0.01 1" solimp="0.95 0.99 0.001" condim="3"/>
  </contact></mujoco>"""
"""A box of 10 kg on a plane with friction 0.3 along x and 0.6 along y: MuJoCo's first tangent on a plane is y."""


@cache
def at_rest() -> tuple[mujoco.MjModel, float]:
    """Return the model and the block's height at rest; 400 steps are 80 time constants of its contact."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 400)
    return model, float(data.qpos[2])


def sliding(x_m_s: float, y_m_s: float) -> mujoco.MjData:
    """Return a sliding block after all stages of MuJoCo's step, its own contact forces included."""
    model, height_m = at_rest()
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[:2] = height_m, (x_m_s, y_m_s)
    for stage in (mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation, mujoco.mj_fwdAcceleration):
        stage(model, data)
    mujoco.mj_fwdConstraint(model, data)
    return data


def by_hand(data: mujoco.MjData, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations and forces of a block that slides at all corners one way: the normals' slack is zero.

    Args:
        data: The block's state.
        friction: Each corner's tangential forces over its normal force.
    """
    J = data.efc_J.reshape(data.nefc, -1)
    response = np.linalg.solve(10.0 * np.diag([1.0, 1.0, 1.0, *(1 / 3 * np.array([0.02, 0.05, 0.05]))]), J.T)
    along = np.kron(np.eye(data.nefc // 3), np.array([1.0, *friction])[:, None])
    slack = (J @ response + np.diag(data.efc_R)) @ along
    load = np.linalg.solve(slack[::3], (data.efc_aref - J @ data.qacc_smooth)[::3])
    return data.qacc_smooth + response @ along @ load, along @ load


WAYS = [((0.05, 0.0), (0.0, 0.3)), ((-0.3, 0.0), (0.0, -0.3)), ((0.0, 0.05), (-0.6, 0.0)), ((0.0, -0.4), (0.6, 0.0))]
"""Velocity, and the friction against it along the tangents, which are y and -x."""


@pytest.mark.parametrize(("velocity", "friction"), WAYS)
def test_a_block_that_slides_by_coulomb_violates_nothing_and_another_does(
    velocity: tuple[float, float], friction: tuple[float, float]
) -> None:
    data = sliding(*velocity)
    qacc, force = by_hand(data, np.array(friction))
    assert force[::3].sum() == pytest.approx(10.0 * 9.81, rel=1e-3)
    assert coulomb_error_m_s2(data.model, data, qacc, force) < 1e-8
    np.testing.assert_allclose(unbalanced(data.model, data, qacc, force), 0.0, atol=1e-9)
    # Half the friction, and all of it the wrong way: off by at least half of μ g.
    for wrong in (0.5, -1.0):
        qacc, force = by_hand(data, wrong * np.array(friction))
        assert coulomb_error_m_s2(data.model, data, qacc, force) > 0.5 * 0.3 * 9.81
    assert np.abs(unbalanced(data.model, data, qacc, 1.1 * force)).max() > 0.5


def test_at_rest_mujocos_own_solution_is_coulombs() -> None:
    data = sliding(0.0, 0.0)
    assert coulomb_error_m_s2(data.model, data, data.qacc, data.efc_force) < 1e-6
    np.testing.assert_allclose(unbalanced(data.model, data, data.qacc, data.efc_force), 0.0, atol=1e-6)
