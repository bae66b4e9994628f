"""The guard: connects the monitors of readings, plans and proposals, and decides which commands reach the plant.

``reading -> bool``, whether it may be used; ``plan, health, map, proposals -> Commands`` at each tick.

One rule for the stamp of every message (``_stamps``), physical bounds of what messages say (``_bounds``): a message that breaks
either is rejected and counted, and an event reports each kind once in ten seconds. What must speak is awaited from the first tick,
and again after each re-arm. The guard computes with plain numbers.
"""

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from treadline.core.signals import (
    ROUNDING_S,
    CommandSource,
    Event,
    FlipperCommand,
    FrameQuality,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    MotionPlan,
    OperatorInput,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    VelocityCommand,
)
from treadline.guard._admission import ReadingAdmission
from treadline.guard._attitude_limits import SeatMonitor
from treadline.guard._belt_monitor import BeltMonitor
from treadline.guard._bounds import finite
from treadline.guard._guard_config import ENDS, STEADY, GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Monitor
from treadline.guard._rules import RULES
from treadline.guard._silence import Heartbeat, Silence
from treadline.guard._speed_limits import limited, mean_limit, stands
from treadline.guard._stamps import Stamped
from treadline.guard.stop_latch import AGAIN_S, Latch, Rearm


class Commands(NamedTuple):
    """Commands of one tick to the plant, in the order of ``Plant.write``."""

    tracks: TrackCommand
    seat: SeatCommand
    flipper: FlipperCommand | None
    """None stops the flipper, as does a rate of zero."""


class Guard:
    """Supervisor with a latched HOLD over the command stream."""

    def __init__(self, config: GuardConfig) -> None:
        self.config = config
        """Limits of the guard."""
        self._latch, self._button = Latch(config), Rearm()
        self._admission = ReadingAdmission(config)
        self.rejected: Mapping[str, int] = self._admission.stamps.rejected
        """Number of messages rejected for their stamp or their content, by kind."""
        self._known = Known(
            frames=self._admission.frames,
            travel=self._admission.travel,
            report=lambda name, cause: self._latch.report(self._known.t_s, name, cause),
            passed=TrackCommand.stop(0.0),
            t_s=0.0,
            passed_s=0.0,
            commanded_s=0.0,
        )
        self._watches = {rule: rule(config) for rule in RULES if rule.is_watched(config)}
        self._hearers: dict[type, list[Monitor]] = defaultdict(list)
        """Monitors that hear each type of message."""
        for monitor in self._watches.values():
            for kind in monitor.hears:
                self._hearers[kind].append(monitor)
        self._is_dark = False
        self._seat_rad = 0.0
        self._command = TrackCommand.stop(0.0)
        self._seat_command = SeatCommand(t_s=-math.inf, rate_m_s=0.0)
        self._t_s: float | None = None
        self._velocity: VelocityCommand | None = None
        self._map_s = self._begun_s = -math.inf

    @property
    def source(self) -> CommandSource:
        """Whose commands move the belts."""
        return self._known.source

    @property
    def holding(self) -> str | None:
        """Cause of the HOLD, or None."""
        return self._latch.cause

    def advance(self, t_s: float) -> None:
        """Set the guard's clock at the start of a tick; the stamps of the tick's messages are compared with it."""
        if math.isfinite(t_s):
            self._known.t_s = t_s
            self._admission.advance(t_s)

    def admit(self, reading: Stamped) -> bool:
        """Return whether other blocks may use a reading; the guard receives each reading first."""
        return self._obey(reading) if isinstance(reading, OperatorInput) else self._take(reading)

    def on_message(self, message: HeadingMeasurement | StairMap | HeadingHealth | MotionPlan) -> bool:
        """Update with a message that other blocks computed from readings; return whether it is accepted."""
        if isinstance(message, MotionPlan):
            self._latch.hold(self._known.t_s, Stop.RAMP, message.hold)  # a hold is valid whatever its stamp
        return self._take(message, "a block")

    def beat(self, process: str, t_s: float) -> None:
        """Record the heartbeat of a process; of those of the graph the next ones are then expected."""
        self._hear(Heartbeat(t_s, process))

    def hold(self, cause: str) -> None:
        """Hold for a fault that readings do not show: a loop that stood still, or a second guard."""
        self._latch.hold(self._known.t_s, Stop.BRAKE, cause)

    def propose(self, command: TrackCommand | SeatCommand | VelocityCommand) -> None:
        """Update with the command of the driver, of the seat's leveller, or of a joystick or another planner."""
        if not self._admission.stamps.accept(command, "a block"):
            self._latch.reject(self._known.t_s, self._admission.stamps.rejection)
        elif isinstance(command, SeatCommand):
            self._propose_seat(command)
        elif isinstance(command, VelocityCommand):
            self._velocity = command
        else:
            self._propose_belts(command, "driver")

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> Commands:
        """Return the commands to the plant at ``t_s``: the proposals within their limits, or those of a held chair.

        Levelling continues under HOLD; a faulty seat is stopped, and the flipper of a held chair.
        """
        if not math.isfinite(t_s):
            t_s = self._known.t_s
            self._latch.hold(t_s, Stop.BRAKE, "mission clock is not finite")
        self.advance(t_s)
        known = self._known
        self._choose_source(t_s)
        self._tick(t_s)
        if estimate is not None and self._take(estimate, "a block"):
            known.estimate = estimate
        known.passed = self._limited(t_s)
        for monitor in self._watches.values():
            self._latch.hold(t_s, monitor.stop, monitor.cause(known))
        if self._latch.cause is not None:
            expected_m_s = next(monitor.expected_m_s for monitor in self._watches.values() if isinstance(monitor, BeltMonitor))
            known.passed = self._latch.stop(t_s, expected_m_s)
        return Commands(known.passed, self._seat_now(t_s), self._flipper_now(t_s))

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        return self._latch.take()

    # Readings

    def _take(self, message: Stamped, by: str = "") -> bool:
        """Let the monitors hear a message, or why it was rejected; return whether it may be used.

        A sensor's clock that leapt holds at once. Images are judged by their quality, which is heard also where they cannot be
        used. A map may arrive as a reading and from a block; each has a series of stamps.

        Args:
            by: Sender of what is no reading.
        """
        known, admission, is_reading = self._known, self._admission, not by
        known.is_reading = is_reading
        accepted = admission.accept(message, by)
        if not accepted:
            self._latch.reject(known.t_s, admission.stamps.rejection)
        usable = accepted and (not is_reading or admission.is_sound(message))
        if usable or (isinstance(message, FrameQuality) and (accepted or admission.fault)):
            self._hear(message)
            return usable
        if is_reading:
            self._latch.hold(known.t_s, Stop.BRAKE, admission.stamps.leap)
        for monitor in self._hearers.get(type(message), ()):
            monitor.reject(message, known, admission.fault)
        return False

    def _hear(self, message: Stamped) -> None:
        """Let the monitors hear an accepted message, once if it arrives twice: as a reading, and as a message."""
        match message:
            case SeatReading():
                self._seat_rad = message.pitch_rad
            case MotionPlan():
                self._known.plan = message
            case FrameQuality():
                self._report_light(message)
            case StairMap():
                if not message.t_s > self._map_s:
                    return
                self._map_s = message.t_s
        for monitor in self._hearers.get(type(message), ()):
            monitor.hear(message, self._known)

    def _report_light(self, quality: FrameQuality) -> None:
        is_dark = self._known.frames.is_dark
        if is_dark != self._is_dark:
            shown = f"colours of mean {quality.brightness:.2f}, contrast {quality.contrast:.3f}"
            self._latch.report(self._known.t_s, "vision_dim" if is_dark else "vision_clear", shown)
        self._is_dark = is_dark

    def _obey(self, operator: OperatorInput) -> bool:
        """Update with the operator: stop and a released dead-man switch hold whatever their age; re-arm ends a hold."""
        new = self._take(operator)
        pressed = new and self._button.press(operator, self._latch.held_s)
        if operator.stop:
            self._latch.hold(self._known.t_s, Stop.ZERO, "operator stop")
        elif not operator.dead_man:
            self._latch.hold(self._known.t_s, Stop.ZERO, "the dead-man switch is released")
        elif pressed:
            self._rearm(self._known.t_s)
        return new

    def _rearm(self, t_s: float) -> None:
        """End the hold, and start all timeouts and monitors again; the chair stands until a new command arrives.

        Not if the last re-arm was just now, or what must speak is silent: the chair would be held again.
        """
        silent = (monitor.cause(self._known) for monitor in self._watches.values() if isinstance(monitor, Silence))
        against = next((cause for cause in silent if cause is not None), None)
        if t_s - self._known.rearmed_s < AGAIN_S:
            against = f"the last re-arm was {t_s - self._known.rearmed_s:.1f} s ago"
        if against is not None:
            self._latch.report(t_s, "rearm_refused", against)
            return
        self._latch.release(t_s)
        self._known.rearmed_s = t_s
        self._stand(t_s)
        for monitor in self._watches.values():
            monitor.restart(self._known)

    # Plans and commands

    def _choose_source(self, t_s: float) -> None:
        """Let velocity commands move the belts while they come and no traversal is under way, otherwise the driver.

        After a change the chair stands until a new command of the source arrives.
        """
        plan = self._known.plan
        under_way = self.config.has_planner if plan is None else plan.phase not in ENDS
        velocity = None if under_way else self._velocity
        if velocity is not None and t_s - velocity.t_s > self.config.driver_timeout_s:
            velocity = None
        source: CommandSource = "driver" if velocity is None else "velocity"
        if source != self.source:
            self._known.source = source
            self._latch.report(t_s, "source", "the driver" if velocity is None else "velocity commands: no traversal is under way")
            self._stand(t_s)
        if velocity is not None:
            half_m_s = 0.5 * velocity.turn_rad_s * self.config.gauge_m
            speed = velocity.speed_m_s
            self._propose_belts(TrackCommand(t_s=velocity.t_s, left_m_s=speed - half_m_s, right_m_s=speed + half_m_s), "velocity")

    def _propose_belts(self, command: TrackCommand, source: CommandSource) -> None:
        """Keep a command of the belts if it is of their source, and not of before the source began."""
        if not finite(command.left_m_s, command.right_m_s):
            self._latch.hold(self._known.t_s, Stop.BRAKE, "command is not finite")
        elif source == self.source and command.t_s >= self._begun_s:
            self._known.commanded_s, self._command = min(command.t_s, self._known.t_s), command

    def _stand(self, t_s: float) -> None:
        """Let the chair stand until a new command arrives."""
        self._known.commanded_s = self._begun_s = t_s
        self._command = TrackCommand.stop(t_s)

    def _propose_seat(self, command: SeatCommand) -> None:
        """Keep a seat command within its limits.

        In phases of constant pitch a seat near horizontal moves slowly, so that it does not excite rocking over uneven steps.
        """
        if not finite(command.rate_m_s):
            self._latch.hold(self._known.t_s, Stop.BRAKE, "seat rate is not finite")
            return
        limit = self.config.seat_rate_m_s or 0.0
        plan = self._known.plan
        if plan is not None and plan.phase in STEADY and abs(self._seat_rad) <= self.config.level_rad:
            limit = min(limit, self.config.seat_steady_m_s)
        rate_m_s = min(max(command.rate_m_s, -limit), limit)
        self._seat_command = command if rate_m_s == command.rate_m_s else replace(command, rate_m_s=rate_m_s)

    def _seat_now(self, t_s: float) -> SeatCommand:
        """Return the seat command in force: a rate that answers an old reading would carry the seat past level."""
        command = self._seat_command
        if not self._is_fresh(command.t_s, t_s):
            return SeatCommand(t_s=t_s, rate_m_s=0.0)
        seat = self._watches.get(SeatMonitor)
        return command if seat is None or seat.cause(self._known) is None else replace(command, rate_m_s=0.0)

    def _flipper_now(self, t_s: float) -> FlipperCommand | None:
        """Return the flipper command of the newest plan, within its limit; None without one, or with an old one."""
        plan = self._known.plan
        command = None if plan is None or not self._is_fresh(plan.t_s, t_s) else plan.flipper
        if command is None:
            return None
        limit = self.config.flipper_rate_rad_s or 0.0
        rate_rad_s = 0.0 if self._latch.cause is not None else min(max(command.rate_rad_s, -limit), limit)
        return FlipperCommand(t_s=t_s, rate_rad_s=rate_rad_s)

    def _is_fresh(self, commanded_s: float, t_s: float) -> bool:
        return abs(t_s - commanded_s) <= self.config.ahead_s + ROUNDING_S

    def _tick(self, t_s: float) -> None:
        """Record a tick. Silence cannot be attributed to a source while the guard itself did not run."""
        known = self._known
        if self._t_s is None:
            self._t_s = known.commanded_s = t_s
            for rule in RULES:
                if rule.applies(self.config) and not rule.is_watched(self.config):
                    self._latch.report(t_s, *rule.unwatched)
        known.passed_s, self._t_s = t_s - self._t_s, t_s
        if known.passed_s < -self.config.clock_jump_s:
            self._admission.stamps.restart()  # whoever stamps by the clock that leapt is heard, so that a person can re-arm
        if known.passed_s > self.config.silence_s:
            for monitor in self._watches.values():
                if isinstance(monitor, Silence):
                    monitor.excuse(known.passed_s)

    def _limited(self, t_s: float) -> TrackCommand:
        """Return the proposal within the limits of heading, phase and speed restrictions."""
        limits, known, plan = self.config, self._known, self._known.followed
        late_s = max(known.passed_s, t_s - known.commanded_s)
        restrictions = (monitor.restriction(known) for monitor in self._watches.values())
        restriction = next((restriction for restriction in restrictions if restriction is not None), None)
        late = ("late", f"no command or tick for {late_s:.2f} s") if late_s > 0.5 * limits.driver_timeout_s else None
        known.missing = restriction[1] if restriction is not None and restriction[0] in ("imu", "camera") else ""
        self._latch.slow(t_s, *(restriction or late or ("", "nothing is missing any more")))
        if plan is not None and stands(plan):
            return TrackCommand(t_s=t_s, left_m_s=0.0, right_m_s=0.0, brake=plan.phase in ENDS)
        ramp = (limits.driver_timeout_s - late_s) / (0.5 * limits.driver_timeout_s)
        return limited(
            self._command,
            t_s,
            mean_limit(limits, known.estimate, plan, restricted=restriction is not None),
            limits.belt_limit_m_s,
            min(max(ramp, 0.0), 1.0),
        )
