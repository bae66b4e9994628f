"""Monitor of the belts: speed against the command (rows 13, 14 and 24), and the distance driven.

``TrackCommand, TrackReading -> cause``, ``TrackReading -> travel``.
"""

import math

from treadline.core.signals import ROUNDING_S, Recent, TrackCommand, TrackReading
from treadline.core.slip import slower_belt_m_s
from treadline.guard._guard_config import GuardConfig

GAP_S = 0.1
"""Longest interval between two readings over which a belt speed is integrated."""


class BeltTravel:
    """Integral of the belt speeds since the start, backwards negative."""

    def __init__(self) -> None:
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
        if dt_s > GAP_S:
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
        self.travel = BeltTravel()
        self._expected = [0.0, 0.0]
        self._since_s: list[float | None] = [None, None]
        self._braked_s: float | None = None
        self.cause: str | None = None
        """Fault of a belt or of the brake; None if there is none."""

    @property
    def expected_m_s(self) -> tuple[float, float]:
        """Left and right belt speed expected by the drive model, within the belts' limit [m/s]."""
        limit = self._config.belt_limit_m_s
        left, right = (min(max(speed, -limit), limit) for speed in self._expected)
        return left, right

    @property
    def travel_m(self) -> float:
        """Belt travel, negative backwards [m]."""
        return self.travel.travel_m

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
            self._since_s = [None, None]
            self._braked_s = None
            return
        self._note_brake(on=reading.brake_on)
        for side, asked in enumerate((self._asked.left_m_s, self._asked.right_m_s)):
            self._expected[side] = self._driven(self._expected[side], asked, dt_s)
            self._compare(side, belts[side])

    def forget(self) -> None:
        """Start again: the next reading sets the expected speeds."""
        self.travel.forget()
        self.cause = None

    def _note_brake(self, *, on: bool) -> None:
        """Detect a brake without a command: no power, or commands do not arrive, even if zero speed is commanded."""
        if not on or self._asked.brake:
            self._braked_s = None
        elif self._braked_s is None:
            self._braked_s = self._t_s
        elif self._t_s - self._braked_s >= self._config.mismatch_s - ROUNDING_S:
            self.cause = "the brake is on without a command: no power, or commands do not arrive"

    def _driven(self, speed: float, asked: float, dt_s: float) -> float:
        if self._asked.brake:
            step = BRAKE_M_S2 * dt_s
            return speed - min(max(speed, -step), step)
        step = self._config.drive_acceleration_m_s2 * dt_s
        change = (1.0 - math.exp(-dt_s / self._config.drive_lag_s)) * (asked - speed)
        return speed + min(max(change, -step), step)

    def _compare(self, side: int, speed: float) -> None:
        limits, expected, since_s = self._config, self._expected[side], self._since_s[side]
        if abs(speed - expected) <= limits.mismatch * abs(expected) + limits.mismatch_spare_m_s:
            self._since_s[side] = None
        elif since_s is None:
            self._since_s[side] = self._t_s
        elif self._t_s - since_s >= limits.mismatch_s - ROUNDING_S:
            name, runs_away = ("left", "right")[side], abs(speed) > abs(expected)
            fault = "runs away" if runs_away else "is stalled"
            self.cause = f"{name} track {fault}: {speed:.2f} m/s where {expected:.2f} is expected"
