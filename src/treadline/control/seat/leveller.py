"""Proportional seat leveller.

Paper: Section II.B, Section VI.C.3, Fig. 11. ``SeatReading -> SeatCommand``.
"""

import math
from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, SeatReading
from treadline.scenario.chair import Seat
from treadline.vehicle.linkage import SeatLinkage


@dataclass(frozen=True, slots=True, kw_only=True)
class LevellerConfig:
    """Seat linkage and loop gain."""

    seat: Seat
    gain_per_s: float = 2.0
    """Seat rate per pitch error [1/s]; with the actuator lag of 0.1 s the loop is well damped (ζ > 1)."""
    dead_band_rad: float = 0.1 * DEG
    """Dead band on the pitch [rad], twice the sensor noise, to keep the actuator at rest on a level seat."""


class Leveller:
    """Proportional loop from seat pitch to actuator rate."""

    def __init__(self, config: LevellerConfig) -> None:
        self._config = config
        self._linkage = SeatLinkage(config.seat)

    def step(self, reading: SeatReading) -> SeatCommand:
        """Return the command for one reading; the same reading always gives the same command."""
        config = self._config
        finite = math.isfinite(reading.pitch_rad) and math.isfinite(reading.stroke_m)
        if not finite or abs(reading.pitch_rad) <= config.dead_band_rad:
            return SeatCommand(t_s=reading.t_s, rate_m_s=0.0)
        low, high = self._linkage.stroke_range
        stroke = min(max(reading.stroke_m, low), high)
        # Pitch is positive with the front up; a longer stroke leans the seat forward.
        rate = config.gain_per_s * reading.pitch_rad / self._linkage.rate_ratio(stroke)
        limit = config.seat.max_rate_m_s
        rate = min(max(rate, -limit), limit)
        at_end = (stroke >= high and rate > 0.0) or (stroke <= low and rate < 0.0)
        return SeatCommand(t_s=reading.t_s, rate_m_s=0.0 if at_end else rate)
