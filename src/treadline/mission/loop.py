"""The in-process loop: sensors in, belt, flipper and seat commands out, 100 times a second.

Paper: Fig. 2 and Fig. 7, Table I (100 Hz IMU, 10 Hz camera, 4 Hz control). One tick, top to bottom, is the block
diagram::

    Plant.read() ─► guard.admit ─┬─ ImuSample, TrackReading ──────► heading filter ─ HeadingEstimate ─┬──────────┐
                                 ├─ RgbdFrame ─► stair detector ─┬─ HeadingMeasurement ─┘             ▼          ▼
                                 │                               └─ StairMap ─────────────► planner ─ MotionPlan ─► driver (4 Hz)
                                 └─ SeatReading ─► leveller ─ SeatCommand ─┐                 │ FlipperCommand        │ TrackCommand
                                                                           └────────────► guard ◄────────────────┘
                                                                                            └────► Plant.write()

The loop gets readings, the chair's file and the operator's input, and never the ground truth. The nodes (``treadline.ros``) wire
the same blocks over channels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from treadline.core.camera_images import RgbdFrame
from treadline.core.loop_watchdog import LoopWatchdog
from treadline.core.ports import Plant, Reading
from treadline.core.signals import (
    TICK_S,
    Event,
    FlipperCommand,
    FlipperReading,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.guard import Commands, GuardConfig
from treadline.mission._blocks import CameraBlock, Detector, DriverBlock, SeatBlock, SeatLeveller
from treadline.mission.belt_controllers import Driver
from treadline.mission.planner import Planner
from treadline.perception.free_ground import SWEPT_HALF_M

Signal = Reading | HeadingEstimate | TrackCommand | SeatCommand | FlipperCommand | MotionPlan | Event
"""Everything that a run's log may hold, apart from ground truth."""


@runtime_checkable
class Estimator(Protocol):
    """Heading filter: IMU samples, belt speeds and measured headings in, heading estimate out."""

    rejected_count: int
    """Number of rejected heading measurements."""

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Return the heading after one more signal, or None before the first heading."""

    @property
    def health(self) -> HeadingHealth | None:
        """Faults known to the filter, or None before the first heading."""


class Supervisor(Protocol):
    """The guard of this process (``Guard``), or the loop's side of a guard in a process of its own."""

    @property
    def config(self) -> GuardConfig:
        """Limits of the guard."""

    @property
    def holding(self) -> str | None:
        """Cause of the HOLD, or None."""

    def advance(self, t_s: float) -> None:
        """Set the clock at the start of a tick."""

    def admit(self, reading: Reading) -> bool:
        """Return whether other blocks may use a reading."""

    def on_message(self, message: HeadingMeasurement | StairMap | HeadingHealth | MotionPlan) -> object:
        """Update with a message that other blocks computed."""

    def propose(self, command: TrackCommand | SeatCommand) -> None:
        """Update with a proposed command."""

    def hold(self, cause: str) -> None:
        """Hold for a fault that readings do not show."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> Commands:
        """Return the commands to the plant."""

    def take_events(self) -> Sequence[Event]:
        """Return the events since the last call."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks:
    """Blocks of Fig. 2; each keeps its own state."""

    detector: Detector
    estimator: Estimator
    planner: Planner
    driver: Driver
    leveller: SeatLeveller | None
    """Control loop of the seat; None for a chair without a seat linkage."""
    guard: Supervisor
    swept_half_m: float = SWEPT_HALF_M
    """Half of the width that the chair sweeps [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """Result of one tick."""

    t_s: float
    estimate: HeadingEstimate | None
    plan: MotionPlan
    tracks: TrackCommand
    seat: SeatCommand
    proposed: bool
    """Whether the belt controller computed a new command at this tick."""


GuardMessage = StairMap | HeadingHealth | MotionPlan
"""Messages to the guard that carry a stamp of their own."""


class Mission:
    """In-process wiring of the blocks, one tick at a time.

    Args:
        plant: The chair.
        blocks: The blocks of Fig. 2.
        log: Takes each signal and the mission time of the tick at which it was taken or made [s].
        is_dead: Fault injection: whether the process of the driver is dead at a time.
        restamp: Fault injection: a message as the guard receives it.
    """

    def __init__(
        self,
        plant: Plant,
        blocks: Blocks,
        log: Callable[[Signal, float], None] = lambda _signal, _taken_s: None,
        is_dead: Callable[[float], bool] = lambda _t_s: False,
        restamp: Callable[[GuardMessage], GuardMessage] = lambda message: message,
    ) -> None:
        """Wire the blocks and start the plant."""
        self._plant = plant
        self._guard = blocks.guard
        self._estimator = blocks.estimator
        self._camera = CameraBlock(blocks.detector, blocks.swept_half_m)
        self._driver = DriverBlock(blocks.planner, blocks.driver)
        self._leveller = None if blocks.leveller is None else SeatBlock(blocks.leveller)
        self._log = log
        self._is_dead = is_dead
        self._restamp = restamp
        self._tick = 0
        self._t_s = 0.0
        self._estimate: HeadingEstimate | None = None
        self._phase = ""
        self._belts = (0.0, 0.0)
        self.watchdog = LoopWatchdog(blocks.guard.hold, getattr(plant, "brake", None), limit_s=blocks.guard.config.silence_s)
        """Watch over the ticks of a plant on the wall clock, while its ``with`` block runs."""
        plant.start()

    def tick(self) -> Tick:
        """Advance the plant to the next tick, read, plan, propose, guard, write."""
        t_s = self._t_s = self._tick * TICK_S
        self.watchdog.begin("plant.advance")
        self._plant.advance(t_s)
        self._guard.advance(t_s)
        self.watchdog.begin("plant.read")
        readings = self._plant.read()
        self.watchdog.begin("detector and heading filter")
        for reading in readings:
            self._log(reading, self._t_s)
            if self._guard.admit(reading):
                self._take(reading)

        self.watchdog.begin("planner and controller")
        plan = self._plan(t_s)
        proposed = self._propose(plan)
        commands = self._guard.step(t_s, self._estimate)
        self.watchdog.begin("plant.write")
        self._plant.write(*commands)
        self.watchdog.begin("log and viewer")
        self._report(commands, plan, proposed=proposed)
        self._tick += 1
        return Tick(t_s=t_s, estimate=self._estimate, plan=plan, tracks=commands.tracks, seat=commands.seat, proposed=proposed)

    def _take(self, signal: Reading) -> None:
        """Pass an admitted reading, or a detection in a frame, to the blocks that use it."""
        match signal:
            case ImuSample() | TrackReading():
                self._estimate = self._estimator.step(signal)
                self._camera.update(signal)
                if isinstance(signal, ImuSample) and self._leveller is not None:
                    self._leveller.update(signal)
                self._driver.update(signal)
            case FlipperReading() | OperatorInput() | FreeGround():
                self._driver.update(signal)
            case SeatReading() if self._leveller is not None:
                self._guard.propose(self._leveller.step(signal))
            case RgbdFrame():
                self._look(signal)
            case HeadingMeasurement():
                self._guard.on_message(signal)
                self._estimate = self._estimator.step(signal)
            case StairMap():
                self._guard.on_message(self._restamp(signal))
                self._driver.update(signal)
            case _:
                pass  # used by the guard only

    def _look(self, frame: RgbdFrame) -> None:
        """Pass what a frame shows to the blocks that use it."""
        for detected in self._camera.step(frame, self._guard.admit):
            self._log(detected, self._t_s)
            if not isinstance(detected, Event) and (not isinstance(detected, FreeGround) or self._guard.admit(detected)):
                self._take(detected)

    def _plan(self, t_s: float) -> MotionPlan:
        plan = self._driver.plan(t_s, self._estimate)
        self._guard.on_message(self._restamp(plan))
        health = self._estimator.health
        if health is not None:
            self._guard.on_message(self._restamp(health))
        return plan

    def _propose(self, plan: MotionPlan) -> bool:
        """Pass proposed belt speeds to the guard; return whether the belt controller computed them at this tick."""
        if self._is_dead(plan.t_s):
            return False
        command = self._driver.propose(plan, self._estimate, held=self._guard.holding is not None)
        if command is not None:
            self._guard.propose(command)
        return self._driver.is_due and plan.turn_m_s is None

    def _report(self, commands: Commands, plan: MotionPlan, *, proposed: bool) -> None:
        """Log the results of the tick."""
        tracks, seat, flipper = commands
        if self._estimate is not None:
            self._log(self._estimate, self._t_s)
        belts = (tracks.left_m_s, tracks.right_m_s)
        if proposed or tracks.brake or plan.turn_m_s is not None or belts != self._belts:
            self._log(tracks, self._t_s)  # each change of the belt command, also during a ramp of the guard
        self._belts = belts
        if flipper is not None:
            self._log(flipper, self._t_s)
        if self._leveller is not None:
            self._log(seat, self._t_s)
        if plan.phase != self._phase:
            self._phase = plan.phase
            self._log(Event(t_s=plan.t_s, name=plan.phase, cause=plan.cause), self._t_s)
        for event in self._guard.take_events():
            self._log(event, self._t_s)
