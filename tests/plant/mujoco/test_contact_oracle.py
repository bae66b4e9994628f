"""The Gauss-Seidel oracle against closed forms, and what MuJoCo's convex contact makes of the same states."""

import math
from functools import cache

import mujoco
import numpy as np
import pytest
from oracles.gauss_seidel import ContactSolution, apply_contacts, coulomb_error_m_s2, solve_contacts
from scipy.integrate import solve_ivp

G_M_S2 = 9.81
MASS_KG = 10.0
FRICTION = {"x": 0.3, "y": 0.6}
"""Friction coefficients along the axes of the world: MuJoCo's first tangent on a plane is y."""
DAMPING_S = 2.0 / (0.99 * 0.01)
"""b of MuJoCo's reference acceleration: 2/(dmax · timeconst)."""
OPTION = """<option timestep="0.002" integrator="implicitfast" solver="Newton" cone="{cone}" jacobian="{jacobian}" impratio="10"
  iterations="100" tolerance="1e-12"/>
  <default><geom solref="0.01 1" solimp="0.95 0.99 0.001" condim="{condim}"/></default>"""
SCENE = """<mujoco>{option}<worldbody><geom name="ground" type="plane" size="9 9 1"/><body pos="0 0 0.0999">{joints}
  <geom name="block" type="box" size="0.2 0.1 0.1" mass="10"/></body></worldbody>
  <contact><pair geom1="ground" geom2="block" friction="0.6 0.3 0.1 0 0" solref="0.01 1" solimp="0.95 0.99 0.001"
  condim="{condim}"/></contact></mujoco>"""
FREE = "<freejoint/>"
SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))


class Block:
    """A box of 10 kg on a plane, stepped with the oracle in place of MuJoCo's solver."""

    def __init__(self, joints: str = FREE, *, cone: str = "elliptic", jacobian: str = "dense", condim: int = 3) -> None:
        option = OPTION.format(cone=cone, jacobian=jacobian, condim=condim)
        self.model = mujoco.MjModel.from_xml_string(SCENE.format(option=option, joints=joints, condim=condim))
        self.data = mujoco.MjData(self.model)

    def prepare(self) -> None:
        prepare(self.model, self.data)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.prepare()
            apply_contacts(self.model, self.data, solve_contacts(self.model, self.data, 1e-7))
            mujoco.mj_implicit(self.model, self.data)

    def settle(self) -> "Block":
        self.data.qpos[2] = resting_height_m(self.model.nv)
        self.data.qvel[:] = 0.0
        return self

    def solve(self, velocity_m_s: tuple[float, float]) -> ContactSolution:
        self.data.qvel[:2] = velocity_m_s
        self.prepare()
        return solve_contacts(self.model, self.data)

    def lean(self, slope_rad: float, downhill_rad: float) -> None:
        """Turn gravity instead of the plane."""
        pull = math.sin(slope_rad)
        self.model.opt.gravity[:] = G_M_S2 * np.array(
            [pull * math.cos(downhill_rad), pull * math.sin(downhill_rad), -math.cos(slope_rad)]
        )


@cache
def resting_height_m(nv: int) -> float:
    """Return the height of a block that has come to rest; 400 steps are 80 time constants of its contact."""
    block = Block(FREE if nv == 6 else SLIDES)
    block.step(400)
    assert abs(block.data.qvel).max() < 1e-9
    return float(block.data.qpos[2])


def prepare(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Run the stages before contact."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)


def world_force(block: Block, solution: ContactSolution) -> np.ndarray:
    """Return each contact's force on the block, in the world."""
    frames = block.data.contact.frame.reshape(-1, 3, 3)
    return np.einsum("ci,cij->cj", solution.force.reshape(-1, 3), frames)


VELOCITIES = [(0.05, 0.0), (0.0, 0.05), (-0.3, 0.0), (0.5, 0.5), (-0.02, 0.4)]


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_a_sliding_block_presses_with_its_weight(velocity: tuple[float, float]) -> None:
    solution = Block().settle().solve(velocity)
    # The load moves to the leading edge; its sum stays. What is left after settling is below 1e-8.
    assert solution.force[solution.normal].sum() == pytest.approx(MASS_KG * G_M_S2, rel=1e-7)
    assert solution.qacc[2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("velocity", "axis", "friction"), [((0.05, 0.0), 0, 0.3), ((0.0, -0.05), 1, 0.6), ((-2.0, 0.0), 0, 0.3)])
def test_friction_along_an_axis_is_its_coefficient_times_the_load_against_the_slip(
    velocity: tuple[float, float], axis: int, friction: float
) -> None:
    block = Block().settle()
    force = world_force(block, block.solve(velocity)).sum(axis=0)
    assert force[axis] == pytest.approx(-math.copysign(friction * MASS_KG * G_M_S2, velocity[axis]), rel=1e-7)
    assert force[1 - axis] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_friction_dissipates_the_most_that_its_ellipse_allows(velocity: tuple[float, float]) -> None:
    solution = Block().settle().solve(velocity)
    angles = np.linspace(0.0, 2.0 * math.pi, 721)
    for row, (m1, m2) in zip(solution.normal, solution.friction, strict=True):
        load, f, y = solution.force[row], solution.force[row + 1 : row + 3], solution.slack[row + 1 : row + 3]
        assert math.hypot(f[0] / m1, f[1] / m2) <= load * (1.0 + 1e-9)
        others = load * np.stack([m1 * np.cos(angles), m2 * np.sin(angles)], axis=1)
        # The power of friction on the slack, against every force on the rim; 1e-6 N m/s² of some hundred.
        assert f @ y <= (others @ y).min() + 1e-6
        assert solution.slack[row] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("velocity", [(0.05, 0.0), (0.0, 0.05), (0.5, 0.5)])
def test_mujocos_convex_contact_pushes_the_same_block_off(velocity: tuple[float, float]) -> None:
    block = Block().settle()
    coulomb = block.solve(velocity)
    model, data = block.model, block.data
    assert coulomb_error_m_s2(model, data, coulomb.qacc, coulomb.force) < 1e-8
    mujoco.mj_fwdConstraint(model, data)
    J = data.efc_J.reshape(data.nefc, model.nv)
    slack = (J @ data.qacc - data.efc_aref + data.efc_R * data.efc_force).reshape(-1, 3)
    slip = np.hypot(*(coulomb.friction * slack[:, 1:]).T)
    # The dual cone: the normal slack is as large as the scaled tangential one, which is b·v less the deceleration.
    assert slack[:, 0] == pytest.approx(slip, rel=0.01)
    tangential = DAMPING_S * np.array(velocity) + data.qacc[:2]
    # Contacts differ by the block's angular acceleration at 0.1 m height.
    assert slack[:, 0] == pytest.approx(np.hypot(FRICTION["x"] * tangential[0], FRICTION["y"] * tangential[1]), rel=0.1)
    # So the block leaves the ground on which it should slide, and its Coulomb error is the whole of that slack.
    assert data.efc_force.reshape(-1, 3)[:, 0].sum() > 1.15 * MASS_KG * G_M_S2
    assert data.qacc[2] > 1.5
    assert coulomb_error_m_s2(model, data, data.qacc.copy(), data.efc_force.copy()) == pytest.approx(slack[:, 0].max(), rel=0.01)


def test_at_rest_both_solvers_agree() -> None:
    block = Block().settle()
    block.lean(math.atan(0.2), 0.7)
    solution = block.solve((0.0, 0.0))
    mujoco.mj_fwdConstraint(block.model, block.data)
    # Without slip the two laws are one, and MuJoCo's tolerance is tight; a leaning block slips by less than 1e-3 m/s².
    assert solution.qacc == pytest.approx(block.data.qacc, abs=1e-3)
    assert solution.force == pytest.approx(block.data.efc_force, abs=1e-2)


@pytest.mark.parametrize(("downhill_rad", "friction"), [(0.0, 0.3), (0.5 * math.pi, 0.6), (math.pi, 0.3)])
def test_on_a_slope_a_block_holds_to_the_friction_angle_and_slides_beyond(downhill_rad: float, friction: float) -> None:
    for beyond_deg in (-0.5, 0.5):
        block = Block(SLIDES).settle()
        slope = math.atan(friction) + math.radians(beyond_deg)
        block.lean(slope, downhill_rad)
        start = block.data.qpos[:2].copy()
        block.step(500)
        speed = float(np.hypot(*block.data.qvel[:2]))
        if beyond_deg < 0.0:
            # Regularised friction creeps.
            assert np.hypot(*(block.data.qpos[:2] - start)) < 1e-3
        else:
            # The load changes with cos of the slope at once, which rings for 0.02 s of the second.
            assert speed == pytest.approx(G_M_S2 * (math.sin(slope) - friction * math.cos(slope)), rel=0.02)


def test_a_block_sliding_obliquely_follows_the_ellipse() -> None:
    block = Block(SLIDES).settle()
    slope, downhill = 0.65, 0.8
    block.lean(slope, downhill)
    pull = block.model.opt.gravity[:2].copy()
    squared = np.array([FRICTION["x"], FRICTION["y"]]) ** 2
    load = G_M_S2 * math.cos(slope)

    def coulomb(_: float, v: np.ndarray) -> np.ndarray:
        return pull - load * squared * v / (np.hypot(*(np.sqrt(squared) * v)) + 1e-12)

    block.data.qvel[:2] = (0.0, 0.5)
    exact = solve_ivp(coulomb, (0.0, 0.4), [0.0, 0.5], rtol=1e-9, atol=1e-9).y[:, -1]
    block.step(200)
    # Friction is implicit at 2 ms steps; the load's change to cos of the slope rings for 0.02 s.
    assert block.data.qvel[:2] == pytest.approx(exact, rel=0.02)


MECHANISM = """<mujoco>{option}<worldbody><body><joint name="a" type="hinge" axis="0 1 0" range="-10 -5" frictionloss="0.7"/>
  <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/>
  <body pos="0.4 0 0"><joint name="b" type="hinge" axis="0 1 0" frictionloss="0.4"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/>
  <body pos="0.3 0 0"><joint name="c" type="hinge" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/></body></body></body></worldbody>
  <equality><joint joint1="c" joint2="b" polycoef="0 0.5 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("angle_deg", [-4.0, -7.0, -11.0])
def test_limits_friction_loss_and_equalities_are_as_mujoco_solves_them(angle_deg: float) -> None:
    model = mujoco.MjModel.from_xml_string(MECHANISM.format(option=OPTION.format(cone="elliptic", jacobian="dense", condim=3)))
    data = mujoco.MjData(model)
    data.qpos[:] = math.radians(angle_deg), 0.1, 0.06
    data.qvel[:] = 0.3, -0.2, 0.1
    prepare(model, data)
    solution = solve_contacts(model, data)
    mujoco.mj_fwdConstraint(model, data)
    # These laws are convex: both solvers look for the same minimum, MuJoCo's to its tolerance.
    assert solution.qacc == pytest.approx(data.qacc, abs=1e-5)
    assert solution.force == pytest.approx(data.efc_force, abs=1e-5)


def test_a_frictionless_contact_is_as_mujoco_solves_it() -> None:
    block = Block(condim=1)
    solution = block.solve((0.4, 0.0))
    mujoco.mj_fwdConstraint(block.model, block.data)
    assert solution.qacc == pytest.approx(block.data.qacc, abs=1e-6)
    assert len(solution.normal) == 0


def test_a_block_in_the_air_falls() -> None:
    block = Block()
    block.data.qpos[2] = 1.0
    solution = block.solve((0.0, 0.0))
    assert solution.qacc[2] == pytest.approx(-G_M_S2)
    assert solution.force.size == 0
