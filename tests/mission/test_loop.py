"""The loop: order of a tick, rates, and that truth cannot reach it."""

from collections.abc import Sequence

import numpy as np
import pytest

from treadline.mission.drivers import ConstantSpeed
from treadline.mission.guard import Guard, GuardConfig
from treadline.mission.loop import Blocks, Mission
from treadline.mission.rates import Rate
from treadline.signals import (
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    Reading,
    SeatCommand,
    SeatReading,
    TrackCommand,
)

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class RecordedPlant:
    """Plays sensor samples and keeps what is written; it knows no truth."""

    def __init__(self, readings: Sequence[Reading]) -> None:
        self._readings = list(readings)
        self._t_s = 0.0
        self.written: list[tuple[TrackCommand, SeatCommand]] = []

    def start(self) -> None:
        self._t_s = 0.0

    def advance(self, until_s: float) -> None:
        self._t_s = until_s

    def read(self) -> Sequence[Reading]:
        due = [reading for reading in self._readings if reading.t_s <= self._t_s + 1e-9]
        self._readings = self._readings[len(due) :]
        return due

    def write(self, tracks: TrackCommand, seat: SeatCommand) -> None:
        self.written.append((tracks, seat))

    def close(self) -> None:
        pass


class Counting:
    """Stands for every block and counts its calls."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def step(self, signal: object, *_: object) -> HeadingEstimate | SeatCommand:
        self.calls.append(type(signal).__name__)
        if isinstance(signal, SeatReading):
            return SeatCommand(t_s=signal.t_s, rate_m_s=0.01)
        t_s = signal.t_s if isinstance(signal, ImuSample | HeadingMeasurement) else 0.0
        return HeadingEstimate(t_s=t_s, heading_rad=0.1, heading_rate_rad_s=0.0, sigma_rad=0.01, source="vision")


def imu(t_s: float, rate_rad_s: float = 0.0) -> ImuSample:
    return ImuSample(
        t_s=t_s,
        orientation=LEVEL,
        angular_velocity_rad_s=np.array([0.0, 0.0, rate_rad_s]),
        linear_acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
    )


def stream(seconds: float) -> list[Reading]:
    readings: list[Reading] = []
    for k in range(round(seconds * 100) + 1):
        t_s = k / 100
        readings.append(imu(t_s, 0.02 * np.sin(t_s)))
        readings.append(SeatReading(t_s=t_s, pitch_rad=0.01 * np.cos(3 * t_s), stroke_m=0.2))
        if k % 10 == 0:
            readings.append(HeadingMeasurement(t_s=t_s, heading_rad=0.02 * (1 - np.cos(t_s)), sigma_rad=0.004, edge_count=6))
    return readings


def counting_mission(plant: RecordedPlant) -> tuple[Mission, Counting, Counting]:
    estimator, leveller = Counting(), Counting()
    blocks = Blocks(
        detector=Counting(),  # type: ignore[arg-type]
        estimator=estimator,  # type: ignore[arg-type]
        driver=ConstantSpeed(0.2, 0.25),
        leveller=leveller,  # type: ignore[arg-type]
        guard=Guard(GuardConfig()),
    )
    return Mission(plant, blocks), estimator, leveller


def test_each_block_runs_at_its_own_rate() -> None:
    mission, estimator, leveller = counting_mission(RecordedPlant(stream(2.0)))
    ticks = [mission.tick() for _ in range(200)]
    assert sum(tick.proposed for tick in ticks) == 8  # 4 Hz
    assert estimator.calls.count("ImuSample") == 200
    assert estimator.calls.count("HeadingMeasurement") == 20
    assert leveller.calls.count("SeatReading") == 200


def test_a_tick_acts_on_what_was_read_in_the_same_tick() -> None:
    plant = RecordedPlant(stream(0.1))
    mission, _, _ = counting_mission(plant)
    first = mission.tick()
    assert first.estimate is not None
    assert plant.written[0][0].left_m_s == 0.2
    assert plant.written[0][1].rate_m_s == 0.01


def test_a_nan_from_the_imu_is_silence_and_holds() -> None:
    readings = [
        imu(reading.t_s, np.nan) if isinstance(reading, ImuSample) and reading.t_s > 0.5 else reading for reading in stream(1.0)
    ]
    plant = RecordedPlant(readings)
    mission, _, _ = counting_mission(plant)
    for _ in range(100):
        mission.tick()
    assert plant.written[-1][0].brake
    assert all(np.isfinite([tracks.left_m_s, tracks.right_m_s]).all() for tracks, _ in plant.written)


def test_a_period_that_is_no_multiple_of_the_tick_is_refused() -> None:
    with pytest.raises(ValueError, match="no multiple"):
        Rate(0.255)
