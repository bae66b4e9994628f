"""The loop that drives: sensors in, belt, flipper and seat commands out, 100 times a second.

Paper: Fig. 2 and Fig. 7, Table I (100 Hz IMU, 10 Hz camera, 4 Hz control). One tick, top to bottom, is the block
diagram::

    Plant.read() ─► guard.admit ─┬─ ImuSample, TrackReading ──────► heading filter ─ HeadingEstimate ─┬──────────┐
                                 ├─ RgbdFrame ─► stair detector ─┬─ HeadingMeasurement ─┘             ▼          ▼
                                 │                               └─ StairMap ─────────────► planner ─ MotionPlan ─► driver (4 Hz)
                                 └─ SeatReading ─► leveller ─ SeatCommand ─┐                 │ FlipperCommand        │ TrackCommand
                                                                           └────────────► guard ◄────────────────┘
                                                                                            └────► Plant.write()

The mission knows what sensors, the chair's file and the operator tell it, and nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from treadline.estimation import HeadingHealth
from treadline.mission.drivers import Driver
from treadline.mission.gravity import GravityAtExposure
from treadline.mission.guard import Guard
from treadline.mission.planner import Planner
from treadline.mission.proposals import Proposals
from treadline.mission.rates import Rate, seat_now
from treadline.perception.quality import quality_of
from treadline.perception.sight import SWEPT_HALF_M
from treadline.ports import Plant
from treadline.signals import (
    TICK_S,
    Event,
    FlipperCommand,
    FlipperReading,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    Reading,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)

Signal = Reading | HeadingEstimate | TrackCommand | SeatCommand | FlipperCommand | MotionPlan | Event
"""All that a run's log may hold, truth aside."""


@runtime_checkable
class Seen(Protocol):
    """What a frame says to the mission."""

    @property
    def measurement(self) -> HeadingMeasurement | None:
        """The heading, if there is one."""

    @property
    def stair_map(self) -> StairMap | None:
        """The stair ahead, if it is seen."""


@runtime_checkable
class Detector(Protocol):
    """Vision: a frame and the direction of gravity in, heading and stair map out."""

    def see(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> Seen:
        """Return what one frame says."""


@runtime_checkable
class Estimator(Protocol):
    """Fusion: IMU samples, belt speeds and headings in, the heading now out."""

    rejected_count: int
    """Headings seen that were not believed."""

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Return the heading after one more signal, or None before the first heading."""

    @property
    def health(self) -> HeadingHealth | None:
        """What is known to be wrong, or None before the first heading."""


@runtime_checkable
class SeatLeveller(Protocol):
    """The seat's own loop."""

    def step(self, reading: SeatReading, imu: ImuSample | None) -> SeatCommand:
        """Return the actuator's rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks:
    """The boxes of Fig. 2; memory lives inside them."""

    detector: Detector
    estimator: Estimator
    planner: Planner
    driver: Driver
    leveller: SeatLeveller
    guard: Guard
    swept_half_m: float = SWEPT_HALF_M
    """What the chair sweeps to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """What one tick ended with."""

    t_s: float
    estimate: HeadingEstimate | None
    plan: MotionPlan
    tracks: TrackCommand
    seat: SeatCommand
    proposed: bool
    """Whether the driver spoke at this tick."""


def _no_log(signal: Signal, taken_s: float) -> None:
    del signal, taken_s


Noted = StairMap | HeadingHealth | MotionPlan
"""Messages to the guard that carry a stamp of their own."""


def _as_made(message: Noted) -> Noted:
    return message


def _never(t_s: float) -> bool:
    del t_s
    return False


class Mission:
    """Turns the blocks, one tick at a time."""

    def __init__(
        self,
        plant: Plant,
        blocks: Blocks,
        log: Callable[[Signal, float], None] = _no_log,
        is_dead: Callable[[float], bool] = _never,
        restamp: Callable[[Noted], Noted] = _as_made,
    ) -> None:
        """Take the blocks and start the plant.

        Args:
            log: Takes each signal and the mission time of the tick at which it was taken or made [s].
            is_dead: Whether the process that drives is dead at a time: what a test does to it.
            restamp: A message as the guard gets it: what a test does to its stamp.
        """
        self._plant = plant
        self._blocks = blocks
        self._log = log
        self._is_dead = is_dead
        self._restamp = restamp
        self._tick = 0
        self._t_s = 0.0
        self._control = Rate(blocks.driver.period_s)
        self._proposals = Proposals(blocks.driver)
        self._estimate: HeadingEstimate | None = None
        self._imu: ImuSample | None = None
        self._gravity = GravityAtExposure()
        self._phase = ""
        self._told = (0.0, 0.0)
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        plant.start()

    def tick(self) -> Tick:
        """Advance the plant to the next tick, feel, decide, act."""
        t_s = self._t_s = self._tick * TICK_S
        self._plant.advance(t_s)
        self._blocks.guard.advance(t_s)
        for reading in self._plant.read():
            self._record(reading)
            if self._blocks.guard.admit(reading):
                self._update(reading)

        plan = self._decide(t_s)
        proposed = self._propose(plan)
        guard = self._blocks.guard
        tracks, flipper = guard.step(t_s, self._estimate), guard.pass_flipper(plan.flipper)
        self._seat = seat_now(self._seat, t_s)
        self._plant.write(tracks, self._seat, flipper)
        self._tell(tracks, flipper, plan, proposed=proposed)
        self._tick += 1
        return Tick(t_s=t_s, estimate=self._estimate, plan=plan, tracks=tracks, seat=self._seat, proposed=proposed)

    def _decide(self, t_s: float) -> MotionPlan:
        blocks = self._blocks
        plan = blocks.planner.step(t_s, self._estimate)
        blocks.guard.on_message(self._restamp(plan))
        health = blocks.estimator.health
        if health is not None:
            blocks.guard.on_message(self._restamp(health))
        return plan

    def _propose(self, plan: MotionPlan) -> bool:
        """Hand belt speeds to the guard, and say whether the driver spoke."""
        due = self._control.due(self._tick)
        if self._is_dead(plan.t_s):
            return False
        held = self._blocks.guard.holding is not None
        command = self._proposals.step(plan, self._estimate, held=held, due=due)
        if command is not None:
            self._blocks.guard.propose(command)
        return due and plan.turn_m_s is None

    def _update(self, reading: Reading) -> None:
        blocks = self._blocks
        match reading:
            case ImuSample():
                self._imu = reading
                self._gravity.update(reading)
                self._estimate = blocks.estimator.step(reading)
                blocks.planner.update(reading)
            case TrackReading():
                self._estimate = blocks.estimator.step(reading)
                blocks.planner.update(reading)
            case FlipperReading():
                blocks.planner.update(reading)
            case RgbdFrame():
                self._look(reading)
            case HeadingMeasurement():
                self._update_heading(reading)
            case StairMap():
                self._update_stair(reading)
            case SeatReading():
                self._seat = blocks.guard.pass_seat(blocks.leveller.step(reading, self._imu))
            case _:
                pass

    def _look(self, frame: RgbdFrame) -> None:
        gravity_C = self._gravity.gravity_C(frame)
        quality = quality_of(frame, gravity_C, self._blocks.swept_half_m)
        self._record(quality)
        if not self._blocks.guard.admit(quality):
            return
        seen = self._blocks.detector.see(frame, gravity_C)
        measurement, stair_map = seen.measurement, seen.stair_map
        if measurement is not None:
            self._record(measurement)
            self._update_heading(measurement)
        if stair_map is not None:
            self._record(stair_map)
            self._update_stair(stair_map)

    def _update_heading(self, measurement: HeadingMeasurement) -> None:
        self._blocks.guard.on_message(measurement)
        self._estimate = self._blocks.estimator.step(measurement)

    def _update_stair(self, stair_map: StairMap) -> None:
        self._blocks.guard.on_message(self._restamp(stair_map))
        self._blocks.planner.update(stair_map)

    def _record(self, signal: Signal) -> None:
        self._log(signal, self._t_s)

    def _tell(self, tracks: TrackCommand, flipper: FlipperCommand | None, plan: MotionPlan, *, proposed: bool) -> None:
        if self._estimate is not None:
            self._record(self._estimate)
        belts = (tracks.left_m_s, tracks.right_m_s)
        if proposed or tracks.brake or plan.turn_m_s is not None or belts != self._told:
            self._record(tracks)  # whatever the belts are told anew, by whomever: a guard that ramps down too
        self._told = belts
        if flipper is not None:
            self._record(flipper)
        self._record(self._seat)
        if plan.phase != self._phase:
            self._phase = plan.phase
            self._record(Event(t_s=plan.t_s, name=plan.phase, cause=plan.cause))
        for event in self._blocks.guard.take_events():
            self._record(event)
