"""The block nodes: each subscribes to channels, hands the signals to its block and publishes the block's outputs.

Paper: Fig. 7. ``plant`` (simulator or drivers) ─► ``camera`` and ``heading`` ─► ``driver`` ─► ``guard`` ─► ``plant``, and
``seat`` in parallel. The nodes compute nothing: the blocks are those of ``mission.loop``.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Protocol, runtime_checkable

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.ports import Reading, Transport
from treadline.core.signals import (
    TICK_S,
    CommandSource,
    Event,
    FlipperCommand,
    FrameQuality,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    SeatCommand,
    StairMap,
    TrackCommand,
    TrackReading,
    VelocityCommand,
)
from treadline.guard import SILENCE_S, Guard, GuardConfig, ReadingAdmission
from treadline.io.messages import topic_of
from treadline.mission import CameraBlock, Detector, DriverBlock, SeatBlock, SeatLeveller
from treadline.mission.belt_controllers import Driver
from treadline.mission.loop import Estimator
from treadline.mission.odometry import DeadReckoning
from treadline.mission.planner import Planner, PlannerInput
from treadline.ros import channels as on
from treadline.ros.stair_view import StairView
from treadline.vehicle.linkage import SeatLinkage

ODOM_TICKS = 5
"""Ticks between two odometry messages: 20 Hz."""
REPEAT_S = 1.0
"""Interval at which mounts are published again [s]: a message may be lost, and not kept for later subscribers."""


@runtime_checkable
class Node(Protocol):
    """A block and its channels."""

    @property
    def name(self) -> str:
        """Name of the node in the graph."""

    @property
    def publishes(self) -> tuple[str, ...]:
        """Channels that the node publishes."""

    @property
    def needs(self) -> tuple[tuple[str, ...], ...]:
        """Required channels; of several in brackets one is enough."""

    def listen(self, transport: Transport) -> None:
        """Subscribe; messages may arrive from now on."""

    def advance(self, t_s: float) -> None:
        """Set the node's clock, which stamps are compared with."""

    def tick(self, t_s: float) -> None:
        """Do what is due at this time."""


class _AdmittingNode:
    """Base of the nodes that admit readings by their clock."""

    def __init__(self, config: GuardConfig) -> None:
        self._admission = ReadingAdmission(config)

    def _subscribe(self, transport: Transport, channel: str, *takers: Callable[[Any], object]) -> None:
        """Pass admitted readings of a channel to one taker after the other."""

        def take(reading: Reading) -> None:
            if self._admission.admit(reading):
                for taker in takers:
                    taker(reading)

        transport.subscribe(channel, take)

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._admission.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Set the clock; nothing else is due."""
        self.advance(t_s)


class CameraNode(_AdmittingNode):
    """``RgbdFrame -> FrameQuality, FreeGround, HeadingMeasurement, StairMap, Event``; the paper's ``/depth``.

    A camera that measures by itself publishes no frames; its measurements are passed on if they are admitted.
    """

    name = "camera"
    publishes = on.DETECTED
    needs = ((on.CAMERA, on.CAMERA_QUALITY, on.CAMERA_HEADING),)

    def __init__(self, detector: Detector, config: GuardConfig, swept_half_m: float) -> None:
        self._block = CameraBlock(detector, swept_half_m)
        super().__init__(config)

    def listen(self, transport: Transport) -> None:
        """Subscribe to frames or measurements, and to the readings of gravity and travel."""
        self._publish = transport.publish
        for channel in (on.IMU, on.TRACKS):
            self._subscribe(transport, channel, self._block.update)
        transport.subscribe(on.CAMERA, self._take_frame)
        transport.subscribe(on.CAMERA_QUALITY, self._take_quality)
        transport.subscribe(on.CAMERA_HEADING, self._pass)
        transport.subscribe(on.CAMERA_MAP, self._pass)

    def _take_frame(self, frame: RgbdFrame) -> None:
        def admit(quality: FrameQuality) -> bool:
            return self._admission.admit(frame) and self._admission.admit(quality)

        for detected in self._block.step(frame, admit):
            self._publish(topic_of(detected), detected)

    def _take_quality(self, quality: FrameQuality) -> None:
        self._admission.admit(quality)
        self._publish(on.QUALITY, quality)

    def _pass(self, measured: HeadingMeasurement | StairMap) -> None:
        if self._admission.admit(measured):
            self._publish(topic_of(measured), measured)


class HeadingNode(_AdmittingNode):
    """``ImuSample, TrackReading, HeadingMeasurement -> HeadingEstimate, HeadingHealth``.

    ``Odometry, JointAngles, Mounts, StairMarkers`` are published for others.

    Args:
        estimator: Heading filter.
        config: Limits of the admission of readings.
        mount: The camera in use, on the chair; None publishes no mounts.
        linkage: Linkage of the seat, which gives its angle; None for a chair without one.
    """

    name = "heading"
    publishes = (on.ESTIMATE, on.HEALTH, on.ODOM, on.JOINT_STATES, on.STAIR_MARKERS, on.MOUNTS)
    needs = ((on.IMU,),)

    def __init__(
        self,
        estimator: Estimator,
        config: GuardConfig,
        mount: PinholeCamera | None = None,
        linkage: SeatLinkage | None = None,
    ) -> None:
        self._estimator = estimator
        super().__init__(config)
        self._reckoning, self._view = DeadReckoning(), StairView()
        self._linkage = linkage
        self._joints: dict[str, float] = {}
        self._mount = mount
        self._mounts_s = self._health_s = -REPEAT_S
        self._estimate: HeadingEstimate | None = None
        self._last_health: tuple[object, ...] | None = None

    def listen(self, transport: Transport) -> None:
        """Subscribe to the inputs of the heading filter."""
        self._publish = transport.publish
        self._subscribe(transport, on.IMU, self._reckoning.update, self._step)
        self._subscribe(transport, on.TRACKS, self._step, self._reckon)
        transport.subscribe(on.MEASURED, self._step)
        for channel in (on.MAP, on.GROUND, on.PLAN, on.GUARD):
            transport.subscribe(channel, self._view.update)
        angle_at = None if self._linkage is None else self._linkage.nearest_angle
        if angle_at is not None:
            self._subscribe(transport, on.SEAT, lambda seat: self._joints.update(seat_joint=angle_at(seat.stroke_m)))
        self._subscribe(transport, on.FLIPPER, lambda flipper: self._joints.update(flipper_joint=flipper.angle_rad))

    def tick(self, t_s: float) -> None:
        """Publish the filter's health where it has changed and often enough for the guard, which awaits it, and the mounts."""
        self.advance(t_s)
        if self._mount is not None and t_s - self._mounts_s >= REPEAT_S:
            self._mounts_s = t_s
            self._publish(on.MOUNTS, on.Mounts(t_s=t_s, camera=self._mount))
        health = self._estimator.health
        if health is None:
            return
        content = (health.fault, health.since_s, health.cause)
        if content != self._last_health or t_s - self._health_s >= SILENCE_S / 3.0:
            self._last_health, self._health_s = content, t_s
            self._publish(on.HEALTH, health)

    def _reckon(self, reading: TrackReading) -> None:
        odometry = self._reckoning.step(reading)
        if odometry is not None and round(reading.t_s / TICK_S) % ODOM_TICKS == 0:
            self._publish(on.ODOM, replace(odometry, X_OS=self._view.pose(odometry)))
            self._publish(on.STAIR_MARKERS, self._view.markers(odometry.t_s))
            if self._joints:
                names, angles = zip(*self._joints.items(), strict=True)
                self._publish(on.JOINT_STATES, on.JointAngles(t_s=reading.t_s, names=names, angles_rad=angles))

    def _step(self, signal: ImuSample | TrackReading | HeadingMeasurement) -> None:
        estimate = self._estimator.step(signal)
        if estimate is not None and estimate != self._estimate:  # a belt reading seldom changes the estimate
            self._estimate = estimate
            self._view.update(estimate)
            self._publish(on.ESTIMATE, estimate)


class SeatNode(_AdmittingNode):
    """``SeatReading, ImuSample -> SeatCommand``: the control loop of the seat."""

    name = "seat"
    publishes = (on.SEAT_PROPOSED,)
    needs = ((on.SEAT,),)

    def __init__(self, leveller: SeatLeveller, config: GuardConfig) -> None:
        self._block = SeatBlock(leveller)
        super().__init__(config)

    def listen(self, transport: Transport) -> None:
        """Subscribe to the seat's state and the chassis' IMU."""
        self._publish = transport.publish
        self._subscribe(transport, on.IMU, self._block.update)
        self._subscribe(transport, on.SEAT, lambda reading: self._publish(on.SEAT_PROPOSED, self._block.step(reading)))


class DriverNode(_AdmittingNode):
    """``HeadingEstimate, StairMap, readings -> MotionPlan, TrackCommand``: planner and belt controller."""

    name = "driver"
    publishes = (on.PLAN, on.TRACKS_PROPOSED)
    needs = ((on.IMU,), (on.TRACKS,))

    def __init__(self, planner: Planner, driver: Driver, config: GuardConfig) -> None:
        self._block = DriverBlock(planner, driver)
        super().__init__(config)
        self._estimate: HeadingEstimate | None = None
        self._holding: str | None = None

    def listen(self, transport: Transport) -> None:
        """Subscribe to the heading, the stair map, the readings and the state of the guard."""
        self._publish = transport.publish
        for channel in (on.IMU, on.TRACKS, on.FLIPPER, on.OPERATOR):
            self._subscribe(transport, channel, self._update)
        for channel in (on.MAP, on.GROUND):
            transport.subscribe(channel, self._update)
        transport.subscribe(on.ESTIMATE, partial(setattr, self, "_estimate"))
        transport.subscribe(on.GUARD, self._take_guard)

    def tick(self, t_s: float) -> None:
        """Publish the plan, and proposed belt speeds where they are due."""
        self.advance(t_s)
        plan = self._plan(t_s)
        self._publish(on.PLAN, plan)
        command = self._block.propose(plan, self._estimate, held=self._holding is not None)
        if command is not None:
            self._publish(on.TRACKS_PROPOSED, command)

    def _plan(self, t_s: float) -> MotionPlan:
        return self._block.plan(t_s, self._estimate)

    def _update(self, signal: PlannerInput) -> None:
        self._block.update(signal)

    def _take_guard(self, state: on.GuardState) -> None:
        self._holding = state.holding


class GuardNode:
    """All readings, plans and proposals ``-> TrackCommand, SeatCommand, FlipperCommand, Event``; independent of all other nodes.

    Args:
        config: Limits of the guard.
        awaited: The other nodes of the graph: the belts are braked until each has reported, and its heartbeat is awaited from then
            on. That of another node is not.
        sender: Id of this guard in its commands; the guard at the actuators obeys one id.
    """

    name = "guard"
    publishes = (*on.COMMANDS, on.GUARD)
    needs = ()

    def __init__(self, config: GuardConfig, awaited: tuple[str, ...] = (), sender: str = "chair") -> None:
        self._guard = Guard(replace(config, processes=awaited))
        self._has_seat = config.seat_rate_m_s is not None
        self._sender = sender
        self._waits_for = dict.fromkeys(awaited, "")
        self._estimate: HeadingEstimate | None = None
        self._flipper_runs = False
        self._velocity: VelocityCommand | None = None
        self._t_s = 0.0
        self._last_published: tuple[str | None, CommandSource] = (None, "driver")

    @property
    def waits_for(self) -> str:
        """Awaited nodes that are not ready yet, each with its reason; empty if all are ready."""
        nodes = (f"{name} ({reason})" if reason else name for name, reason in sorted(self._waits_for.items()))
        return "waits for " + ", ".join(nodes) if self._waits_for else ""

    def listen(self, transport: Transport) -> None:
        """Subscribe to all readings, estimates, plans and proposals."""
        self._publish = transport.publish
        drives, own = (on.IMU, on.TRACKS, on.SEAT, on.FLIPPER, on.OPERATOR, on.PLANT), (on.CAMERA_HEADING, on.CAMERA_MAP)
        for channel in (*drives, on.QUALITY, on.GROUND, *own):
            transport.subscribe(channel, self._admit)
        for channel in (on.MEASURED, on.MAP, on.HEALTH):
            transport.subscribe(channel, self._guard.on_message)
        transport.subscribe(on.ESTIMATE, partial(setattr, self, "_estimate"))
        transport.subscribe(on.PLAN, self._take_plan)
        for channel in (on.TRACKS_PROPOSED, on.SEAT_PROPOSED):
            transport.subscribe(channel, self._guard.propose)
        transport.subscribe(on.TWIST, partial(setattr, self, "_velocity"))
        transport.subscribe(on.DIAGNOSTICS, self._receive)
        transport.subscribe(on.GUARD, lambda _: None)  # so that the transport finds a second guard

    def advance(self, t_s: float) -> None:
        """Set the clock."""
        self._guard.advance(t_s)

    def tick(self, t_s: float) -> None:
        """Publish the commands that may reach the chair now."""
        self._t_s = t_s
        self.advance(t_s)
        self._propose_velocity()
        if self._waits_for:
            self._command(on.TRACKS_CMD, TrackCommand.stop(t_s))
            return
        tracks, seat, flipper = self._guard.step(t_s, self._estimate)
        if self._has_seat:
            self._command(on.SEAT_CMD, seat)
        if flipper is not None or self._flipper_runs:
            self._command(on.FLIPPER_CMD, flipper or FlipperCommand(t_s=t_s, rate_rad_s=0.0))
        self._flipper_runs = flipper is not None
        self._command(on.TRACKS_CMD, tracks)
        self._report_state()
        for event in self._guard.take_events():
            self._publish(on.DIAGNOSTICS, event)

    def repeat_state(self) -> None:
        """Publish again whether the guard holds, and whose commands move the belts, for later subscribers."""
        guard = self._guard
        self._publish(on.GUARD, on.GuardState(t_s=self._t_s, holding=guard.holding, source=guard.source, sender=self._sender))

    def hold(self, cause: str) -> None:
        """Hold for a fault of this process or of the plant's."""
        self._guard.hold(cause)
        self._report_state()

    def _command(self, channel: str, command: TrackCommand | SeatCommand | FlipperCommand) -> None:
        self._publish(channel, replace(command, sender=self._sender))

    def _admit(self, reading: Reading) -> None:
        self._guard.admit(reading)
        self._report_state()

    def _take_plan(self, plan: MotionPlan) -> None:
        self._guard.on_message(plan)
        self._report_state()

    def _propose_velocity(self) -> None:
        """Propose the newest velocity since the last tick; one without a stamp counts as of this tick."""
        command, self._velocity = self._velocity, None
        if command is not None:
            self._guard.propose(replace(command, t_s=self._t_s) if math.isnan(command.t_s) else command)

    def _receive(self, message: object) -> None:
        if isinstance(message, Event) and message.name == on.TWO_SOURCES:
            self.hold(message.cause)
        elif isinstance(message, on.Beat):
            if message.state == "ready":
                self._waits_for.pop(message.node, None)
            elif message.node in self._waits_for:
                self._waits_for[message.node] = message.state
            # The beat counts at its arrival, whatever the clock of its sender.
            self._guard.beat(message.node, self._t_s)

    def _report_state(self) -> None:
        state = self._guard.holding, self._guard.source
        if state != self._last_published:
            self._last_published = state
            self.repeat_state()
