"""Belt motors, brakes and battery under load: what a motor cannot give, the belt does not do."""

import math

import numpy as np
import pytest
from chairs import CHAIR, with_piece
from jaxtyping import Float
from oracles.plant_runs import held, plant_on

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.plant import _motors_and_battery_kernels as motors
from treadline.plant.mujoco import open_plant
from treadline.plant.mujoco.mujoco_plant import MujocoPlant
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair, Control, Realism, Scenario, Stair, Start
from treadline.vehicle.loading import Loading

WEIGHT_N = Loading(chair=CHAIR, payload_kg=50.0).weight_n


def drive(
    chair: ChairDescription = CHAIR,
    *,
    slope_deg: float = 28.0,
    seconds: float = 2.0,
    speed: float = 0.2,
    brake: bool = False,
    realism: Realism | None = None,
) -> tuple[list[Truth], MujocoPlant]:
    """Return the truth of a straight drive on rough nosings: friction 0.9 keeps the belts from sliding."""
    tables = {} if realism is None else {"realism": realism}
    plant = plant_on(slope_deg, (0.9, 0.5), seed=0, description=chair, start={"step": 8}, tables=tables)
    return held(plant, speed, speed, seconds, brake=brake), plant


def column(truth: list[Truth], name: str) -> Float[np.ndarray, " T"]:
    return np.array([getattr(sample, name) for sample in truth])


@pytest.mark.parametrize("brake", [True, False])
def test_traction_of_a_chair_that_does_not_accelerate_is_what_pulls_it_down(brake: bool) -> None:
    truth, _ = drive(brake=brake)
    traction = column(truth, "left_force_n")[100:] + column(truth, "right_force_n")[100:]
    # Statics: W sin β. The mean over a second in which it drives at an even speed; jolts at nosings stay within 1 %.
    assert traction.mean() == pytest.approx(WEIGHT_N * math.sin(28.0 * DEG), rel=0.01)


def test_a_load_within_the_limits_leaves_the_belts_as_they_are_without_limits() -> None:
    limited, _ = drive()
    ideal, _ = drive(realism=Realism(motor_limits=False))
    for name in ("x_m", "left_m_s", "right_m_s", "pitch_rad", "left_force_n"):
        np.testing.assert_array_equal(column(limited, name), column(ideal, name))
    assert column(ideal, "power_w").max() == 0.0 < column(limited, "power_w").max()


def test_a_motor_that_is_too_weak_is_driven_back_down_30_degrees() -> None:
    # Each belt needs half of W sin 30° = 189 N; the motor gives 120.
    truth, plant = drive(with_piece("motor", peak_force_n=120.0, continuous_force_n=100.0), slope_deg=30.0, seconds=1.5)
    speed = 0.5 * (column(truth, "left_m_s") + column(truth, "right_m_s"))
    assert speed[-1] < -0.3
    # Newton for chair and moving mass together: (2 · 120 - 377) / (77 + 2 · 25) = -1.08 m/s² once the contacts have settled; hops
    # over nosings cost a part of it.
    mass = WEIGHT_N / 9.81 + 2.0 * CHAIR.motor.moving_mass_kg
    expected = (2.0 * 120.0 - WEIGHT_N * 0.5) / mass
    assert (speed[100] - speed[20]) / 0.8 == pytest.approx(expected, rel=0.25)
    # None of what the fall did on the motors returns to the battery.
    assert column(truth, "power_w").min() >= 0.0
    electric = plant._drives.electric
    assert electric["work_j"] < 0.0 < electric["energy_j"]


def test_a_motor_settles_where_its_line_meets_a_load_that_grows_with_speed() -> None:
    numbers, state = a_drive()
    asked = np.zeros(2)
    # A damper of 2 kN·s/m on each belt.
    for _ in range(300):
        before = tuple(asked.tolist())
        asked[:] = asked + np.minimum(1.0 - asked, 0.04)
        motors.limit_belts(before, asked, (False, False), numbers, state)
        state["traction"] = 2000.0 * asked
    supply = state["voltage"] / 24.0
    # F = 900 u - 720 v and v = F / 2000.
    np.testing.assert_allclose(state["force"], 900.0 * supply / 1.36, rtol=1e-6)
    np.testing.assert_allclose(asked, 900.0 * supply / 1.36 / 2000.0, rtol=1e-6)
    # The battery's 26.6 V sag under some 40 A a motor.
    assert 0.8 < supply < 1.0


def test_a_motor_against_more_than_its_stall_force_stalls_and_turns_its_power_into_heat() -> None:
    # On 30° each belt carries 189 N: a stall force of 150 N at 24 V cannot hold, and a brake is what does.
    numbers, state = a_drive(peak_force_n=150.0, continuous_force_n=150.0)
    state["traction"] = state["old_traction"] = 189.0
    asked = np.array([0.001, 0.001])
    motors.limit_belts((0.0, 0.0), asked, (False, False), numbers, state)
    assert (asked < 0.0).all()
    np.testing.assert_allclose(state["force"], 150.0)
    # At stall F² v_0 / F_peak = 187.5 W a motor, less what the load gives back: below a watt at this speed; and the battery's loss.
    assert state["power"] == pytest.approx(2.0 * 187.5, rel=0.05)


def a_drive(**changes: float) -> tuple[np.void, np.void]:
    """Return the constants of the wheelchair's motors, and their state at rest with a full battery."""
    from treadline.plant._actuators import Actuators

    state = np.zeros(1, motors.ELECTRIC)[0]
    state["voltage"], state["charge"] = 24.0, 1.0
    return Actuators(Scenario(chair=Chair(payload_kg=50.0)), with_piece("motor", **changes)).motor[0], state


@pytest.mark.parametrize("carried_share", [0.3, 1.0, 2.0])
def test_a_gripping_chair_of_another_mass_than_assumed_is_stable(carried_share: float) -> None:
    numbers, state = a_drive()
    mass, load = carried_share * numbers["carried_kg"], 1000.0
    asked, speeds = np.zeros(2), []
    for _ in range(80):
        before = tuple(asked.tolist())
        asked[:] = 0.2
        motors.limit_belts(before, asked, (False, False), numbers, state)
        state["traction"] = load + mass * (asked - before) / 0.01
        speeds.append(float(asked[0]))
    acceleration = np.diff(speeds) / 0.01
    # The load exceeds the peak force of 900 N by 100 (or a little more once the voltage has sagged): all bounded, all the same way.
    assert (acceleration[40:] < 0.0).all()
    assert np.ptp(acceleration[60:]) < 0.2 * abs(acceleration[60:].mean())


def test_a_brake_weaker_than_the_load_slips_through_and_a_stronger_one_holds() -> None:
    def braked(hold_n: float) -> list[Truth]:
        chair = with_piece("drives", brake_hold_n=hold_n)
        return drive(chair, speed=0.0, brake=True, seconds=1.5)[0]

    # Each belt carries 177 N.
    slipped, held = braked(150.0), braked(200.0)
    assert slipped[-1].x_m - slipped[0].x_m < -0.2
    assert slipped[-1].left_m_s < -0.2
    # One tick of slip is all that the first load may cost before the brake has its answer.
    assert abs(held[-1].x_m - held[0].x_m) < 0.002


@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_the_battery_gives_at_least_the_work_of_the_belts(speed: float) -> None:
    truth, plant = drive(speed=speed, seconds=2.0)
    electric = plant._drives.electric
    force, belt = column(truth, "left_force_n"), column(truth, "left_m_s")
    force_right, belt_right = column(truth, "right_force_n"), column(truth, "right_m_s")
    work_j = float((force * belt + force_right * belt_right).sum()) * 0.01
    assert electric["energy_j"] >= max(work_j, 0.0)
    # Charge and energy are one account.
    assert electric["charge"] == pytest.approx(1.0 - electric["energy_j"] / (3600.0 * 512.0), rel=1e-9)
    assert float(column(truth, "power_w").sum()) * 0.01 == pytest.approx(electric["energy_j"], rel=1e-6)


def test_the_voltage_sags_by_current_times_resistance() -> None:
    numbers, state = a_drive()
    motors.draw(500.0, numbers, state)
    current = 500.0 / state["voltage"]
    assert state["voltage"] == pytest.approx(26.6 - 0.05 * current, rel=1e-12)
    # What leaves the cells is the power and the loss in their resistance.
    assert state["power"] == pytest.approx(500.0 + 0.05 * current**2, rel=1e-12)


def test_a_hot_motor_gives_its_continuous_force() -> None:
    numbers, state = a_drive(thermal_time_s=1.0)
    forces = []
    for _ in range(300):
        state["traction"] = state["old_traction"] = 700.0
        asked = np.array([0.2, 0.2])
        motors.limit_belts((0.2, 0.2), asked, (False, False), numbers, state)
        state["change"] = state["old_change"] = 0.0
        forces.append(float(state["force"][0]))
    # (700 / 350)² = 4 heats to 1 in ln(4/3) = 0.29 s.
    assert forces[0] == pytest.approx(700.0)
    first_hot = next(k for k, force in enumerate(forces) if force < 400.0)
    assert first_hot == pytest.approx(29, abs=2)
    assert min(forces) == pytest.approx(350.0)


def test_an_empty_battery_engages_the_brakes() -> None:
    empty = with_piece("battery", capacity_wh=0.05)
    truth, _ = drive(empty, seconds=3.0)
    # 0.05 Wh are 180 J, about a second of climbing.
    assert column(truth, "left_m_s").max() > 0.1
    assert truth[-1].left_m_s == 0.0
    assert abs(truth[-1].x_m - truth[-20].x_m) < 0.001


def seat_after(seconds: float, *, rate: float, **seat: float) -> tuple[float, float, MujocoPlant]:
    """Return the seat's angle [deg] before and after its actuator is driven at a rate, a passenger of 120 kg sitting 0.3 m back."""
    chair = with_piece("seat", **seat)
    scenario = Scenario(
        stair=Stair(walls="none"),
        chair=Chair(payload_kg=120.0, payload_offset_m=(-0.3, 0.0, 0.0)),
        start=Start(place="floor"),
        control=Control(vision="truth"),
    )
    plant = open_plant(scenario, 0, chair=chair)
    plant.start()
    before = float(plant._data.qpos[7]) / DEG
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=rate))
    plant.advance(seconds)
    return before, float(plant._data.qpos[7]) / DEG, plant


def test_a_seat_actuator_lifts_what_its_force_can_and_no_more() -> None:
    # 120 kg at 0.3 m is 353 N·m about the hinge: some 1.8 kN at a lever of 0.2 m. 3 kN lift that both ways, 0.5 kN neither.
    moved = [abs(np.diff(seat_after(1.0, rate=rate)[:2])[0]) for rate in (0.03, -0.03)]
    assert min(moved) > 5.0 or max(moved) > 5.0
    up, down = (np.diff(seat_after(1.0, rate=rate, push_n=500.0)[:2])[0] for rate in (0.03, -0.03))
    # Both are carried where the load goes.
    assert np.sign(up) == np.sign(down)


def test_a_screw_that_is_too_weak_lets_the_seat_sink_and_the_shipped_one_holds() -> None:
    before, after, _ = seat_after(1.0, rate=0.0)
    # The servo's own compliance is in both: the chair rests before t = 0.
    assert after == pytest.approx(before, abs=0.05)
    before, after, _ = seat_after(1.0, rate=0.0, hold_n=300.0)
    # It sank already while the chair came to rest; what is left is at the end of its stroke.
    _, strong, _ = seat_after(0.1, rate=0.0)
    assert abs(after - strong) > 3.0


def test_a_flipper_motor_loses_its_torque_with_speed() -> None:
    peaks = []
    for no_load in (60.0, None):
        chair = with_piece("flipper", no_load_deg_s=no_load)
        plant = open_plant(Scenario(stair=Stair(walls="none"), control=Control(vision="truth")), 0, chair=chair)
        plant.start()
        # Raised in the air: 30 °/s is half of the rate without load.
        for tick in range(1, 61):
            plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0), FlipperCommand(t_s=0.0, rate_rad_s=30.0 * DEG))
            plant.advance(tick * 0.01)
        peaks.append(float(plant._model.actuator_forcerange[1, 1]))
        assert plant._data.qvel[7] > 0.0
    # The range narrows by speed over the rate without load; it is that of the last 2 ms.
    assert peaks[1] == pytest.approx(200.0)
    assert 80.0 < peaks[0] < 190.0
