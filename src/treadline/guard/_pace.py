"""Pace of the loop and of its commands, a plant that stopped by itself, and its battery (rows 10, 11, 22 and 28)."""

from typing import Any

from treadline.core.signals import TICK_S, PlantState
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Lasting, Monitor


class Pace(Monitor):
    """No command or no tick; a clock of ticks that stands still, or leaps by 1 s.

    Time: ramp from 1.5 control periods, hold at 3; 0.3 s; 1 tick.
    """

    rows = "11"

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._same_ticks = 0
        """Number of ticks at one time."""

    def cause(self, known: Known) -> str | None:
        """Return what is late, or None; asked once a tick."""
        limits, command_s = self._config, known.t_s - known.commanded_s
        self._same_ticks = self._same_ticks + 1 if known.passed_s == 0.0 else 0
        if self._same_ticks * TICK_S > limits.silence_s:
            return f"mission clock stands still at {known.t_s:.2f} s"
        if known.passed_s < -limits.clock_jump_s:
            return f"mission clock leapt by {known.passed_s:+.2f} s"
        if known.passed_s > limits.driver_timeout_s:
            return f"no tick for {known.passed_s:.2f} s"
        return f"no command for {command_s:.2f} s" if abs(command_s) > limits.driver_timeout_s else None


class PlantFault(Monitor):
    """The plant braked by itself: silence, a second guard.

    Time: 1 tick; for 0.1 s after a re-arm its reports may be of before.
    Not covered: drives that ignore their command.
    """

    rows, hears, needs = "22", (PlantState,), ("watches_motion",)

    def hear(self, message: Any, known: Known) -> None:
        """Update with the state of the plant."""
        if message.fault is not None and message.t_s - known.rearmed_s > self._config.ahead_s:
            self._cause = f"the plant braked by itself: {message.fault}"


class BatteryMonitor(Monitor):
    """The battery's voltage is below the least one of the robot file.

    Time: 1 s.
    Not covered: a battery whose voltage is not measured.
    """

    rows, stop, hears, needs = "28", Stop.RAMP, (PlantState,), ("battery_least_v",)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._lasting = Lasting(config.battery_s, config.silence_s)

    def hear(self, message: Any, known: Known) -> None:
        """Update with the state of the plant."""
        least_v = self._config.battery_least_v or 0.0
        volts = least_v if message.battery_v is None else message.battery_v
        if self._lasting.update(message.t_s, beyond=volts < least_v):
            self._cause = f"the battery is at {volts:.1f} V, and {least_v:g} V are asked for"
