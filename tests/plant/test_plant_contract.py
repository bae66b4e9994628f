"""Contract of every plant: readings once, in order, on time; of simulators also determinism, sensor rates, ground truth, motion.

A recording repeats a simulator's run; the chair behind the guard process has a clock of the test and reports of an inertial sensor.
Gazebo's half needs its environment: ``make test-gazebo`` runs it.
"""

import math
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from world import imu

from treadline.core.angles import DEG
from treadline.core.errors import SimulationDiverged
from treadline.core.ports import Plant, Reading, TruthPlant
from treadline.core.rotations import attitude_of, rotation_of
from treadline.core.signals import (
    ROUNDING_S,
    TICK_S,
    FlipperCommand,
    FlipperReading,
    HeadingMeasurement,
    ImuSample,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.hardware._robot_plant import RobotPlant
from treadline.mission.replay_plant import ReplayPlant
from treadline.plant.gazebo import open_gazebo
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.scenario.scenario import Chair, Control, Realism, Scenario, Sensors, Stair, Start
from treadline.vehicle.staircase import as_designed

Opened = Callable[..., TruthPlant]
WITHOUT_GAZEBO = pytest.mark.skipif(os.environ.get("TREADLINE_TEST_GAZEBO") != "1", reason="make test-gazebo runs these")


@pytest.fixture(params=[pytest.param(open_plant, id="mujoco"), pytest.param(open_gazebo, id="gazebo", marks=WITHOUT_GAZEBO)])
def started(request: pytest.FixtureRequest) -> Iterator[Opened]:
    """Return what opens a plant on a flight of 28°, at its start; all are closed at the end."""
    with ExitStack() as stack:

        def start(
            seed: int = 3, *, mismatch: float = 0.01, heading_deg: float = 5.0, along: float = 0.62, sensors: Sensors | None = None
        ) -> TruthPlant:
            scenario = Scenario(
                stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), walls="none", width_m=4.0, friction=(along, 0.5)),
                chair=Chair(belt_mismatch=mismatch),
                start=Start(place="flight", step=6, heading_deg=heading_deg),
                control=Control(vision="truth"),
                sensors=sensors or Sensors(),
                realism=Realism(camera_latency_s=0.0, camera_jitter_s=0.0, camera_drop_rate=0.0),
            )
            plant: TruthPlant = request.param(scenario, seed)
            stack.callback(plant.close)
            plant.start()
            return plant

        yield start


def climb(plant: TruthPlant, until_s: float, *, stride_s: float = 0.25, left: float = 0.2, right: float = 0.2) -> list[Reading]:
    """Climb, a stride at a time, and return every reading."""
    readings: list[Reading] = []
    for k in range(1, round(until_s / stride_s) + 1):
        plant.write(TrackCommand(t_s=0.0, left_m_s=left, right_m_s=right), SeatCommand(t_s=0.0, rate_m_s=0.01))
        plant.advance(k * stride_s)
        readings.extend(plant.read())
    return readings


def printed(readings: list[Reading]) -> list[str]:
    """Return readings to the last bit."""
    return [
        repr((r.t_s, *r.orientation, *r.angular_velocity_rad_s, *r.linear_acceleration_m_s2))
        if isinstance(r, ImuSample)
        else repr(r)
        for r in readings
        if not hasattr(r, "nosings_B")
    ]


def recorded(start: Opened) -> Plant:
    """Return the run of a simulator as a recording."""
    plant = ReplayPlant([(reading.t_s, reading) for reading in climb(start(), 2.0)])
    plant.start()
    return plant


class GuardReports:
    """Reports of the guard process: an inertial sensor at 100 Hz, each sample 4 ms late, for a loop that wakes 15 ms late."""

    def __init__(self) -> None:
        self.now_s, self.sent, self.waiting, self.holding = 50.0, 0, list[ImuSample](), None
        self.called: list[str] = []

    def sleep(self, for_s: float) -> None:
        self.now_s += for_s + 0.015

    def receive(self) -> None:
        while TICK_S * self.sent + 0.004 <= self.now_s - 50.0:
            self.waiting.append(imu(TICK_S * self.sent))
            self.sent += 1

    def readings(self, until_s: float) -> list[ImuSample]:
        taken = [sample for sample in self.waiting if sample.t_s <= until_s]
        self.waiting = self.waiting[len(taken) :]
        return taken

    def hold(self, cause: str) -> None:
        self.called.append(cause)

    def close(self) -> None:
        self.called.append("close")


def real(monkeypatch: pytest.MonkeyPatch) -> RobotPlant:
    client = GuardReports()
    clock = SimpleNamespace(monotonic=lambda: client.now_s, sleep=client.sleep)
    monkeypatch.setattr("treadline.hardware._robot_plant.time", clock)
    plant = RobotPlant(client, 50.0)  # type: ignore[arg-type]
    plant.start()
    return plant


@pytest.mark.parametrize("kind", ["simulated", "recorded", "real"])
def test_each_reading_comes_once_in_order_and_none_from_the_future(
    started: Opened, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test: two seconds, tick by tick, commands with and without a flipper's. Expected result: also nothing at a second read."""
    plant: Plant = {"simulated": started, "recorded": lambda: recorded(started), "real": lambda: real(monkeypatch)}[kind]()
    newest: dict[type, float] = {}
    for tick in range(200):
        plant.advance(TICK_S * tick)
        for reading in plant.read():
            assert newest.get(type(reading), -1.0) < reading.t_s <= TICK_S * tick + ROUNDING_S
            newest[type(reading)] = reading.t_s
        assert not plant.read()
        flipper: tuple[Any, ...] = (FlipperCommand(t_s=TICK_S * tick, rate_rad_s=0.1),) if tick % 2 else ()
        command = TrackCommand(t_s=TICK_S * tick, left_m_s=0.2, right_m_s=0.2)
        plant.write(command, SeatCommand(t_s=TICK_S * tick, rate_m_s=0.0), *flipper)
    assert newest[ImuSample] >= 1.97  # the sensor on the robot is 4 ms late


def test_a_recording_of_a_plant_reads_as_the_plant_did(started: Opened) -> None:
    plant = recorded(started)
    plant.advance(2.0)
    assert printed(list(plant.read())) == printed(climb(started(), 2.0))


def test_a_robot_is_waited_for_and_its_brake_reaches_the_guard_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = real(monkeypatch)
    client: Any = plant._client
    plant.advance(1.0)
    assert 51.0 <= client.now_s < 51.02
    plant.brake()
    plant.close()
    assert client.called == ["the loop stood still", "close"]


def test_the_same_seed_gives_the_same_bits_and_another_does_not(started: Opened) -> None:
    first, again, other = (climb(started(seed), 2.0) for seed in (3, 3, 4))
    assert printed(first) == printed(again)
    assert printed(first) != printed(other)


def test_how_often_the_mission_reads_does_not_change_what_it_reads(started: Opened) -> None:
    assert printed(climb(started(), 2.0, stride_s=0.25)) == printed(climb(started(), 2.0, stride_s=0.5))


def test_a_second_start_repeats_the_physics_of_the_first(started: Opened) -> None:
    plant = started()
    climb(plant, 1.0)
    first = list(plant.truth())
    plant.start()
    climb(plant, 1.0)
    assert list(plant.truth()) == first


def test_the_pose_of_the_chassis_agrees_with_the_place_and_heading_on_the_stair(started: Opened) -> None:
    """Test: position, yaw, pitch and roll of the ground truth. Expected: the same x, y and heading in S, derived separately."""
    plant = started()
    climb(plant, 1.0)
    stair = as_designed(Stair(rise_m=0.30 * math.tan(28.0 * DEG), width_m=4.0))
    truth = plant.truth()
    assert abs(truth[-1].roll_rad) > 0.5 * DEG  # 5° of heading on 28° raise one side: the order of the rotations matters
    for sample in truth:
        place_S = stair.R_WS.T @ (np.array([sample.chassis_x_m, sample.chassis_y_m, sample.chassis_z_m]) - stair.p_WS)
        attitude = attitude_of(*(np.array(angle) for angle in (sample.yaw_rad, sample.pitch_rad, sample.roll_rad)))
        R_SB = stair.R_WS.T @ rotation_of(attitude)
        # Rounding: a few units in the last place of metres and of radians.
        np.testing.assert_allclose(place_S[:2], (sample.x_m, sample.y_m), atol=1e-12)
        assert math.atan2(R_SB[1, 0], R_SB[1, 1]) == pytest.approx(sample.heading_rad, abs=1e-12)


def test_every_sensor_reports_at_its_rate_from_zero_and_in_time_order(started: Opened) -> None:
    readings = climb(started(), 2.0)
    kinds = ((ImuSample, 0.01), (SeatReading, 0.01), (TrackReading, 0.01), (FlipperReading, 0.01), (HeadingMeasurement, 0.1))
    for kind, period_s in kinds:
        times = np.array([reading.t_s for reading in readings if isinstance(reading, kind)])
        np.testing.assert_allclose(times, period_s * np.arange(round(2.0 / period_s) + 1), atol=1e-9)
    stamps = [reading.t_s for reading in readings]
    assert stamps == sorted(stamps)


def test_an_ideal_imu_reports_ground_truth(started: Opened) -> None:
    plant = started(sensors=Sensors(imu="ideal"))
    samples = [reading for reading in climb(plant, 2.0, stride_s=2.0) if isinstance(reading, ImuSample)]
    rates = [sample.angular_velocity_rad_s[1] for sample in samples]
    np.testing.assert_allclose(rates, [-sample.pitch_rate_rad_s for sample in plant.truth()], atol=1e-12)
    forces = [float(np.linalg.norm(sample.linear_acceleration_m_s2)) for sample in samples]
    # At rest the specific force is gravity alone; half a percent is what settling leaves. Contacts of ODE creep and jump.
    force, share = (forces[0], 5e-3) if isinstance(plant, MujocoPlant) else (np.mean(forces), 0.02)
    assert force == pytest.approx(9.81, rel=share)


def test_a_mismatched_belt_is_seen_by_truth_and_not_by_the_drive(started: Opened) -> None:
    plant = started(mismatch=0.02)
    readings = climb(plant, 3.0)
    last = plant.truth()[-1]
    drive = [reading for reading in readings if isinstance(reading, TrackReading)][-1]
    assert last.right_m_s / last.left_m_s == pytest.approx(1.02, rel=1e-6)
    assert drive.right_m_s == pytest.approx(drive.left_m_s, rel=1e-6)


def test_the_brake_stops_the_belts_within_a_tenth_of_a_second(started: Opened) -> None:
    plant = started()
    climb(plant, 1.0)
    plant.write(TrackCommand.stop(1.0), SeatCommand(t_s=1.0, rate_m_s=0.0))
    plant.advance(1.1)
    last = plant.truth()[-1]
    assert (last.left_m_s, last.right_m_s) == (0.0, 0.0)


def test_the_right_belt_ahead_turns_the_chair_left(started: Opened) -> None:
    # With 0.62 along a chair square to this flight goes straight with its slow belt; with 0.9 every nosing phase turns it.
    plant = started(heading_deg=0.0, mismatch=0.0, along=0.9)
    climb(plant, 3.0, left=0.1, right=0.3)
    last = plant.truth()[-1]
    # Quasi-static Coulomb friction gives 32°.
    assert last.heading_rad > 5.0 * DEG
    assert last.heading_rate_rad_s > 0.0


def test_the_flipper_follows_its_command_within_its_limits(started: Opened) -> None:
    plant = started()
    stop, seat = TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0)
    plant.write(stop, seat, FlipperCommand(t_s=0.0, rate_rad_s=0.2))
    plant.advance(1.0)
    angles = [reading.angle_rad for reading in plant.read() if isinstance(reading, FlipperReading)]
    assert angles[0] == pytest.approx(40.0 * DEG, abs=0.2 * DEG)
    assert angles[-1] - angles[0] == pytest.approx(0.2, abs=0.02)


def test_the_flippers_torque_bears_its_weight_in_the_air_and_presses_on_the_nosings(started: Opened) -> None:
    """Test: the motor's mean torque. Expected in the air: 3 kg at half of 0.45 m, by the flipper's angle to the horizon."""
    plant = started(heading_deg=0.0)
    angle_rad, torques_n_m = 40.0 * DEG, []
    for target_rad in (15.0 * DEG, -3.0 * DEG):
        for _ in range(300):
            rate = min(max(3.0 * (target_rad - angle_rad), -15.0 * DEG), 15.0 * DEG)
            now_s = 0.01 * len(torques_n_m)
            still = TrackCommand(t_s=now_s, left_m_s=1e-4, right_m_s=1e-4)  # no stop: a brake would hold the flipper too
            plant.write(still, SeatCommand(t_s=now_s, rate_m_s=0.0), FlipperCommand(t_s=now_s, rate_rad_s=rate))
            plant.advance(now_s + 0.01)
            reading = [reading for reading in plant.read() if isinstance(reading, FlipperReading)][-1]
            angle_rad = reading.angle_rad
            torques_n_m.append(reading.torque_n_m)
    weight_n_m = 3.0 * 9.81 * 0.5 * 0.45 * math.cos((28.0 + 15.0) * DEG)
    # Noise of the reading: 2 N·m, 0.3 N·m in a mean of 50.
    assert np.mean(torques_n_m[250:300]) == pytest.approx(weight_n_m, abs=1.0)
    assert np.mean(torques_n_m[550:600]) < -20.0


def test_a_command_that_is_not_finite_is_refused(started: Opened) -> None:
    with pytest.raises(SimulationDiverged, match="not finite"):
        started().write(TrackCommand(t_s=0.0, left_m_s=math.nan, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
