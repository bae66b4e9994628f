"""The loop: order of a tick, rates, and that truth cannot reach it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from world import imu, limits

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.ports import Reading
from treadline.core.signals import (
    FlipperCommand,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    SeatCommand,
    SeatReading,
    TrackCommand,
)
from treadline.guard import Guard
from treadline.mission._blocks import Rate
from treadline.mission.belt_controllers import ConstantSpeed, Driver
from treadline.mission.loop import Blocks, Mission, Signal
from treadline.mission.planner import Cruise, Planner


class RecordedPlant:
    """Plays sensor samples and keeps what is written; it knows no truth."""

    def __init__(self, readings: Sequence[Reading]) -> None:
        self._readings = list(readings)
        self._t_s = 0.0
        self.written: list[tuple[TrackCommand, SeatCommand]] = []
        self.flippers: list[FlipperCommand | None] = []

    def start(self) -> None:
        self._t_s = 0.0

    def advance(self, until_s: float) -> None:
        self._t_s = until_s

    def read(self) -> Sequence[Reading]:
        due = [reading for reading in self._readings if reading.t_s <= self._t_s + 1e-9]
        self._readings = self._readings[len(due) :]
        return due

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        self.written.append((tracks, seat))
        self.flippers.append(flipper)

    def close(self) -> None:
        pass


class Counting:
    """Stands for every block and counts its calls; as a detector it sees a square stair in each frame."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.health = None
        self.rejected_count = 0

    def step(self, signal: object, *_: object) -> HeadingEstimate | SeatCommand:
        self.calls.append(type(signal).__name__)
        if isinstance(signal, SeatReading):
            return SeatCommand(t_s=signal.t_s, rate_m_s=0.01)
        t_s = signal.t_s if isinstance(signal, ImuSample | HeadingMeasurement) else 0.0
        return HeadingEstimate(t_s=t_s, heading_rad=0.1, heading_rate_rad_s=0.0, sigma_rad=0.01, source="vision")

    def see(self, frame: RgbdFrame, gravity_C: np.ndarray | None = None) -> "Square":
        assert gravity_C is not None
        self.calls.append("RgbdFrame")
        return Square(frame.t_s)


class Square:
    """What a frame says of a stair that the chair is square to."""

    stair_map = None

    def __init__(self, t_s: float) -> None:
        self.measurement = HeadingMeasurement(t_s=t_s, heading_rad=0.0, sigma_rad=0.004, edge_count=6)


def stream(seconds: float) -> list[Reading]:
    readings: list[Reading] = []
    for k in range(round(seconds * 100) + 1):
        t_s = k / 100
        readings.append(imu(t_s, rates_rad_s=(0.0, 0.0, 0.02 * np.sin(t_s))))
        readings.append(SeatReading(t_s=t_s, pitch_rad=0.01 * np.cos(3 * t_s), stroke_m=0.2))
        if k % 10 == 0:
            readings.append(HeadingMeasurement(t_s=t_s, heading_rad=0.02 * (1 - np.cos(t_s)), sigma_rad=0.004, edge_count=6))
    return readings


def counting_mission(
    plant: RecordedPlant,
    planner: Planner | None = None,
    driver: Driver | None = None,
    log: Callable[[Signal], object] = repr,
) -> tuple[Mission, Counting, Counting]:
    estimator, leveller = Counting(), Counting()
    blocks = Blocks(
        detector=estimator,
        estimator=estimator,  # type: ignore[arg-type]
        planner=planner or Cruise(0.2),
        driver=driver or ConstantSpeed(0.2, 0.25),
        leveller=leveller,  # type: ignore[arg-type]
        guard=Guard(limits(watches_motion=False)),
    )
    return Mission(plant, blocks, lambda signal, _: log(signal)), estimator, leveller


def drive(ticks: int, plant: RecordedPlant, *blocks: Any, **options: Any) -> Counting:
    """Run a mission for some ticks, and return its detector and estimator."""
    mission, detector, _ = counting_mission(plant, *blocks, **options)
    for _ in range(ticks):
        mission.tick()
    return detector


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


def test_what_the_guard_makes_of_an_old_command_is_in_the_log() -> None:
    """Test: the driver dies at 0.5 s. Expected result: each step of the ramp down is logged, and the brake, as they are written."""

    class Dying(ConstantSpeed):
        def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan | None = None) -> TrackCommand:
            return replace(super().step(estimate, t_s, plan), t_s=min(t_s, 0.5))

    logged: list[Any] = []
    plant = RecordedPlant(stream(1.5))
    drive(150, plant, driver=Dying(0.2, 0.25), log=logged.append)
    recorded = [(signal.left_m_s, signal.brake) for signal in logged if isinstance(signal, TrackCommand)]
    written = [(tracks.left_m_s, tracks.brake) for tracks, _ in plant.written]
    assert {value for value, _ in recorded} == {value for value, _ in written}
    assert len({value for value, _ in recorded}) > 20  # a ramp of 0.37 s
    assert recorded[-1] == (0.0, True)


def frame(t_s: float, brightness: int) -> RgbdFrame:
    rng = np.random.default_rng(brightness)
    rgb = rng.integers(0, brightness, size=(24, 32, 3), dtype=np.uint8)
    depth = rng.uniform(1.0, 2.0, size=(24, 32)).astype(np.float32)
    camera = PinholeCamera(width_px=32, height_px=24, fx_px=30.0, fy_px=30.0, cx_px=15.5, cy_px=11.5)
    return RgbdFrame(t_s=t_s, rgb=rgb, depth_m=depth, camera=camera)


def test_a_frame_that_repeats_itself_is_not_looked_at() -> None:
    readings = [*stream(0.35), frame(0.1, 200), frame(0.2, 200), frame(0.3, 210)]
    detector = drive(35, RecordedPlant(sorted(readings, key=lambda reading: reading.t_s)))
    assert detector.calls.count("RgbdFrame") == 2


def test_a_period_that_is_no_multiple_of_the_tick_is_refused() -> None:
    with pytest.raises(ValueError, match="no multiple"):
        Rate(0.255)
