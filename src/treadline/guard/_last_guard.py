"""Guard at the actuators, the last one before the drives: for the plant node and for the driver of a real chair (rows 11 and 22).

``TrackCommand | SeatCommand | FlipperCommand -> commands for the drives``. Accepted are finite and fresh commands within the chair
file's limits, from one guard. Silence of the guard, and a second guard, brake the belts until a person re-arms; ``fault`` states
why, and reaches the guard as a reading.
"""

import math
from typing import Any

from treadline.core.signals import ROUNDING_S, FlipperCommand, OperatorInput, SeatCommand, TrackCommand
from treadline.guard._bounds import fault_of
from treadline.guard._guard_config import GuardConfig
from treadline.guard._stamps import Stamps
from treadline.guard.stop_latch import Rearm


class LastGuard:
    """Admission of commands at the actuators, and the watchdog over the guard.

    Args:
        config: Limits of the guard, of which those of the chair file, and those of stamps, apply.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._button = Rearm()
        self._t_s = 0.0
        self._stamps = Stamps(config)
        self.rejected = self._stamps.rejected
        """Number of messages rejected, by kind."""
        self.rearm()

    def rearm(self) -> None:
        """End a fault: the next guard that speaks drives the chair; commands stamped before now are discarded."""
        self._heard_s = self._rearmed_s = self._t_s
        self._newest: dict[type, Any] = {}
        self._sender: str | None = None
        self._driven = False
        self._rejection = ""
        self.fault: str | None = None
        """Reason for which the plant braked by itself; None without one."""
        self._tripped_s = math.inf

    def operate(self, operator: OperatorInput) -> None:
        """Re-arm where a person presses the button; a button that is stuck, or pressed with a stop, does not count.

        A message that arrives twice, from the plant and over a transport, counts once.
        """
        if self._stamps.accept(operator) and self._button.press(operator, self._tripped_s):
            self.rearm()

    def advance(self, t_s: float) -> None:
        """Set the plant's clock; brake where the guard is silent."""
        self._t_s = t_s
        self._stamps.advance(t_s)
        self._heard_s, self._rearmed_s = min(self._heard_s, t_s), min(self._rearmed_s, t_s)  # a clock may be set back
        self._tripped_s = min(self._tripped_s, t_s) if self.fault is not None else math.inf
        self.check_silence(t_s - self._heard_s)

    def check_silence(self, silent_s: float) -> None:
        """Brake where the last command came ``silent_s`` ago, by whatever clock.

        A chair that was not driven has no fault: another guard may take the place of a silent one.
        """
        is_silent = silent_s > self._config.silence_s + ROUNDING_S
        if is_silent and self._driven:
            self.trip(f"no command for {silent_s:.2f} s" + self._rejection)
        elif is_silent:
            self._sender = None

    def trip(self, cause: str) -> None:
        """Brake until a person re-arms; the first cause stays."""
        if self.fault is None:
            self.fault, self._tripped_s = cause, self._t_s

    def accept(self, command: TrackCommand | SeatCommand | FlipperCommand) -> bool:
        """Return whether a command is accepted."""
        is_of_before = command.t_s < self._rearmed_s - ROUNDING_S
        if self._sender not in (None, command.sender) and not is_of_before:
            self.trip(f"two guards send commands, {self._sender} and {command.sender}; stop one of them")
            return False
        fault = "stamped before the re-arm" if is_of_before else fault_of(command, self._config)
        if not self._stamps.accept(command, content=fault):
            self._rejection = f"; {self._stamps.rejection}" if self._stamps.rejection else self._rejection
            if self._stamps.leap is not None and self._driven:
                self.trip(self._stamps.leap)
            return False
        self._sender, self._newest[type(command)] = command.sender, command
        if isinstance(command, TrackCommand):
            self._heard_s, self._rejection = min(command.t_s, self._t_s), ""
            self._driven |= not command.brake
        return True

    @property
    def is_braking(self) -> bool:
        """Whether the belts are braked whatever was commanded: after a fault, and where the guard is silent."""
        return self.fault is not None or self._t_s - self._heard_s > self._config.silence_s + ROUNDING_S

    def commands(self) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
        """Return what the drives do now: the accepted commands that are fresh, or the brake."""
        tracks = self._newest.get(TrackCommand)
        if self.is_braking or tracks is None:
            return TrackCommand.stop(self._t_s), SeatCommand(t_s=self._t_s, rate_m_s=0.0), None
        oldest_s = tracks.t_s - self._config.ahead_s - ROUNDING_S
        fresh = {kind: command for kind, command in self._newest.items() if command.t_s >= oldest_s}
        return tracks, fresh.get(SeatCommand, SeatCommand(t_s=tracks.t_s, rate_m_s=0.0)), fresh.get(FlipperCommand)
