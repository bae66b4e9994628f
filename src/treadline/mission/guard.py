"""The last block before the plant: lets a command pass, limits it, or holds.

``TrackCommand -> TrackCommand``. It trusts nobody: a command or an estimate that is not finite, a sensor that has gone
silent or a driver that no longer answers ends in HOLD (zero speed, brake), which stays until a person re-arms.
This is the minimum that a stair asks for; it makes no claim to any safety standard.
"""

import math
from dataclasses import dataclass

from treadline.angles import DEG
from treadline.signals import Event, HeadingEstimate, OperatorInput, SeatCommand, TrackCommand


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardConfig:
    """Limits, each with its reason."""

    belt_limit_m_s: float = 1.0
    """Table I: v_system(max)."""
    cruise_limit_m_s: float = 0.30
    """Mean of the belts when square to the stair: what can be stopped within a step."""
    turn_limit_m_s: float = 0.55
    """Mean of the belts while turning back to square: a turn with one belt at its limit needs it."""
    turning_rad: float = 5.0 * DEG
    """Beyond this heading the turn limit holds instead of the cruise limit."""
    blind_limit_m_s: float = 0.10
    """Mean of the belts while no frame arrives."""
    imu_timeout_s: float = 0.05
    frame_timeout_s: float = 0.3
    blind_timeout_s: float = 3.0
    """Without any frame."""
    estimate_timeout_s: float = 0.3
    """Between the estimate's own time and now, either way: a clock that leapt, a gyro that is dead."""
    lost_timeout_s: float = 12.0
    """Frames arrive but none shows a stair: the gyro carries the heading this long."""
    driver_timeout_s: float = 0.75
    """Three control periods."""
    needs_heading: bool = True
    """False only for runs whose purpose is to drive without: open loop."""


class Guard:
    """Latched HOLD over a command stream."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._imu_s = 0.0
        self._frame_s = 0.0
        self._seen_s = 0.0
        self._driver_s = 0.0
        self._command = TrackCommand.stop(0.0)
        self._hold: str | None = None
        self._slow = False
        self._events: list[Event] = []

    @property
    def holding(self) -> str | None:
        """Why the guard holds, or None."""
        return self._hold

    def imu_arrived(self, t_s: float) -> None:
        """Note a finite IMU sample."""
        self._imu_s = max(self._imu_s, t_s)

    def frame_arrived(self, t_s: float) -> None:
        """Note a frame, whatever it shows."""
        self._frame_s = max(self._frame_s, t_s)

    def stair_seen(self, t_s: float) -> None:
        """Note a heading measured from a frame."""
        self._seen_s = max(self._seen_s, t_s)

    def operator(self, operator: OperatorInput) -> None:
        """Obey the person: stop and a released dead-man hold; re-arm ends a hold."""
        if operator.stop or not operator.dead_man:
            self._latch(operator.t_s, "operator stop")
        elif operator.rearm and self._hold is not None:
            self._events.append(Event(t_s=operator.t_s, name="rearmed", cause=f"by a person, after: {self._hold}"))
            self._hold = None
            self._imu_s = self._frame_s = self._seen_s = self._driver_s = operator.t_s

    def propose(self, command: TrackCommand) -> None:
        """Take the driver's newest command."""
        self._driver_s = command.t_s
        if not (math.isfinite(command.left_m_s) and math.isfinite(command.right_m_s)):
            self._latch(command.t_s, "command is not finite")
            return
        self._command = command

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> TrackCommand:
        """Return what may reach the belts at ``t_s``."""
        cause = self._alarm(t_s, estimate)
        if cause is not None:
            self._latch(t_s, cause)
        if self._hold is not None:
            return TrackCommand.stop(t_s)
        return self._limited(t_s, estimate)

    def pass_seat(self, command: SeatCommand) -> SeatCommand:
        """Return what may reach the seat: the leveller goes on under HOLD, a rate that is no number does not pass."""
        if math.isfinite(command.rate_m_s):
            return command
        self._latch(command.t_s, "seat rate is not finite")
        return SeatCommand(t_s=command.t_s, rate_m_s=0.0)

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    def _alarm(self, t_s: float, estimate: HeadingEstimate | None) -> str | None:
        limits = self._config
        if t_s - self._driver_s > limits.driver_timeout_s:
            return f"no command for {t_s - self._driver_s:.2f} s"
        if not limits.needs_heading:
            return None
        if t_s - self._imu_s > limits.imu_timeout_s:
            return f"no IMU sample for {t_s - self._imu_s:.2f} s"
        if t_s - self._frame_s > limits.blind_timeout_s:
            return f"no frame for {t_s - self._frame_s:.1f} s"
        if t_s - self._seen_s > limits.lost_timeout_s:
            return f"no stair in view for {t_s - self._seen_s:.1f} s"
        if estimate is not None and not (math.isfinite(estimate.heading_rad) and math.isfinite(estimate.heading_rate_rad_s)):
            return "heading estimate is not finite"
        if estimate is not None and abs(t_s - estimate.t_s) > limits.estimate_timeout_s:
            return f"heading estimate is {t_s - estimate.t_s:+.2f} s old"
        return None

    def _limited(self, t_s: float, estimate: HeadingEstimate | None) -> TrackCommand:
        limits = self._config
        turning = estimate is None or abs(estimate.heading_rad) > limits.turning_rad
        mean_limit = limits.turn_limit_m_s if turning else limits.cruise_limit_m_s
        blind = limits.needs_heading and t_s - self._frame_s > limits.frame_timeout_s
        if blind:
            mean_limit = limits.blind_limit_m_s
        self._note_slow(t_s, slow=blind)
        command = self._command.limited(limits.belt_limit_m_s)
        mean = 0.5 * (command.left_m_s + command.right_m_s)
        # Common speed yields, steering keeps: both belts move by the same amount.
        shift = min(max(mean, -mean_limit), mean_limit) - mean
        return TrackCommand(
            t_s=t_s,
            left_m_s=command.left_m_s + shift,
            right_m_s=command.right_m_s + shift,
            brake=command.brake,
        ).limited(limits.belt_limit_m_s)

    def _note_slow(self, t_s: float, *, slow: bool) -> None:
        if slow != self._slow:
            cause = f"no frame for {t_s - self._frame_s:.2f} s" if slow else "frames are back"
            self._events.append(Event(t_s=t_s, name="slow" if slow else "resumed", cause=cause))
        self._slow = slow

    def _latch(self, t_s: float, cause: str) -> None:
        if self._hold is None:
            self._hold = cause
            self._events.append(Event(t_s=t_s, name="hold", cause=cause))
