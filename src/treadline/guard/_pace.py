"""Pace of the loop and of its commands, and a plant that stopped by itself (rows 10, 11 and 22)."""

from treadline.core.signals import TICK_S, PlantState
from treadline.guard._known import Known, Monitor
from treadline.guard._stamps import Stamped


class Pace(Monitor):
    """Age of the belts' command, and the clock of the ticks."""

    def cause(self, known: Known) -> str | None:
        """Return what is late, or None."""
        limits, command_s = self._config, known.t_s - known.commanded_s
        if known.same_ticks * TICK_S > limits.silence_s:
            return f"mission clock stands still at {known.t_s:.2f} s"
        if known.passed_s < -limits.clock_jump_s:
            return f"mission clock leapt by {known.passed_s:+.2f} s"
        if known.passed_s > limits.driver_timeout_s:
            return f"no tick for {known.passed_s:.2f} s"
        return f"no command for {command_s:.2f} s" if abs(command_s) > limits.driver_timeout_s else None


class PlantFault(Monitor):
    """Reason for which the plant braked by itself; the button to re-arm may reach the plant a moment after the guard."""

    def hear(self, message: Stamped, known: Known) -> None:
        """Update with the state of the plant."""
        if isinstance(message, PlantState) and message.fault is not None and message.t_s - known.rearmed_s > self._config.ahead_s:
            self._cause = f"the plant braked by itself: {message.fault}"
