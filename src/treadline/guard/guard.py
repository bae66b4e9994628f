"""The guard: connects the monitors of readings, plans and proposals, and decides which commands reach the plant.

``reading -> bool``, whether it may be used; ``plan, health, map, proposals -> Commands`` at each tick.

One rule for the stamp of every message (``_stamps``), physical bounds of what messages say (``_bounds``): a message that breaks
either is rejected and counted, and an event reports each kind once in ten seconds. What must speak is awaited from the first tick,
and again after each re-arm. The guard computes with plain numbers.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from treadline.core.signals import (
    ROUNDING_S,
    TICK_S,
    CommandSource,
    Event,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
    VelocityCommand,
)
from treadline.guard._admission import ReadingAdmission
from treadline.guard._attitude_limits import SeatMonitor, TiltMonitor
from treadline.guard._belt_monitor import BeltMonitor
from treadline.guard._bounds import finite
from treadline.guard._drop_monitor import DropMonitor
from treadline.guard._guard_config import ENDS, FLIGHT, STEADY, GuardConfig
from treadline.guard._gyro_only_turn import GyroOnlyTurn, heading_fault
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._obstacle_monitor import AheadMonitor
from treadline.guard._sensor_timeouts import MapMonitor, SensorTimeouts, SilenceMonitor
from treadline.guard._slip_monitor import SlipMonitor
from treadline.guard._speed_limits import limited, mean_limit, stands
from treadline.guard._stamps import Stamped
from treadline.guard.stop_latch import AGAIN_S, Latch, Rearm

SOURCES: dict[type, str] = {TrackReading: "belts", SeatReading: "seat", FlipperReading: "flipper"}
"""Name of the drive of each reading."""


class Commands(NamedTuple):
    """Commands of one tick to the plant, in the order of ``Plant.write``."""

    tracks: TrackCommand
    seat: SeatCommand
    flipper: FlipperCommand | None
    """None stops the flipper, as does a rate of zero."""


class Guard:
    """Supervisor with a latched HOLD over the command stream."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._latch, self._button = Latch(config), Rearm()
        self._admission = ReadingAdmission(config)
        self._senses = SensorTimeouts(config)
        self._belts = BeltMonitor(config)
        self._slip = SlipMonitor(config)
        self._ahead = AheadMonitor(config)
        self._drop = DropMonitor(config)
        self._blind = GyroOnlyTurn(config)
        self._tilt = TiltMonitor(config)
        self._seat = SeatMonitor(config)
        self._seat_rad = 0.0
        self._is_dark = False
        self._link = SilenceMonitor(config.silence_s)
        self._plans = SilenceMonitor(config.silence_s, awaited=("plan",) if config.has_planner else ())
        self._processes = SilenceMonitor(config.heartbeat_timeout_s, "process ")
        self._estimates = SilenceMonitor(config.silence_s)
        self._healths, self._maps = SilenceMonitor(config.silence_s), MapMonitor(config.blind_timeout_s)
        self._estimate: HeadingEstimate | None = None
        limits = (config.belt_limit_m_s, config.seat_rate_m_s, config.flipper_rate_rad_s)
        drives = [name for name, limit in zip(SOURCES.values(), limits, strict=True) if limit is not None]
        self._drives = SilenceMonitor(config.silence_s, "readings of the ", drives)
        self._silences = (self._plans, self._processes, self._drives, self._estimates, self._healths)
        """Monitors of what must speak, but for the operator's link: a silent one refuses a re-arm, which starts them anew."""
        self._sources: dict[type, tuple[SilenceMonitor, str]] = {
            **{kind: (self._drives, name) for kind, name in SOURCES.items()},
            **({MotionPlan: (self._plans, "plan")} if config.has_planner else {}),
            HeadingEstimate: (self._estimates, "heading estimate"),
            HeadingHealth: (self._healths, "health of the heading"),
            OperatorInput: (self._link, "operator link"),
        }
        """Monitor and name of each type of message whose silence is a fault."""
        self._command = TrackCommand.stop(0.0)
        self._seat_command = SeatCommand(t_s=-math.inf, rate_m_s=0.0)
        self._now_s = self._driver_s = 0.0
        self._t_s: float | None = None
        self._same_ticks = 0
        """Number of ticks at one time."""
        self._velocity: VelocityCommand | None = None
        self._map_s = self._rearmed_s = self._begun_s = -math.inf
        self._heading_rad = math.inf
        self._plan: MotionPlan | None = None
        self.source: CommandSource = "driver"
        """Whose commands move the belts."""

    @property
    def config(self) -> GuardConfig:
        """Limits of the guard."""
        return self._config

    @property
    def holding(self) -> str | None:
        """Cause of the HOLD, or None."""
        return self._latch.cause

    @property
    def rejected(self) -> Mapping[str, int]:
        """Number of messages rejected for their stamp or their content, by kind."""
        return self._admission.stamps.rejected

    def advance(self, t_s: float) -> None:
        """Set the guard's clock at the start of a tick; the stamps of the tick's messages are compared with it."""
        if math.isfinite(t_s):
            self._now_s = t_s
            self._admission.advance(t_s)

    def admit(self, reading: Stamped) -> bool:
        """Return whether other blocks may use a reading; the guard receives each reading first."""
        if isinstance(reading, OperatorInput):
            return self._obey(reading)
        accepted = self._accepts(reading)
        usable = accepted and self._admission.is_sound(reading)
        if isinstance(reading, FrameQuality) and (accepted or self._admission.fault):
            self._update_frame(reading, usable=usable)
        elif usable:
            self._update(reading)
        else:
            self._note_fault(reading)
        return usable

    def on_message(self, message: HeadingMeasurement | StairMap | HeadingHealth | MotionPlan) -> bool:
        """Update with a message that other blocks computed from readings; return whether it is accepted."""
        if isinstance(message, MotionPlan):
            self._latch.hold(self._now_s, Stop.RAMP, message.hold)  # a hold is valid whatever its stamp
        # A map may arrive as a reading and as a message; each has a series of stamps.
        if not self._accepts(message, "a block"):
            return False
        match message:
            case HeadingMeasurement():
                self._see(message.t_s)
            case StairMap():
                self._look_ahead(message)
            case HeadingHealth():
                mended = self._senses.health(message)
                if mended is not None:
                    self._latch.report(self._now_s, mended.name, mended.cause)
            case _:
                self._follow(message)
        return True

    def beat(self, process: str, t_s: float) -> None:
        """Record the heartbeat of a process; its next ones are then expected."""
        self._processes.heard(process, t_s)

    def hold(self, cause: str) -> None:
        """Hold for a fault that readings do not show: a loop that stood still, or a second guard."""
        self._latch.hold(self._now_s, Stop.BRAKE, cause)

    def propose(self, command: TrackCommand | SeatCommand | VelocityCommand) -> None:
        """Update with the command of the driver, of the seat's leveller, or of a joystick or another planner."""
        if not self._admission.stamps.accept(command, "a block"):
            self._report_rejection()
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
            t_s = self._now_s
            self._latch.hold(t_s, Stop.BRAKE, "mission clock is not finite")
        self.advance(t_s)
        self._choose_source(t_s)
        late_s = self._lateness(t_s)
        if estimate is not None and self._accepts(estimate, "a block"):
            self._estimate, self._heading_rad = estimate, estimate.heading_rad
        for stop, cause in self._alarms(t_s):
            self._latch.hold(t_s, stop, cause)
        passed = self._limited(t_s, late_s)
        travel_m, mean_m_s = self._belts.travel.travel_m, 0.5 * (passed.left_m_s + passed.right_m_s)
        self._latch.hold(t_s, Stop.BRAKE, self._ahead.cause(travel_m, mean_m_s))
        if self._config.watches_motion and self._config.awaits_ground:
            drop = self._drop.cause(t_s, travel_m, mean_m_s, self._followed, self._heading_rad)
            self._latch.hold(t_s, Stop.BRAKE, drop)
        if self._latch.cause is not None:
            passed = self._latch.stop(t_s, self._belts.expected_m_s)
        self._belts.ask(passed)
        return Commands(passed, self._seat_now(t_s), self._flipper_now(t_s))

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        return self._latch.take()

    # Readings

    def _accepts(self, message: Stamped, by: str = "") -> bool:
        """Return whether stamp and content of a message are acceptable.

        Of what must speak an accepted message ends the silence, and the reason of a rejection is kept for the cause of a hold.
        """
        accepted = self._admission.accept(message, by)
        monitor, source = self._sources.get(type(message), (None, ""))
        if monitor is not None and accepted:
            monitor.heard(source, message.t_s)
        elif monitor is not None:
            monitor.rejected(source, self._admission.fault)
        if not accepted:
            self._report_rejection()
        return accepted

    def _report_rejection(self) -> None:
        rejection = self._admission.stamps.rejection
        if rejection is not None:
            self._latch.reject(self._now_s, rejection)

    def _note_fault(self, reading: Stamped) -> None:
        """Note why a reading was rejected, for the cause of a hold when this lasts; a sensor's clock that leapt holds at once."""
        fault = self._admission.fault
        self._latch.hold(self._now_s, Stop.BRAKE, self._admission.stamps.leap)
        if isinstance(reading, HeadingMeasurement | StairMap):
            self._senses.refused = fault or self._admission.frames.refused
        elif isinstance(reading, ImuSample):
            self._senses.imu_fault = fault

    def _update(self, signal: Stamped) -> None:
        match signal:  # images are judged by their FrameQuality, and the flipper's angle is not used
            case ImuSample():
                self._update_motion(signal)
            case TrackReading():
                self._belts.update(signal)
                self._blind.update_belts(signal.t_s, signal.right_m_s - signal.left_m_s, self._followed)
            case SeatReading():
                self._seat_rad = signal.pitch_rad
                if self._config.watches_motion:
                    self._seat.update(signal.t_s, signal.pitch_rad)
            case PlantState():
                self._note_brake(signal)
            case HeadingMeasurement():
                self._update_sight(signal.t_s)
                self._see(signal.t_s)
            case StairMap():
                self._update_sight(signal.t_s)
                self._look_ahead(signal)
            case FreeGround():
                self._drop.look(signal, self._belts.travel.at(signal.t_s)[0])

    def _note_brake(self, state: PlantState) -> None:
        """Hold where the plant braked by itself; the button to re-arm may reach the plant a moment after the guard."""
        lasts = state.t_s - self._rearmed_s > self._config.ahead_s
        if state.fault is not None and lasts and self._config.watches_motion:
            self._latch.hold(self._now_s, Stop.BRAKE, f"the plant braked by itself: {state.fault}")

    def _update_motion(self, sample: ImuSample) -> None:
        orientation, pitch_rate = sample.orientation, -sample.angular_velocity_rad_s[1]
        self._senses.imu(sample.t_s)
        self._drop.update_motion(sample.t_s, sample.pitch_rad)
        self._blind.update_motion(sample.t_s, orientation, pitch_rate)
        if self._config.watches_motion and self._config.needs_heading:
            self._tilt.update(sample.t_s, orientation, pitch_rate)

    def _update_frame(self, quality: FrameQuality, *, usable: bool) -> None:
        frames = self._admission.frames
        if frames.is_dark != self._is_dark:
            shown = f"colours of mean {quality.brightness:.2f}, contrast {quality.contrast:.3f}"
            self._latch.report(self._now_s, "vision_clear" if self._is_dark else "vision_dim", shown)
        self._is_dark = frames.is_dark
        self._senses.refused = frames.refused
        travel_m, _ = self._belts.travel.at(quality.t_s)
        needs_stair = self._plan is None or self._plan.needs_stair
        if usable or (frames.is_alive and not needs_stair):
            self._senses.frame(quality.t_s, travel_m)
        if usable:
            self._ahead.look_on(quality.obstacle_m, travel_m)

    def _see(self, t_s: float) -> None:
        """Record a measured heading; from then on an estimate is awaited."""
        self._senses.seen(t_s)
        self._blind.seen(t_s)
        self._maps.seen(t_s)
        self._estimates.expect("heading estimate")
        if self._config.awaits_health:
            self._healths.expect("health of the heading")

    def _update_sight(self, t_s: float) -> None:
        """Record a measurement of a camera without images as a frame."""
        self._senses.refused = self._admission.frames.refused
        self._senses.frame(t_s, self._belts.travel.at(t_s)[0])

    def _look_ahead(self, stair: StairMap) -> None:
        # A map may arrive twice: as a reading, and as a message.
        if not stair.t_s > self._map_s:
            return
        self._map_s = stair.t_s
        self._maps.forget()
        sign = 1.0 if self._config.view == "front" else -1.0
        travel_m, slow_travel_m = self._belts.travel.at(stair.t_s)
        places = [(sign * x, z) for x, _, z in stair.nosings_B]
        self._ahead.look(stair, places, sign * travel_m)
        self._drop.look_on_stair(stair, travel_m)
        # In other phases the chair pitches, or is on flat ground, and nosings do not pass at belt speed.
        plan = self._followed
        # A chair that climbs to turn square, with its camera on the flight below, does not roll back.
        on_flight = plan is None or (plan.phase in FLIGHT and (stair.direction == "up") == (plan.speed_m_s >= 0.0))
        if self._config.watches_slip and on_flight and math.isfinite(self._heading_rad):
            across = math.cos(self._heading_rad)
            there_m, ahead_m = [place * across for place, _ in places], 2.0 * sign * (travel_m - slow_travel_m)
            self._slip.look(stair.t_s, there_m, sign * slow_travel_m, self._heading_rad, ahead_m)
        else:
            self._slip.forget()

    def _obey(self, operator: OperatorInput) -> bool:
        """Update with the operator: stop and a released dead-man switch hold whatever their age; re-arm ends a hold."""
        new = self._accepts(operator)
        self._link.expect("operator link")
        self._latch.hold(self._now_s, Stop.BRAKE, self._admission.stamps.leap)
        pressed = new and self._button.press(operator, self._latch.held_s)
        if operator.stop:
            self._latch.hold(self._now_s, Stop.ZERO, "operator stop")
        elif not operator.dead_man:
            self._latch.hold(self._now_s, Stop.ZERO, "the dead-man switch is released")
        elif pressed:
            self._rearm(self._now_s)
        return new

    def _rearm(self, t_s: float) -> None:
        """End the hold, unless the last re-arm was just now, or what must speak is silent: the chair would be held again."""
        silent = (silence.cause(t_s) for silence in self._silences)
        against = next((cause for cause in silent if cause is not None), None)
        if t_s - self._rearmed_s < AGAIN_S:
            against = f"the last re-arm was {t_s - self._rearmed_s:.1f} s ago"
        if against is not None:
            self._latch.report(t_s, "rearm_refused", against)
            return
        self._latch.release(t_s)
        self._restart(t_s)

    def _restart(self, t_s: float) -> None:
        """Start all timeouts and monitors again, except those of obstacles and gaps.

        The chair stands until a new command arrives; proposals from before the hold are discarded.
        """
        self._rearmed_s = t_s
        self._stand(t_s)
        self._admission.stamps.restart()
        self._senses.restart(t_s, self._belts.travel.travel_m)
        for silence in (self._link, *self._silences):
            silence.restart(t_s)
        for watch in (self._maps, self._belts, self._slip, self._blind, self._tilt, self._seat):
            watch.forget()

    # Plans and commands

    def _follow(self, plan: MotionPlan) -> None:
        self._plan = plan
        if plan.phase not in FLIGHT and self.source == "driver":
            self._slip.begin()
        if not plan.needs_stair:
            self._senses.seen(plan.t_s)

    @property
    def _followed(self) -> MotionPlan | None:
        """The plan that the belts follow; None while velocity commands move them."""
        return self._plan if self.source == "driver" else None

    def _choose_source(self, t_s: float) -> None:
        """Let velocity commands move the belts while they come and no traversal is under way, otherwise the driver.

        After a change the chair stands until a new command of the source arrives.
        """
        under_way = self._config.has_planner if self._plan is None else self._plan.phase not in ENDS
        velocity = None if under_way else self._velocity
        if velocity is not None and t_s - velocity.t_s > self._config.driver_timeout_s:
            velocity = None
        source: CommandSource = "driver" if velocity is None else "velocity"
        if source != self.source:
            self.source = source
            self._latch.report(t_s, "source", "the driver" if velocity is None else "velocity commands: no traversal is under way")
            self._slip.begin()
            self._stand(t_s)
        if velocity is not None:
            half_m_s = 0.5 * velocity.turn_rad_s * self._config.gauge_m
            speed = velocity.speed_m_s
            self._propose_belts(TrackCommand(t_s=velocity.t_s, left_m_s=speed - half_m_s, right_m_s=speed + half_m_s), "velocity")

    def _propose_belts(self, command: TrackCommand, source: CommandSource) -> None:
        """Keep a command of the belts if it is of their source, and not of before the source began."""
        if not finite(command.left_m_s, command.right_m_s):
            self._latch.hold(self._now_s, Stop.BRAKE, "command is not finite")
        elif source == self.source and command.t_s >= self._begun_s:
            self._driver_s, self._command = min(command.t_s, self._now_s), command

    def _stand(self, t_s: float) -> None:
        """Let the chair stand until a new command arrives."""
        self._driver_s = self._begun_s = t_s
        self._command = TrackCommand.stop(t_s)

    def _propose_seat(self, command: SeatCommand) -> None:
        """Keep a seat command within its limits.

        In phases of constant pitch a seat near horizontal moves slowly, so that it does not excite rocking over uneven steps.
        """
        if not finite(command.rate_m_s):
            self._latch.hold(self._now_s, Stop.BRAKE, "seat rate is not finite")
            return
        limit = self._config.seat_rate_m_s or 0.0
        if self._plan is not None and self._plan.phase in STEADY and abs(self._seat_rad) <= self._config.level_rad:
            limit = min(limit, self._config.seat_steady_m_s)
        rate_m_s = min(max(command.rate_m_s, -limit), limit)
        self._seat_command = command if rate_m_s == command.rate_m_s else replace(command, rate_m_s=rate_m_s)

    def _seat_now(self, t_s: float) -> SeatCommand:
        """Return the seat command in force: a rate that answers an old reading would carry the seat past level."""
        command = self._seat_command
        if not self._is_fresh(command.t_s, t_s):
            return SeatCommand(t_s=t_s, rate_m_s=0.0)
        return command if self._seat.cause is None else replace(command, rate_m_s=0.0)

    def _flipper_now(self, t_s: float) -> FlipperCommand | None:
        """Return the flipper command of the newest plan, within its limit; None without one, or with an old one."""
        command = None if self._plan is None or not self._is_fresh(self._plan.t_s, t_s) else self._plan.flipper
        if command is None:
            return None
        limit = self._config.flipper_rate_rad_s or 0.0
        rate_rad_s = 0.0 if self._latch.cause is not None else min(max(command.rate_rad_s, -limit), limit)
        return FlipperCommand(t_s=t_s, rate_rad_s=rate_rad_s)

    def _is_fresh(self, commanded_s: float, t_s: float) -> bool:
        return abs(t_s - commanded_s) <= self._config.ahead_s + ROUNDING_S

    def _lateness(self, t_s: float) -> float:
        """Record a tick; return the time since the previous tick or since the last command, whichever is longer [s]."""
        if self._t_s is None:
            self._t_s = self._driver_s = t_s
            for is_awaited, name, unwatched in self._unwatched:
                if not is_awaited:
                    self._latch.report(t_s, f"{name}_unwatched", unwatched)
        passed_s, self._t_s = t_s - self._t_s, t_s
        self._same_ticks = self._same_ticks + 1 if passed_s == 0.0 else 0
        if self._same_ticks * TICK_S > self._config.silence_s:
            self._latch.hold(t_s, Stop.BRAKE, f"mission clock stands still at {t_s:.2f} s")
        if passed_s < -self._config.clock_jump_s:
            self._latch.hold(t_s, Stop.BRAKE, f"mission clock leapt by {passed_s:+.2f} s")
        if passed_s > self._config.silence_s:
            # Silence cannot be attributed to a source while the guard itself did not run.
            for silence in (self._drives, self._plans, self._estimates, self._healths):
                silence.excuse(passed_s)
        if passed_s > self._config.driver_timeout_s:
            self._latch.hold(t_s, Stop.BRAKE, f"no tick for {passed_s:.2f} s")
        return max(passed_s, t_s - self._driver_s)

    @property
    def _unwatched(self) -> tuple[tuple[bool, str, str], ...]:
        """What a block may send, whether it is awaited, and what is not watched without it."""
        limits, is_open_loop = self._config, not self._config.needs_heading
        drop = "the camera does not report where the ground ends: no stop before a drop"
        stair = "the detector sends no maps: no stop before what stands on the flight, or a gap"
        health = "the estimator does not report its health: no hold for a gyro that errs"
        return (
            (limits.awaits_ground, "drop", drop),
            (limits.awaits_map or is_open_loop, "map", stair),
            (limits.awaits_health or is_open_loop, "health", health),
        )

    def _alarms(self, t_s: float) -> Iterator[tuple[Stop, str | None]]:
        """Yield how to stop for each cause, and the cause or None; the guard holds for the first cause.

        Rows are those of the table of hazards.
        """
        limits = self._config
        command_s = t_s - self._driver_s
        # Row 11: stopped 0.8 s after the last command, of which its absence takes 0.75 s.
        yield Stop.BRAKE, f"no command for {command_s:.2f} s" if abs(command_s) > limits.driver_timeout_s else None
        # Row 21: a lost link is an operator's stop, still within 0.10 m.
        yield Stop.BRAKE, self._link.cause(t_s)
        # Row 22: stopped 0.8 s after a process ended, of which its silence takes 0.75 s; an old plan leaves time for a ramp.
        yield Stop.BRAKE, self._processes.cause(t_s)
        yield Stop.RAMP, self._plans.cause(t_s)
        # Row 18: the chair tips, and each centimetre may add to it.
        yield Stop.BRAKE, self._tilt.cause
        # Row 19: the seat is frozen at once.
        yield Stop.RAMP, self._seat.cause
        if limits.watches_motion:
            # Rows 13, 14 and 24: a faulty drive follows no ramp, and 0.25 m of the roll-back of 0.30 m are gone.
            yield Stop.BRAKE, self._drives.cause(t_s)
            yield Stop.BRAKE, self._belts.cause
            yield Stop.BRAKE, self._slip.cause
        if limits.needs_heading:
            phase = None if self._followed is None else self._followed.phase
            # Row 7: belts 0.1 m/s apart turn the chair by 0.3° more over a ramp, of 5° allowed.
            silent, missing = self._estimates.cause(t_s), self._senses.speed_restriction(t_s)
            yield Stop.RAMP, silent if silent is None or missing is None else f"{silent}: {missing[1]}"
            lost = self._senses.alarm(t_s, self._belts.travel.travel_m, phase)
            # Row 9: held within 0.5 s, of which the silence takes 0.3 s. Of one lost sense the other carries the heading.
            yield Stop.BRAKE if self._senses.both_lost(t_s) else Stop.RAMP, lost
            yield Stop.RAMP, self._healths.cause(t_s)
            # Row 25: without maps nothing watches the flight for obstacles and gaps.
            yield Stop.RAMP, self._maps.cause if limits.awaits_map else None
            yield Stop.RAMP, self._blind.cause
            yield Stop.RAMP, heading_fault(limits, self._estimate, self._followed)

    def _limited(self, t_s: float, late_s: float) -> TrackCommand:
        limits, plan = self._config, self._followed
        kind, cause = self._speed_restriction(t_s, late_s)
        self._latch.slow(t_s, kind, cause)
        if plan is not None and stands(plan):
            return TrackCommand(t_s=t_s, left_m_s=0.0, right_m_s=0.0, brake=plan.phase in ENDS)
        ramp = (limits.driver_timeout_s - late_s) / (0.5 * limits.driver_timeout_s)
        return limited(
            self._command,
            t_s,
            mean_limit(limits, self._estimate, plan, restricted=kind not in ("", "late")),
            limits.belt_limit_m_s,
            min(max(ramp, 0.0), 1.0),
        )

    def _speed_restriction(self, t_s: float, late_s: float) -> tuple[str, str]:
        """Return the speed restriction, as a word and a reason; an empty word if there is none."""
        senses = self._senses.speed_restriction(t_s) if self._config.needs_heading else None
        if senses is not None:
            return senses
        if self._slip.slip > 0.0 and self._config.watches_motion:
            return "slip", f"slip {self._slip.slip:.2f}"
        gap = self._ahead.speed_restriction(self._belts.travel.travel_m)
        if gap is not None:
            return "gap", gap
        if late_s > 0.5 * self._config.driver_timeout_s:
            return "late", f"no command or tick for {late_s:.2f} s"
        return "", "nothing is missing any more"
