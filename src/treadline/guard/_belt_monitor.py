"""Monitor of the belts: speed against the command (rows 13, 14 and 24), and the distance driven.

``TrackCommand, TrackReading -> cause``, ``TrackReading -> travel``.
"""

import math

from treadline.core.signals import ROUNDING_S, Recent, TrackCommand, TrackReading
from treadline.core.slip import slower_belt_m_s
from treadline.guard._guard_config import GuardConfig
from treadline.guard._lasting import Lasting


class BeltTravel:
    """Integral of the belt speeds since the start, backwards negative.

    Args:
        gap_s: Longest interval between two readings over which a speed is integrated [s].
    """

    def __init__(self, gap_s: float) -> None:
        self._gap_s = gap_s
        self._t_s = -math.inf
        self._past: Recent[tuple[float, float]] = Recent()
        self.travel_m = 0.0
        """Integral of the mean belt speed [m]."""
        self.slow_travel_m = 0.0
        """Integral of the slower belt's speed [m]; slip is measured against it."""

    def update(self, reading: TrackReading) -> float | None:
        """Integrate one reading; return the time since the previous one [s], None after a gap."""
        dt_s = reading.t_s - self._t_s
        self._t_s = reading.t_s
        if dt_s > self._gap_s + ROUNDING_S:
            return None
        self.travel_m += dt_s * 0.5 * (reading.left_m_s + reading.right_m_s)
        self.slow_travel_m += dt_s * slower_belt_m_s(reading.left_m_s, reading.right_m_s)
        self._past.add(reading.t_s, (self.travel_m, self.slow_travel_m))
        return dt_s

    def at(self, t_s: float) -> tuple[float, float]:
        """Return ``travel_m`` and ``slow_travel_m`` at ``t_s``, the exposure of a frame that arrived later."""
        return self._past.at(t_s) or (self.travel_m, self.slow_travel_m)

    def forget(self) -> None:
        """Start again from the next reading; the distances stay."""
        self._t_s = -math.inf


BRAKE_M_S2 = 10.0
"""Deceleration of a belt by the brake [m/s²]; a parameter of the guard, independent of the plant."""


class BeltMonitor:
    """Compares each belt speed with a model of its drive: first-order lag with an acceleration limit."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._asked = TrackCommand.stop(0.0)
        self._t_s = 0.0
        self.travel = BeltTravel(config.silence_s)
        self._expected = [0.0, 0.0]
        self._left, self._right, self._brake = (Lasting(config.mismatch_s, config.silence_s) for _ in range(3))
        self.cause: str | None = None
        """Fault of a belt or of the brake; None if there is none."""

    @property
    def expected_m_s(self) -> tuple[float, float]:
        """Left and right belt speed expected by the drive model, within the belts' limit [m/s]."""
        limit = self._config.belt_limit_m_s
        left, right = (min(max(speed, -limit), limit) for speed in self._expected)
        return left, right

    def ask(self, command: TrackCommand) -> None:
        """Record the command to the belts."""
        self._asked = command

    def update(self, reading: TrackReading) -> None:
        """Update with one reading of the drives."""
        dt_s = self.travel.update(reading)
        self._t_s = reading.t_s
        belts = (reading.left_m_s, reading.right_m_s)
        if dt_s is None:
            self._expected = list(belts)
            for lasting in (self._left, self._right, self._brake):
                lasting.forget(reading.t_s)
            return
        # Also of a chair that is commanded to stand.
        if self._brake.update(reading.t_s, beyond=reading.brake_on and not self._asked.brake):
            self.cause = "the brake is on without a command: no power, or commands do not arrive"
        self._expected[0] = self._driven(self._expected[0], self._asked.left_m_s, dt_s)
        self._expected[1] = self._driven(self._expected[1], self._asked.right_m_s, dt_s)
        self._compare("left", self._left, belts[0], self._expected[0])
        self._compare("right", self._right, belts[1], self._expected[1])

    def forget(self) -> None:
        """Start again: the next reading sets the expected speeds."""
        self.travel.forget()
        self.cause = None

    def _driven(self, speed: float, asked: float, dt_s: float) -> float:
        if self._asked.brake:
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
            self.cause = f"{name} track {fault}: {speed:.2f} m/s where {expected:.2f} is expected"
