"""The loop that drives: sensors in, belt and seat commands out, 100 times a second.

Paper: Fig. 2 and Fig. 7, Table I (100 Hz IMU, 10 Hz camera, 4 Hz control). One tick, top to bottom, is the block
diagram::

    Plant.read() ── ImuSample ───────────────► heading filter ── HeadingEstimate ──► driver (4 Hz)
         │                                         ▲                                    │ TrackCommand
         ├─── RgbdFrame ──► stair detector ── HeadingMeasurement                        ▼
         └─── SeatReading ──► leveller ── SeatCommand ───────────────────────────► guard ──► Plant.write()

The mission knows what sensors, the chair's file and the operator tell it, and nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from treadline.angles import rotation_of
from treadline.mission.drivers import Driver
from treadline.mission.guard import Guard
from treadline.mission.rates import TICK_S, Rate
from treadline.ports import Plant
from treadline.signals import (
    ArmCommand,
    Event,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    Reading,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    TrackCommand,
)

Signal = Reading | HeadingEstimate | TrackCommand | SeatCommand | ArmCommand | Event
"""All that a run's log may hold, truth aside."""

DOWN_W = np.array([0.0, 0.0, -1.0])


@runtime_checkable
class Detector(Protocol):
    """Vision: a frame and the direction of gravity in, a heading out."""

    def step(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> HeadingMeasurement | None:
        """Return the heading seen in one frame, or None."""


@runtime_checkable
class Estimator(Protocol):
    """Fusion: IMU samples and headings in, the heading now out."""

    def step(self, signal: ImuSample | HeadingMeasurement) -> HeadingEstimate | None:
        """Return the heading after one more signal, or None before the first heading."""


@runtime_checkable
class SeatLeveller(Protocol):
    """The seat's own loop."""

    def step(self, reading: SeatReading) -> SeatCommand:
        """Return the actuator's rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks:
    """The boxes of Fig. 2; memory lives inside them."""

    detector: Detector
    estimator: Estimator
    driver: Driver
    leveller: SeatLeveller
    guard: Guard


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """What one tick ended with."""

    t_s: float
    estimate: HeadingEstimate | None
    tracks: TrackCommand
    seat: SeatCommand
    proposed: bool
    """Whether the driver spoke at this tick."""


def _no_log(signal: Signal) -> None:
    del signal


class Mission:
    """Turns the blocks, one tick at a time."""

    def __init__(self, plant: Plant, blocks: Blocks, log: Callable[[Signal], None] = _no_log) -> None:
        self._plant = plant
        self._blocks = blocks
        self._log = log
        self._tick = 0
        self._control = Rate(blocks.driver.period_s)
        self._estimate: HeadingEstimate | None = None
        self._gravity_B: Float[np.ndarray, " 3"] | None = None
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        plant.start()

    def tick(self) -> Tick:
        """Advance the plant to the next tick, feel, decide, act."""
        t_s = self._tick * TICK_S
        self._plant.advance(t_s)
        for reading in self._plant.read():
            self._log(reading)
            self._feel(reading)

        blocks = self._blocks
        proposed = self._control.due(self._tick)
        if proposed:
            # A held chair does not answer its belts: a driver that went on would learn from that.
            known = self._estimate if blocks.guard.holding is None else None
            blocks.guard.propose(blocks.driver.step(known, t_s))
        tracks = blocks.guard.step(t_s, self._estimate)

        self._plant.write(tracks, self._seat)
        self._tell(tracks, proposed=proposed)
        self._tick += 1
        return Tick(t_s=t_s, estimate=self._estimate, tracks=tracks, seat=self._seat, proposed=proposed)

    def _feel(self, reading: Reading) -> None:
        match reading:
            case ImuSample():
                self._feel_motion(reading)
            case RgbdFrame():
                self._blocks.guard.frame_arrived(reading.t_s)
                measurement = self._blocks.detector.step(reading, self._gravity_in(reading))
                if measurement is not None:
                    self._log(measurement)
                    self._feel_heading(measurement)
            case HeadingMeasurement():
                self._blocks.guard.frame_arrived(reading.t_s)
                self._feel_heading(reading)
            case SeatReading():
                self._seat = self._blocks.guard.pass_seat(self._blocks.leveller.step(reading))
            case OperatorInput():
                self._blocks.guard.operator(reading)
            case _:
                pass

    def _feel_motion(self, sample: ImuSample) -> None:
        if not (np.isfinite(sample.orientation).all() and np.isfinite(sample.angular_velocity_rad_s).all()):
            return  # the guard sees the silence
        self._blocks.guard.imu_arrived(sample.t_s)
        self._gravity_B = rotation_of(sample.orientation).T @ DOWN_W
        self._estimate = self._blocks.estimator.step(sample)

    def _feel_heading(self, measurement: HeadingMeasurement) -> None:
        self._blocks.guard.stair_seen(measurement.t_s)
        self._estimate = self._blocks.estimator.step(measurement)

    def _gravity_in(self, frame: RgbdFrame) -> Float[np.ndarray, " 3"] | None:
        return None if self._gravity_B is None else frame.camera.R_BC.T @ self._gravity_B

    def _tell(self, tracks: TrackCommand, *, proposed: bool) -> None:
        if self._estimate is not None:
            self._log(self._estimate)
        if proposed or tracks.brake:
            self._log(tracks)
        self._log(self._seat)
        for event in self._blocks.guard.take_events():
            self._log(event)
