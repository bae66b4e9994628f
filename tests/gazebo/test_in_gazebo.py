"""The plant in Gazebo keeps the promises of the port, and climbs. Needs the environment: ``make test-gazebo`` runs these."""

import json
import math
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.angles import DEG
from treadline.errors import GazeboError, SimulationDiverged
from treadline.experiments.shipped import shipped_controller
from treadline.experiments.traverse import traverse
from treadline.gazebo import GazeboPlant, find_environment, open_gazebo
from treadline.mechanics.chair import read_chair
from treadline.ports import TruthPlant
from treadline.scenario import Chair, Control, Drive, Scenario, Sensors, Stair, Start
from treadline.signals import (
    ArmCommand,
    ArmReading,
    HeadingMeasurement,
    ImuSample,
    Reading,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.sim import open_plant

pytestmark = pytest.mark.skipif(os.environ.get("TREADLINE_TEST_GAZEBO") != "1", reason="make test-gazebo runs these")

Opened = Callable[..., GazeboPlant]


def flight(*, sensors: Sensors | None = None, mismatch: float = 0.01, heading_deg: float = 5.0) -> Scenario:
    return Scenario(
        stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), walls="none", width_m=4.0),
        chair=Chair(belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        control=Control(vision="truth"),
        sensors=sensors or Sensors(),
    )


@pytest.fixture
def started() -> Iterator[Opened]:
    """Return what opens a plant at its start; all are closed at the end."""
    with ExitStack() as stack:

        def start(seed: int = 3, **options: object) -> GazeboPlant:
            plant = open_gazebo(flight(**options), seed)  # type: ignore[arg-type]
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
        repr((r.t_s, *r.orientation.tolist(), *r.angular_velocity_rad_s.tolist(), *r.linear_acceleration_m_s2.tolist()))
        if isinstance(r, ImuSample)
        else repr(r)
        for r in readings
        if not hasattr(r, "nosings_B")
    ]


def test_the_plant_is_a_truth_plant(started: Opened) -> None:
    assert isinstance(started(), TruthPlant)


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


def test_every_sensor_reports_at_its_rate_from_zero_and_in_time_order(started: Opened) -> None:
    readings = climb(started(), 2.0)
    kinds = ((ImuSample, 0.01), (SeatReading, 0.01), (TrackReading, 0.01), (ArmReading, 0.01), (HeadingMeasurement, 0.1))
    for kind, period_s in kinds:
        times = np.array([reading.t_s for reading in readings if isinstance(reading, kind)])
        np.testing.assert_allclose(times, period_s * np.arange(round(2.0 / period_s) + 1), atol=1e-9)
    stamps = [reading.t_s for reading in readings]
    assert stamps == sorted(stamps)


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


def test_an_ideal_imu_tells_the_truth(started: Opened) -> None:
    plant = started(sensors=Sensors(imu="ideal"))
    samples = [reading for reading in climb(plant, 2.0) if isinstance(reading, ImuSample)]
    truth = plant.truth()
    rate = [sample.angular_velocity_rad_s[1] for sample in samples]
    np.testing.assert_allclose(rate, [-sample.pitch_rate_rad_s for sample in truth], atol=1e-12)
    # At rest the specific force is gravity alone; contacts of ODE creep and jump, by a few percent of it.
    force = np.mean([np.linalg.norm(sample.linear_acceleration_m_s2) for sample in samples])
    assert force == pytest.approx(9.81, rel=0.02)


def test_a_gyro_at_rest_has_the_bias_and_noise_of_its_data_sheet(started: Opened) -> None:
    plant = started()
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(20.0)
    rates = np.array([r.angular_velocity_rad_s for r in plant.read() if isinstance(r, ImuSample)])[200:]
    # 0.0354 °/s of noise, and on top what ODE's contacts make a chair tremble by, most of it in pitch: it creeps downhill.
    assert np.all(rates.std(axis=0) / DEG > 0.03)
    assert np.all(rates.std(axis=0) / DEG < 0.12)
    assert np.abs(rates.mean(axis=0)).max() < 0.085 * DEG


def test_the_chair_begins_where_the_other_simulator_puts_it(started: Opened) -> None:
    plant, other = started(), open_plant(flight(), 3)
    other.start()
    here, there = plant.truth()[0], other.truth()[0]
    assert here.heading_rad == pytest.approx(there.heading_rad, abs=0.1 * DEG)
    assert (here.pitch_rad, here.roll_rad) == pytest.approx((there.pitch_rad, there.roll_rad), abs=0.1 * DEG)
    assert (here.x_m, here.y_m) == pytest.approx((there.x_m, there.y_m), abs=0.005)
    assert here.seat_pitch_rad == pytest.approx(there.seat_pitch_rad, abs=0.1 * DEG)


def test_the_right_belt_ahead_turns_the_chair_left(started: Opened) -> None:
    plant = started(heading_deg=0.0, mismatch=0.0)
    climb(plant, 3.0, left=0.1, right=0.3)
    last = plant.truth()[-1]
    assert last.heading_rad > 5.0 * DEG
    assert last.heading_rate_rad_s > 0.0


def test_the_arm_follows_its_order_within_its_limits(started: Opened) -> None:
    plant = started()
    stop, seat = TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0)
    plant.write(stop, seat, ArmCommand(t_s=0.0, rate_rad_s=0.2))
    plant.advance(1.0)
    angles = [reading.angle_rad for reading in plant.read() if isinstance(reading, ArmReading)]
    assert angles[0] == pytest.approx(40.0 * DEG, abs=0.2 * DEG)
    assert angles[-1] - angles[0] == pytest.approx(0.2, abs=0.02)


def test_a_command_that_is_not_finite_is_refused(started: Opened) -> None:
    with pytest.raises(SimulationDiverged, match="not finite"):
        started().write(TrackCommand(t_s=0.0, left_m_s=math.nan, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))


def test_a_gzserver_that_dies_ends_the_run_in_a_line(started: Opened) -> None:
    plant = started()
    assert plant._server is not None
    assert plant._server._process is not None
    plant._server._process.kill()
    with pytest.raises(GazeboError, match=r"gzserver died \(exit code -9\)") as raised:
        plant.advance(1.0)
    assert "\n" not in str(raised.value)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = int(taken.getsockname()[1])
        plant = GazeboPlant(flight(), 0, read_chair("wheelchair"), find_environment(), port=port)
        with pytest.raises(GazeboError, match=rf"port {port} is taken"):
            plant.start()


def test_a_plugin_for_another_gazebo_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    # The loader's word for a plugin that it cannot link against this Gazebo.
    monkeypatch.setattr("treadline.gazebo.plant.PLUGIN", "lib/x86_64-linux-gnu/libnothing.so")
    plant = GazeboPlant(flight(), 0, read_chair("wheelchair"), find_environment())
    with pytest.raises(GazeboError, match=r"does not load the plugin: .*libnothing.so.*build it"):
        plant.start()


def test_nothing_is_left_behind(started: Opened) -> None:
    plant = started()
    folder = plant._server._folder  # type: ignore[union-attr]
    assert folder.is_dir()
    plant.close()
    assert not folder.exists()


FRAMES = """
[stair]
steps = 14
[start]
place = "flight"
step = 4
heading_deg = 10
[sensors]
camera = "kinect1"
"""


def treadline(*words: object) -> dict[str, Any]:
    """Run a command as a user does: compiled code is then read back, not compiled again under the shape checker."""
    command = [sys.executable, "-m", "treadline", *map(str, words), "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_a_bag_recorded_in_gazebo_is_replayed_to_the_heading_of_then(tmp_path: Path) -> None:
    (tmp_path / "frames.toml").write_text(FRAMES)
    bag = tmp_path / "drive.bag"
    driven = treadline("nodes", tmp_path / "frames.toml", "--plant", "gazebo", "--duration", "4", "--out", bag)
    assert driven["verdict"] == "time_up"
    assert abs(driven["final_heading_deg"]) < 4.0
    for kind in ("db3", "mcap"):
        treadline("record", bag, "--out", bag.with_suffix(f".{kind}"))
    for kind in ("bag", "db3", "mcap"):
        again = treadline("replay", bag.with_suffix(f".{kind}"), "--out", tmp_path / kind)
        assert again["sees"] == "images"
        assert again["accepted"] > 30
        assert again["rms_difference_deg"] < 1e-9


@pytest.mark.parametrize("heading_deg", [30.0, -30.0])
def test_a_chair_askew_is_turned_square_and_climbs_for_20_s(heading_deg: float) -> None:
    scenario = Scenario(
        stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), width_m=2.4, steps=30),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        drive=Drive(duration_s=20.0),
        sensors=Sensors(camera="statistical", gravity_error_deg=0.5),
    )
    run = traverse(scenario, controller=shipped_controller("wheelchair"), seed=0, open_plant=open_gazebo)
    assert run.verdict == "time_up"
    assert abs(run.trace["heading_rad"][run.trace["t_s"] > 10.0]).max() < 3.0 * DEG
    # 20 s at 0.2 m/s, less the turn's.
    assert 2.5 < run.scores.climbed_m < 4.2
    assert run.scores.roll_back_m < 0.05
