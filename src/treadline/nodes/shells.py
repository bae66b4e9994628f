"""The nodes: each takes signals from channels, hands them to its block and says what the block answers.

Paper: Fig. 7. ``plant`` (simulator or drivers) ─► ``camera`` and ``heading`` ─► ``driver`` ─► ``guard`` ─► ``plant``, with ``seat``
beside them. Nothing here computes: what a block would be asked in ``mission.loop`` it is asked here, in the same order.
"""

from typing import Protocol, runtime_checkable

from treadline.mission.drivers import Driver
from treadline.mission.gravity import GravityAtExposure
from treadline.mission.guard import Guard, GuardConfig, ReadingAdmission
from treadline.mission.loop import Detector, Estimator, SeatLeveller
from treadline.mission.planner import Planner
from treadline.mission.proposals import Proposals
from treadline.nodes import channels as on
from treadline.nodes.odometry import DeadReckoning
from treadline.nodes.warm_up import stair_frames
from treadline.nodes.words import Beat, GuardState, Mounts, VelocityCommand
from treadline.perception.quality import quality_of
from treadline.ports import Transport
from treadline.signals import (
    TICK_S,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    PinholeCamera,
    Reading,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)

ODOM_TICKS = 5
"""Between two places told: 20 Hz."""
MOUNTS_S = 1.0
"""Between two times that it is said where the sensors sit: a transport may not keep it for those who come later."""
PLAN_TIMEOUT_S = 0.1
"""A flipper's rate is for the moment: without a newer plan it stands."""


@runtime_checkable
class Node(Protocol):
    """A block and its channels."""

    @property
    def name(self) -> str:
        """What it is called in the graph."""

    @property
    def says(self) -> tuple[str, ...]:
        """The channels it speaks on."""

    @property
    def needs(self) -> tuple[tuple[str, ...], ...]:
        """The channels without which it is of no use; of several in brackets one is enough."""

    def listen(self, transport: Transport) -> None:
        """Take from the channels it needs; they may speak from now on."""

    def advance(self, t_s: float) -> None:
        """Set the node's clock, which stamps are compared with."""

    def tick(self, t_s: float) -> None:
        """Do what is due at this time."""


class CameraNode:
    """``RgbdFrame -> FrameQuality, HeadingMeasurement, StairMap``; the paper's ``/depth``."""

    name = "camera"
    says = (on.QUALITY, on.MEASURED, on.MAP)
    needs = ((on.CAMERA, on.CAMERA_QUALITY, on.CAMERA_HEADING),)

    def __init__(self, detector: Detector, config: GuardConfig, swept_half_m: float) -> None:
        self._detector = detector
        self._swept_half_m = swept_half_m
        self._admission = ReadingAdmission(config)
        self._gravity = GravityAtExposure()

    def listen(self, transport: Transport) -> None:
        """Take frames, or what a camera has measured by itself, and whatever tells where down is."""
        self._say = transport.publish
        transport.subscribe(on.IMU, self._tilt)
        transport.subscribe(on.TRACKS, self._roll)
        transport.subscribe(on.CAMERA, self._look)
        transport.subscribe(on.CAMERA_QUALITY, self._judge)
        transport.subscribe(on.CAMERA_HEADING, self._pass)
        transport.subscribe(on.CAMERA_MAP, self._pass)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._admission.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Set the clock; nothing is due."""
        self.advance(t_s)

    def warm_up(self, camera: PinholeCamera, *, rises: bool) -> None:
        """Look at synthetic frames of a staircase, so that all kernels are compiled before the first real frame.

        Args:
            camera: The camera in use, on the chair.
            rises: Whether the flight that the camera looks at rises, else it falls.
        """
        for frame, gravity_C in stair_frames(camera, rises=rises):
            quality_of(frame, gravity_C, self._swept_half_m)
            seen = self._detector.see(frame, gravity_C)
            _ = seen.measurement, seen.stair_map  # the map is made when it is asked for

    def _tilt(self, sample: ImuSample) -> None:
        if self._admission.admit(sample):
            self._gravity.update(sample)

    def _roll(self, reading: TrackReading) -> None:
        self._admission.admit(reading)

    def _look(self, frame: RgbdFrame) -> None:
        gravity_C = self._gravity.gravity_C(frame)
        quality = quality_of(frame, gravity_C, self._swept_half_m)
        self._say(on.QUALITY, quality)
        if not (self._admission.admit(frame) and self._admission.admit(quality)):
            return
        seen = self._detector.see(frame, gravity_C)
        measurement, stair_map = seen.measurement, seen.stair_map
        if measurement is not None:
            self._say(on.MEASURED, measurement)
        if stair_map is not None:
            self._say(on.MAP, stair_map)

    def _judge(self, quality: FrameQuality) -> None:
        self._admission.admit(quality)
        self._say(on.QUALITY, quality)

    def _pass(self, seen: HeadingMeasurement | StairMap) -> None:
        if self._admission.admit(seen):
            self._say(on.MEASURED if isinstance(seen, HeadingMeasurement) else on.MAP, seen)


class HeadingNode:
    """``ImuSample, TrackReading, HeadingMeasurement -> HeadingEstimate, HeadingHealth``; for others also ``Odometry, Mounts``.

    Args:
        mount: The camera in use, on the chair; None says nothing of where sensors sit.
    """

    name = "heading"
    says = (on.ESTIMATE, on.HEALTH, on.ODOM, on.MOUNTS)
    needs = ((on.IMU,),)

    def __init__(self, estimator: Estimator, config: GuardConfig, mount: PinholeCamera | None = None) -> None:
        self._estimator = estimator
        self._admission = ReadingAdmission(config)
        self._reckoning = DeadReckoning()
        self._mount = mount
        self._mounts_s = -MOUNTS_S
        self._estimate: HeadingEstimate | None = None
        self._told: tuple[object, ...] | None = None

    def listen(self, transport: Transport) -> None:
        """Take what moves the heading, and what shows it."""
        self._say = transport.publish
        transport.subscribe(on.IMU, self._turn)
        transport.subscribe(on.TRACKS, self._roll)
        transport.subscribe(on.MEASURED, self._step)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._admission.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Say how the filter is, where that is new, and now and then where the sensors sit."""
        self.advance(t_s)
        if self._mount is not None and t_s - self._mounts_s >= MOUNTS_S:
            self._mounts_s = t_s
            self._say(on.MOUNTS, Mounts(t_s=t_s, camera=self._mount))
        health = self._estimator.health
        if health is None:
            return
        told = (health.fault, health.since_s, health.cause)
        if told != self._told:
            self._told = told
            self._say(on.HEALTH, health)

    def _turn(self, sample: ImuSample) -> None:
        if self._admission.admit(sample):
            self._reckoning.update(sample)
            self._step(sample)

    def _roll(self, reading: TrackReading) -> None:
        if not self._admission.admit(reading):
            return
        self._step(reading)
        odometry = self._reckoning.step(reading)
        if odometry is not None and round(reading.t_s / TICK_S) % ODOM_TICKS == 0:
            self._say(on.ODOM, odometry)

    def _step(self, signal: ImuSample | TrackReading | HeadingMeasurement) -> None:
        estimate = self._estimator.step(signal)
        if estimate is not None and estimate != self._estimate:  # belts seldom change what is known
            self._estimate = estimate
            self._say(on.ESTIMATE, estimate)


class SeatNode:
    """``SeatReading, ImuSample -> SeatCommand``: the seat's own loop."""

    name = "seat"
    says = (on.SEAT_PROPOSED,)
    needs = ((on.SEAT,),)

    def __init__(self, leveller: SeatLeveller, config: GuardConfig) -> None:
        self._leveller = leveller
        self._admission = ReadingAdmission(config)
        self._imu: ImuSample | None = None

    def listen(self, transport: Transport) -> None:
        """Take the seat's state and the chassis' IMU."""
        self._say = transport.publish
        transport.subscribe(on.IMU, self._tilt)
        transport.subscribe(on.SEAT, self._level)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._admission.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Set the clock; nothing is due."""
        self.advance(t_s)

    def _tilt(self, sample: ImuSample) -> None:
        if self._admission.admit(sample):
            self._imu = sample

    def _level(self, reading: SeatReading) -> None:
        if self._admission.admit(reading):
            self._say(on.SEAT_PROPOSED, self._leveller.step(reading, self._imu))


class DriverNode:
    """``HeadingEstimate, StairMap and what the chair feels -> MotionPlan, TrackCommand``: planner and heading controller."""

    name = "driver"
    says = (on.PLAN, on.TRACKS_PROPOSED)
    needs = ((on.IMU,), (on.TRACKS,))

    def __init__(self, planner: Planner, driver: Driver, config: GuardConfig) -> None:
        self._planner = planner
        self._proposals = Proposals(driver)
        self._admission = ReadingAdmission(config)
        self._every = round(driver.period_s / TICK_S)
        self._slot = -1
        self._estimate: HeadingEstimate | None = None
        self._holding: str | None = None

    def listen(self, transport: Transport) -> None:
        """Take the heading, the stair ahead, what the chair feels, and whether it is held."""
        self._say = transport.publish
        for channel in (on.IMU, on.TRACKS, on.FLIPPER):
            transport.subscribe(channel, self._update)
        transport.subscribe(on.MAP, self._planner.update)
        transport.subscribe(on.ESTIMATE, self._know)
        transport.subscribe(on.GUARD, self._hold)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._admission.advance(t_s)

    def tick(self, t_s: float) -> None:
        """MotionPlan; propose belt speeds where they are due."""
        self.advance(t_s)
        plan = self._planner.step(t_s, self._estimate)
        self._say(on.PLAN, plan)
        # A tick that was lost on the way must not lose a command with it.
        slot = round(t_s / TICK_S) // self._every
        due, self._slot = slot != self._slot, slot
        command = self._proposals.step(plan, self._estimate, held=self._holding is not None, due=due)
        if command is not None:
            self._say(on.TRACKS_PROPOSED, command)

    def _update(self, reading: ImuSample | TrackReading | FlipperReading) -> None:
        if self._admission.admit(reading):
            self._planner.update(reading)

    def _know(self, estimate: HeadingEstimate) -> None:
        self._estimate = estimate

    def _hold(self, state: GuardState) -> None:
        self._holding = state.holding


class GuardNode:
    """All readings, plans and proposals ``-> TrackCommand, SeatCommand, FlipperCommand, Event``; it stands apart from all others.

    Args:
        awaited: Nodes without which the chair does not start; until each has spoken the belts are braked.
        gauge_m: Between the tracks, where a person's stick or another planner drives (``/cmd_vel``); else the driver drives.
    """

    name = "guard"
    says = (on.TRACKS_CMD, on.SEAT_CMD, on.FLIPPER_CMD, on.GUARD)
    needs = ()

    def __init__(self, config: GuardConfig, awaited: tuple[str, ...] = (), gauge_m: float | None = None) -> None:
        self._guard = Guard(config)
        self._gauge_m = gauge_m
        self._missing = set(awaited)
        self._estimate: HeadingEstimate | None = None
        self._plan: MotionPlan | None = None
        self._flipper_runs = False
        self._t_s = 0.0
        self._told: str | None = None

    @property
    def missing(self) -> set[str]:
        """Nodes that have not spoken yet."""
        return self._missing

    def listen(self, transport: Transport) -> None:
        """Take everything."""
        self._say = transport.publish
        for channel in (on.IMU, on.TRACKS, on.SEAT, on.FLIPPER, on.OPERATOR, on.QUALITY, on.CAMERA_HEADING, on.CAMERA_MAP):
            transport.subscribe(channel, self._admit)
        for channel in (on.MEASURED, on.MAP, on.HEALTH):
            transport.subscribe(channel, self._guard.on_message)
        transport.subscribe(on.PLAN, self._follow)
        transport.subscribe(on.ESTIMATE, self._know)
        if self._gauge_m is None:
            transport.subscribe(on.TRACKS_PROPOSED, self._propose)
        else:
            transport.subscribe(on.TWIST, self._steer)
        transport.subscribe(on.SEAT_PROPOSED, self._level)
        transport.subscribe(on.DIAGNOSTICS, self._hear)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._guard.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Publish the commands that may reach the chair now."""
        self._t_s = t_s
        self.advance(t_s)
        if self._missing:
            self._say(on.TRACKS_CMD, TrackCommand.stop(t_s))
            return
        tracks = self._guard.step(t_s, self._estimate)
        self._drive_flipper(t_s)
        self._say(on.TRACKS_CMD, tracks)
        self._tell_state()
        for event in self._guard.take_events():
            self._say(on.DIAGNOSTICS, event)

    def repeat_state(self) -> None:
        """Say again whether it holds: whoever came later has not heard it."""
        self._say(on.GUARD, GuardState(t_s=self._t_s, holding=self._guard.holding))

    def _drive_flipper(self, t_s: float) -> None:
        plan = self._plan
        fresh = plan is not None and t_s - plan.t_s <= PLAN_TIMEOUT_S
        flipper = self._guard.pass_flipper(plan.flipper if plan is not None and fresh else None)
        if flipper is None and self._flipper_runs:
            self._say(on.FLIPPER_CMD, FlipperCommand(t_s=t_s, rate_rad_s=0.0))
        elif flipper is not None:
            self._say(on.FLIPPER_CMD, flipper)
        self._flipper_runs = flipper is not None

    def _admit(self, reading: Reading) -> None:
        self._guard.admit(reading)
        self._tell_state()

    def _follow(self, plan: MotionPlan) -> None:
        if self._plan is None or plan.t_s >= self._plan.t_s:
            self._plan = plan
        self._guard.on_message(plan)
        self._tell_state()

    def _know(self, estimate: HeadingEstimate) -> None:
        self._estimate = estimate

    def _propose(self, command: TrackCommand) -> None:
        self._guard.propose(command)

    def _steer(self, drive: VelocityCommand) -> None:
        half_m_s = 0.5 * drive.turn_rad_s * (self._gauge_m or 0.0)
        speed = drive.speed_m_s
        self._guard.propose(TrackCommand(t_s=self._t_s, left_m_s=speed - half_m_s, right_m_s=speed + half_m_s))

    def _level(self, command: SeatCommand) -> None:
        self._say(on.SEAT_CMD, self._guard.pass_seat(command))

    def _hear(self, told: object) -> None:
        if isinstance(told, Beat) and told.node != self.name:
            self._missing.discard(told.node)
            # Heard now, whenever its clock says that it spoke.
            self._guard.beat(told.node, self._t_s)

    def _tell_state(self) -> None:
        if self._guard.holding != self._told:
            self._told = self._guard.holding
            self.repeat_state()
