"""The Gauss-Seidel oracle against closed forms: a block that slides, and what MuJoCo's convex contact makes of the same state."""

import math
from functools import cache

import mujoco
import numpy as np
import pytest
from oracles.gauss_seidel import ContactSolution, coulomb_error_m_s2, solve_contacts

G_M_S2 = 9.81
MASS_KG = 10.0
SCENE = """<mujoco>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" jacobian="dense" impratio="10" tolerance="1e-12"/>
  <worldbody><geom name="ground" type="plane" size="9 9 1"/><body pos="0 0 0.0999"><freejoint/>
  <geom name="block" type="box" size="0.2 0.1 0.1" mass="10"/></body></worldbody>
  <contact><pair geom1="ground" geom2="block" friction="0.6 0.3 0.1 0 0" solref="0.01 1" solimp="0.95 0.99 0.001" condim="3"/>
  </contact></mujoco>"""
"""A box of 10 kg on a plane with friction 0.3 along x and 0.6 along y: MuJoCo's first tangent on a plane is y."""


@cache
def at_rest() -> tuple[mujoco.MjModel, float]:
    """Return the model and the block's height at rest, where both solvers agree; 400 steps are 80 time constants of its contact."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 400)
    return model, float(data.qpos[2])


def solved(velocity_m_s: tuple[float, float]) -> tuple[mujoco.MjData, ContactSolution]:
    """Return a sliding block after the stages before contact, and the oracle's contact forces."""
    model, height_m = at_rest()
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[:2] = height_m, velocity_m_s
    for stage in (mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation, mujoco.mj_fwdAcceleration):
        stage(model, data)
    return data, solve_contacts(model, data)


VELOCITIES = [(0.05, 0.0), (0.0, 0.05), (-0.3, 0.0), (0.5, 0.5), (-0.02, 0.4)]


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_a_sliding_block_presses_with_its_weight(velocity: tuple[float, float]) -> None:
    solution = solved(velocity)[1]
    # The load moves to the leading edge; its sum stays. What is left after settling is below 1e-8.
    assert solution.force[solution.normal].sum() == pytest.approx(MASS_KG * G_M_S2, rel=1e-7)
    assert solution.qacc[2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_friction_dissipates_the_most_that_its_ellipse_allows(velocity: tuple[float, float]) -> None:
    solution = solved(velocity)[1]
    angles = np.linspace(0.0, 2.0 * math.pi, 721)
    for row, (m1, m2) in zip(solution.normal, solution.friction, strict=True):
        load, f, y = solution.force[row], solution.force[row + 1 : row + 3], solution.slack[row + 1 : row + 3]
        assert math.hypot(f[0] / m1, f[1] / m2) <= load * (1.0 + 1e-9)
        others = load * np.stack([m1 * np.cos(angles), m2 * np.sin(angles)], axis=1)
        # The power of friction on the slack, against every force on the rim; 1e-6 N m/s² of some hundred.
        assert f @ y <= (others @ y).min() + 1e-6
        assert solution.slack[row] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_the_measure_of_an_error_is_zero_for_coulomb_and_the_slack_of_a_convex_contact(velocity: tuple[float, float]) -> None:
    data, solution = solved(velocity)
    assert coulomb_error_m_s2(data.model, data, solution.qacc, solution.force) < 1e-8
    mujoco.mj_fwdConstraint(data.model, data)
    slack = data.efc_J.reshape(data.nefc, -1) @ data.qacc - data.efc_aref + data.efc_R * data.efc_force
    # The dual cone pushes the block off the ground on which it should slide.
    assert coulomb_error_m_s2(data.model, data, data.qacc, data.efc_force) == pytest.approx(slack[::3].max(), rel=0.01)
    assert data.efc_force[::3].sum() > 1.15 * MASS_KG * G_M_S2
