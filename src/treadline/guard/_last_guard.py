"""Guard at the actuators, the last one before the drives: for the plant node and for the driver of a real chair (rows 11 and 22).

``TrackCommand | SeatCommand | FlipperCommand -> commands for the drives``. Accepted are finite and fresh commands within the chair
file's limits, from one guard. Silence of the guard, and a second guard, brake the belts until a person re-arms; ``fault`` states
why, and reaches the guard as a reading.
"""

from collections import Counter

from treadline.core.signals import ROUNDING_S, FlipperCommand, OperatorInput, SeatCommand, TrackCommand
from treadline.guard._bounds import finite
from treadline.guard._guard_config import GuardConfig
from treadline.guard._loop_watchdog import STANDSTILL_S
from treadline.guard.stop_latch import Button

Command = TrackCommand | SeatCommand | FlipperCommand
AGE_S = 0.1
"""Longest validity of a rate of seat or flipper, and largest lead of a stamp over the plant's clock [s]: ten ticks, in each of
which the guard repeats the command."""


class LastGuard:
    """Admission of commands at the actuators, and the watchdog over the guard.

    Args:
        config: Limits of the guard, of which those of the chair file apply.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._limits: dict[type, float] = {
            TrackCommand: config.belt_limit_m_s,
            SeatCommand: config.seat_rate_m_s or 0.0,
            FlipperCommand: config.flipper_rate_rad_s or 0.0,
        }
        self._button = Button()
        self.rejected: Counter[str] = Counter()
        """Number of rejected commands, by kind."""
        self._rejection = ""
        self.rearm(0.0)

    def rearm(self, t_s: float) -> None:
        """End a fault: the next guard that speaks drives the chair; commands from before are discarded."""
        self._t_s = self._heard_s = t_s
        self._last: dict[type, Command] = {}
        self._sender: str | None = None
        self._driven = False
        self.fault: str | None = None
        """Reason for which the plant braked by itself; None without one."""

    def operate(self, operator: OperatorInput) -> None:
        """Re-arm where a person presses the button; a button that is stuck, or pressed with a stop, does not count."""
        if self._button.press(down=operator.rearm) and not operator.stop and operator.dead_man and self.fault is not None:
            self.rearm(self._t_s)

    def advance(self, t_s: float) -> None:
        """Set the plant's clock; brake where the guard is silent."""
        self._t_s = t_s
        self.check_silence(t_s - self._heard_s)

    def check_silence(self, silent_s: float) -> None:
        """Brake where the last command came ``silent_s`` ago, by whatever clock; a chair that was never driven has no fault."""
        if self._driven and silent_s > STANDSTILL_S + ROUNDING_S:
            self.trip(f"no command for {silent_s:.2f} s" + self._rejection)

    def trip(self, cause: str) -> None:
        """Brake until a person re-arms; the first cause stays."""
        self.fault = self.fault or cause

    def accept(self, command: Command) -> bool:
        """Return whether a command is accepted."""
        reason = self._rejection_of(command)
        if reason is not None:
            self.rejected[type(command).__name__] += 1
            self._rejection = f"; the last {type(command).__name__} {reason}"
            return False
        self._sender = self._sender or command.sender
        if command.sender != self._sender:
            self.trip(f"two guards send commands, {self._sender} and {command.sender}; stop one of them")
            return False
        self._last[type(command)] = command
        if isinstance(command, TrackCommand):
            self._heard_s, self._rejection = self._t_s, ""
            self._driven |= not command.brake
        return True

    @property
    def is_braking(self) -> bool:
        """Whether the belts are braked whatever was commanded: after a fault, and where the guard is silent."""
        return self.fault is not None or self._t_s - self._heard_s > STANDSTILL_S + ROUNDING_S

    def commands(self) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
        """Return what the drives do now: the accepted commands that are fresh, or the brake."""
        tracks, seat, flipper = (self._last.get(kind) for kind in self._limits)
        if self.is_braking or not isinstance(tracks, TrackCommand):
            return TrackCommand.stop(self._t_s), SeatCommand(t_s=self._t_s, rate_m_s=0.0), None
        oldest_s = tracks.t_s - AGE_S - ROUNDING_S
        return (
            tracks,
            seat if isinstance(seat, SeatCommand) and seat.t_s >= oldest_s else SeatCommand(t_s=tracks.t_s, rate_m_s=0.0),
            flipper if isinstance(flipper, FlipperCommand) and flipper.t_s >= oldest_s else None,
        )

    def _rejection_of(self, command: Command) -> str | None:
        match command:
            case TrackCommand():
                size = max(abs(command.left_m_s), abs(command.right_m_s))
            case SeatCommand():
                size = abs(command.rate_m_s)
            case FlipperCommand():
                size = abs(command.rate_rad_s)
        ahead_s, limit = command.t_s - self._t_s, self._limits[type(command)]
        if not finite(size, ahead_s):
            return "is not finite"
        if size > limit * (1.0 + ROUNDING_S):
            return f"asks for {size:.2f}, {limit:.2f} is the chair's limit"
        if not -STANDSTILL_S - ROUNDING_S <= ahead_s <= AGE_S + ROUNDING_S:
            return f"is stamped {ahead_s:+.2f} s from the plant's clock"
        last = self._last.get(type(command))
        if last is not None and command.t_s <= last.t_s:
            return f"is stamped {command.t_s:.2f} s, no later than the one before"
        return None
