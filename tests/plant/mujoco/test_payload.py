"""Passenger: lean, sway, and a true weight different from the entered one."""

from typing import Any

import mujoco
import numpy as np
import pytest

from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.faults import FaultyPlant
from treadline.plant.mujoco import open_plant
from treadline.plant.mujoco.mujoco_plant import MujocoPlant
from treadline.run.resolve import checked as check
from treadline.run.resolve import mission_config
from treadline.scenario.chair import read_chair
from treadline.scenario.faults import Fault
from treadline.scenario.scenario import Scenario

CHAIR = read_chair("wheelchair")


def plant(place: str = "floor", **chair: Any) -> MujocoPlant:
    tables = {
        "stair": {"slope_deg": 25.0, "steps": 10},
        "start": {"place": place, "step": 6},
        "control": {"vision": "truth"},
        "chair": chair,
    }
    made = open_plant(Scenario.model_validate(tables), 0)
    made.start()
    return made


def com_W(made: MujocoPlant) -> np.ndarray:
    mujoco.mj_kinematics(made._model, made._data)
    mujoco.mj_comPos(made._model, made._data)
    return np.array(made._data.subtree_com[1])


@pytest.mark.parametrize("sway_m", [(0.1, 0.0), (0.0, 0.1), (0.08, 0.12)])
def test_a_sway_in_the_air_leaves_the_whole_on_its_parabola(sway_m: tuple[float, float]) -> None:
    """Test: a chair in free fall, turning, whose passenger sways by 0.1 m. Expected result: inner forces move no centre of mass."""
    made = plant(sway_m=sway_m, sway_period_s=1.0)
    made._data.qpos[2] += 5.0
    made._data.qvel[:] = 0.0
    made._data.qvel[3:6] = (0.3, -0.2, 0.5)
    mujoco.mj_forward(made._model, made._data)
    before_m, seat_m = com_W(made), made._model.body_ipos[made._seat_body].copy()
    mujoco.mj_subtreeVel(made._model, made._data)
    velocity = made._data.subtree_linvel[1].copy()
    made.advance(0.5)  # from one end of the sway to the other
    moved_m = com_W(made) - before_m - velocity * 0.5
    # 50.5 of 77 kg go across by twice 0.1 m: without the reaction the whole's centre would move by 0.13 m. What is left is the
    # integrator's error, which is first order: 2 ms of g t = 4.9 m/s along z, and of 0.6 m/s of sway.
    np.testing.assert_allclose(moved_m, [0.0, 0.0, -0.5 * 9.81 * 0.25], atol=6e-3)
    swayed_m = made._model.body_ipos[made._seat_body] - seat_m
    np.testing.assert_allclose(swayed_m, [-2.0 * sway_m[0], -2.0 * sway_m[1], 0.0], atol=1e-4)  # the last step is not quite there


def test_a_sway_pushes_a_chair_that_stands() -> None:
    """Test: braked on the floor, 50.5 kg sway by 0.1 m in 2 s. Expected result: lateral contact forces of -m A ω² cos ωt."""
    made = plant(sway_m=(0.0, 0.1), sway_period_s=2.0)
    made.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    omega, force = np.pi, []
    for k in range(1, 101):
        made.advance(0.01 * k)
        forces = np.zeros(6)
        total = 0.0
        for i in range(made._data.ncon):
            mujoco.mj_contactForce(made._model, made._data, i, forces)
            contact = made._data.contact[i]
            sign = 1.0 if made._is_belt[contact.geom2] else -1.0  # the force is that on the second geom
            total += sign * float((forces[:3] @ contact.frame.reshape(3, 3))[1])
        force.append(total)
    expected = 50.5 * 0.1 * omega**2 * np.cos(omega * 0.01 * np.arange(1, 101))
    # The floor accelerates the passenger towards the middle: against the deflection. The chair rocks on its belts by a tenth.
    assert np.corrcoef(force, -expected)[0, 1] > 0.98
    assert np.abs(force).max() == pytest.approx(np.abs(expected).max(), rel=0.15)


def test_a_lean_moves_the_centre_of_mass_and_the_margin() -> None:
    straight, leaning = plant(), plant(lean_m=(0.0, 0.15))
    for made in (straight, leaning):
        made.advance(0.1)
    shift_m = com_W(leaning)[1] - com_W(straight)[1]
    mass_kg = float(straight._model.body_subtreemass[1])
    assert shift_m == pytest.approx(0.15 * 50.5 / mass_kg, abs=2e-3)  # the chair settles to that side by a millimetre
    assert leaning.truth()[-1].stability_margin_rad < straight.truth()[-1].stability_margin_rad - 0.05


def test_the_margin_follows_the_sway_and_comfort_does_not() -> None:
    made, still = plant(sway_m=(0.0, 0.15), sway_period_s=2.0), plant()
    made.advance(2.0)
    still.advance(2.0)
    truth = made.truth()
    margins = np.array([sample.stability_margin_rad for sample in truth])
    # Least at both ends of the sway, at 0, 1 and 2 s; most in the middle, and there as without.
    assert margins[50] == pytest.approx(still.truth()[50].stability_margin_rad, abs=0.02)
    assert margins[[0, 100, 200]].max() < margins[50] - 0.05
    assert np.ptp([sample.passenger_x_m for sample in truth]) < 0.005


def test_check_and_mission_go_by_what_was_entered() -> None:
    heavy = {"payload_kg": 110.0, "payload_offset_m": (-0.2, 0.0, 0.0)}
    tables: dict[str, Any] = {"stair": {"slope_deg": 30.0}, "chair": heavy}
    assert check(Scenario.model_validate(tables), CHAIR).verdict == "refuse"
    tables["chair"] = heavy | {"entered_payload_kg": 60.0, "entered_payload_offset_m": (0.0, 0.0, 0.0)}
    scenario = Scenario.model_validate(tables)
    assert check(scenario, CHAIR).verdict == "go"
    assert mission_config(scenario, None).payload_kg == 60.0
    made = open_plant(scenario, 0)
    assert float(made._model.body_mass[made._seat_body]) == 110.5


def shifted(kinds: dict[str, float], **chair: Any) -> tuple[FaultyPlant, MujocoPlant]:
    """Return a standing plant on the floor whose payload shifts from 0.1 s to 1.1 s."""
    inner = plant(**chair)
    faults = [Fault.model_validate({"kind": kind, "at_s": 0.1, "for_s": 1.0, "value": value}) for kind, value in kinds.items()]
    outer = FaultyPlant(inner, faults, 0)
    outer.start()
    return outer, inner


def test_a_shifted_payload_moves_the_margin_at_its_time_and_back() -> None:
    """Test: 0.15 m to the left from 0.1 s to 1.1 s. Expected: the margin is that of the moved centre of mass, and recovers."""
    outer, inner = shifted({"payload_left": 0.15})
    outer.advance(1.5)
    truth = outer.truth()
    margin = np.array([sample.stability_margin_rad for sample in truth])
    height_m = com_W(inner)[2]
    share = 50.5 / float(inner._model.body_subtreemass[1])
    half_m = 0.5 * (CHAIR.tracks.gauge_m + CHAIR.tracks.belt_width_m)
    expected = np.arctan2(half_m - 0.15 * share, height_m)
    # The chair settles and rolls by a millimetre or two over 0.7 m.
    assert margin[10] == pytest.approx(expected, abs=0.01)
    assert margin[100] == pytest.approx(expected, abs=0.01)
    assert margin[149] == pytest.approx(margin[9], abs=0.01)
    # Comfort is judged at the seat: a shift of 0.15 m within a tick would count as 1500 m/s².
    assert np.ptp([sample.passenger_y_m for sample in truth]) < 0.01


def test_a_shifted_payload_loads_the_belt_on_its_side() -> None:
    """Test: braked, a second after the shift. Expected: the contact forces balance the weight about the shifted centre of mass."""
    outer, inner = shifted({"payload_forward": -0.1, "payload_left": 0.12, "payload_up": 0.05})
    outer.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    outer.advance(1.0)
    points_W, forces_W = inner.contacts()
    total_n = forces_W[:, 2].sum()
    weight_n = float(inner._model.body_subtreemass[1]) * 9.81
    assert total_n == pytest.approx(weight_n, rel=0.02)  # at rest up to the ringing of soft contacts
    centre_m = (points_W[:, :2] * forces_W[:, 2:]).sum(axis=0) / total_n
    # Without the shift the centre of mass is 0.08 m further to the right; tangential forces at 0 m height have no moment.
    np.testing.assert_allclose(centre_m, com_W(inner)[:2], atol=0.01)


def test_sway_and_shift_add() -> None:
    outer, inner = shifted({"payload_left": 0.1, "payload_up": 0.2}, sway_m=(0.0, 0.1), sway_period_s=2.0)
    rest_m = inner._payload_rest_m.copy()
    # A quarter of the period: the sway is in the middle, up to a time step.
    outer.advance(0.5)
    np.testing.assert_allclose(inner._model.body_ipos[inner._seat_body], rest_m + np.array([0.0, 0.1, 0.2]), atol=2e-3)
    outer.advance(1.5)  # and again in the middle, the shift over
    np.testing.assert_allclose(inner._model.body_ipos[inner._seat_body], rest_m, atol=2e-3)


def test_a_payload_centred_at_its_hinge_shifts_as_well() -> None:
    """Test: a centre of mass at the origin of its body, for which MuJoCo has a shortcut. Expected: the shift moves it."""
    x, y, z = CHAIR.payload_com_m
    outer, inner = shifted({"payload_left": 0.1}, payload_offset_m=(-x, -y, -z))
    before_m = com_W(inner)
    outer.advance(0.1)
    share = 50.5 / float(inner._model.body_subtreemass[1])
    assert com_W(inner)[1] - before_m[1] == pytest.approx(0.1 * share, abs=1e-3)
