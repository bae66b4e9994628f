"""The plant keeps its promises as a port: determinism, order, sensors apart, divergence found."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from treadline.angles import DEG
from treadline.errors import SimulationDiverged
from treadline.ports import TruthPlant
from treadline.scenario import Chair, Control, Scenario, Sensors, Stair, Start
from treadline.signals import (
    HeadingMeasurement,
    ImuSample,
    Reading,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.sim import MujocoPlant, open_plant


def started(seed: int = 3, *, sensors: Sensors | None = None, mismatch: float = 0.01) -> MujocoPlant:
    """Return a plant at its start, on a flight of 28°."""
    scenario = Scenario(
        stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), walls="none", width_m=4.0),
        chair=Chair(belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=5.0),
        control=Control(vision="truth"),
        sensors=sensors or Sensors(),
    )
    plant = open_plant(scenario, seed)
    plant.start()
    return plant


def climb(plant: MujocoPlant, until_s: float, *, stride_s: float = 0.25) -> list[Reading]:
    """Climb at 0.2 m/s, a stride at a time, and return every reading."""
    readings: list[Reading] = []
    for k in range(1, round(until_s / stride_s) + 1):
        plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.01))
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
    ]


def test_the_plant_is_a_truth_plant() -> None:
    assert isinstance(started(), TruthPlant)


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    first, again, other = (climb(started(seed), 2.0) for seed in (3, 3, 4))
    assert printed(first) == printed(again)
    assert printed(first) != printed(other)


def test_how_often_the_mission_reads_does_not_change_what_it_reads() -> None:
    assert printed(climb(started(), 2.0, stride_s=0.25)) == printed(climb(started(), 2.0, stride_s=0.5))


def test_a_second_start_repeats_the_physics_of_the_first() -> None:
    plant = started()
    climb(plant, 1.0)
    first = list(plant.truth())
    plant.start()
    climb(plant, 1.0)
    assert list(plant.truth()) == first


def test_every_sensor_reports_at_its_rate_from_zero_and_in_time_order() -> None:
    readings = climb(started(), 2.0)
    for kind, period_s in ((ImuSample, 0.01), (SeatReading, 0.01), (TrackReading, 0.01), (HeadingMeasurement, 0.1)):
        times = np.array([reading.t_s for reading in readings if isinstance(reading, kind)])
        np.testing.assert_allclose(times, period_s * np.arange(round(2.0 / period_s) + 1), atol=1e-9)
    stamps = [reading.t_s for reading in readings]
    assert stamps == sorted(stamps)


def test_a_mismatched_belt_is_seen_by_truth_and_not_by_the_drive() -> None:
    plant = started(mismatch=0.02)
    readings = climb(plant, 3.0)
    last = plant.truth()[-1]
    drive = [reading for reading in readings if isinstance(reading, TrackReading)][-1]
    assert last.right_m_s / last.left_m_s == pytest.approx(1.02, rel=1e-6)
    assert drive.right_m_s == pytest.approx(drive.left_m_s, rel=1e-6)


def test_the_brake_stops_the_belts_within_a_tenth_of_a_second() -> None:
    plant = started()
    climb(plant, 1.0)
    plant.write(TrackCommand.stop(1.0), SeatCommand(t_s=1.0, rate_m_s=0.0))
    plant.advance(1.1)
    last = plant.truth()[-1]
    assert (last.left_m_s, last.right_m_s) == (0.0, 0.0)


def test_an_ideal_imu_tells_the_truth() -> None:
    plant = started(sensors=Sensors(imu="ideal"))
    samples = [reading for reading in climb(plant, 2.0) if isinstance(reading, ImuSample)]
    truth = plant.truth()
    rate = [sample.angular_velocity_rad_s[1] for sample in samples]
    np.testing.assert_allclose(rate, [-sample.pitch_rate_rad_s for sample in truth], atol=1e-12)
    # At rest on 28° the specific force is gravity alone; half a percent is what settling leaves.
    assert float(np.linalg.norm(samples[0].linear_acceleration_m_s2)) == pytest.approx(9.81, rel=5e-3)


def test_a_gyro_at_rest_has_the_bias_and_noise_of_its_data_sheet() -> None:
    plant = started()
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(20.0)
    rates = np.array([r.angular_velocity_rad_s for r in plant.read() if isinstance(r, ImuSample)])[200:]
    # 0.005 °/s/√Hz at 100 Hz is 0.035 °/s RMS; 1800 samples tell it to 5 %, three axes with three sigma.
    assert rates.std(axis=0) / DEG == pytest.approx(np.full(3, 0.0354), rel=0.15)
    # Residual bias 0.02 °/s and wander 0.005 °/s: four sigma.
    assert np.abs(rates.mean(axis=0)).max() < 0.085 * DEG


def lost_number(plant: MujocoPlant) -> None:
    plant._data.qvel[0] = math.nan


def out_of_the_world(plant: MujocoPlant) -> None:
    plant._data.qpos[2] = math.inf


def other_clock(plant: MujocoPlant) -> None:
    plant._model.opt.timestep = 0.004


def too_fast(plant: MujocoPlant) -> None:
    plant._data.qvel[0] = 1e12


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (lost_number, r"not finite at 0\.00…0\.10 s"),
        (out_of_the_world, r"not finite at 0\.00…0\.10 s"),
        (other_clock, r"time went from 0\.000 s to 0\.200 s"),
        (too_fast, r"MuJoCo warned of mjWARN_\w+ at 0\.00…0\.10 s"),
    ],
    ids=["a NaN", "an infinite height", "time at double pace", "light speed"],
)
def test_a_simulator_that_left_physics_gives_no_result(
    fault: Callable[[MujocoPlant], None], message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    plant = started()
    fault(plant)
    with pytest.raises(SimulationDiverged, match=message):
        plant.advance(0.1)
    # Left to itself, MuJoCo writes a log of its warnings where it stands.
    assert not list(tmp_path.iterdir())


def test_a_command_that_is_not_finite_is_refused() -> None:
    with pytest.raises(SimulationDiverged, match="not finite"):
        started().write(TrackCommand(t_s=0.0, left_m_s=math.nan, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
