"""Monitor of the belts: speed against the command (rows 13 and 24). ``TrackCommand, TrackReading -> cause``."""

import math
from typing import Any

from treadline.core.signals import ROUNDING_S, TrackReading
from treadline.guard._guard_config import GuardConfig
from treadline.guard._known import Known, Lasting, Monitor

BRAKE_M_S2 = 10.0
"""Deceleration of a belt by the brake [m/s²]; a parameter of the guard, independent of the plant."""


class BeltMonitor(Monitor):
    """A belt stalls, runs away or runs backwards, the brake is on without a command.

    Time: 0.2 s; if it flickers, and is bad for a share p > 1/2 of the time, divided by 2p − 1.
    Not covered: deviations below 30 % and 0.03 m/s.

    Each belt speed is compared with a model of its drive: first-order lag with an acceleration limit. A faulty drive follows no
    ramp.
    """

    rows, hears = "13, 24", (TrackReading,)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._t_s = -math.inf
        self._expected = [0.0, 0.0]
        self._left, self._right, self._brake = (Lasting(config.mismatch_s, config.silence_s) for _ in range(3))

    @property
    def expected_m_s(self) -> tuple[float, float]:
        """Left and right belt speed expected by the drive model, within the belts' limit [m/s]."""
        limit = self._config.belt_limit_m_s
        left, right = (min(max(speed, -limit), limit) for speed in self._expected)
        return left, right

    def hear(self, message: Any, known: Known) -> None:
        """Compare one reading of the drives with the command that they have; after a gap the reading is what is expected."""
        reading, asked = message, known.passed
        dt_s, self._t_s = reading.t_s - self._t_s, reading.t_s
        belts = (reading.left_m_s, reading.right_m_s)
        if dt_s > self._config.silence_s + ROUNDING_S:
            self._expected = list(belts)
            for lasting in (self._left, self._right, self._brake):
                lasting.forget(reading.t_s)
            return
        # Also of a chair that is commanded to stand.
        if self._brake.update(reading.t_s, beyond=reading.brake_on and not asked.brake):
            self._cause = "the brake is on without a command: no power, or commands do not arrive"
        self._expected[0] = self._driven(self._expected[0], asked.left_m_s, dt_s, brake=asked.brake)
        self._expected[1] = self._driven(self._expected[1], asked.right_m_s, dt_s, brake=asked.brake)
        self._compare("left", self._left, belts[0], self._expected[0])
        self._compare("right", self._right, belts[1], self._expected[1])

    def cause(self, known: Known) -> str | None:
        """Return the fault of a belt or of the brake; in recordings commands have no effect."""
        return self._cause if self._config.watches_motion else None

    def restart(self, known: Known) -> None:
        """Start again: the next reading sets the expected speeds."""
        super().restart(known)
        self._t_s = -math.inf

    def _driven(self, speed: float, asked: float, dt_s: float, *, brake: bool) -> float:
        if brake:
            step = BRAKE_M_S2 * dt_s
            return speed - min(max(speed, -step), step)
        step = self._config.drive_acceleration_m_s2 * dt_s
        change = (1.0 - math.exp(-dt_s / self._config.drive_lag_s)) * (asked - speed)
        return speed + min(max(change, -step), step)

    def _compare(self, name: str, lasting: Lasting, speed: float, expected: float) -> None:
        limits = self._config
        off = abs(speed - expected) > limits.deviation * abs(expected) + limits.mismatch_spare_m_s
        if lasting.update(self._t_s, beyond=off):
            fault = "runs away" if abs(speed) > abs(expected) else "is stalled"
            if speed * expected < 0.0 and abs(speed) > limits.mismatch_spare_m_s:
                fault = "runs backwards"
            self._cause = f"{name} track {fault}: {speed:.2f} m/s where {expected:.2f} is expected"
