"""Seat leveller: proportional feedback of the seat pitch, and feed-forward from the chassis pitch rate.

Paper: Section II.B, Section VI.C.3, Fig. 11. ``SeatReading -> SeatCommand``.

The feed-forward compensates the actuator lag: ``ImuSample, SeatReading, SeatCommand -> SeatCommand``, added to the leveller's rate.
A feedback loop alone reacts to an error; over a crest the chassis turns 10° in a second, and a gain of 2/s would leave the seat 5°
behind.
"""

import math
from collections import deque

from treadline.core.angles import DEG
from treadline.core.signals import ROUNDING_S, ImuSample, SeatCommand, SeatReading
from treadline.scenario.chair import Seat
from treadline.vehicle.linkage import SeatLinkage

GAIN_PER_S = 2.0
"""Seat rate per pitch error [1/s]; with the actuator lag of 0.1 s the loop is well damped (ζ > 1)."""
DEAD_BAND_RAD = 0.1 * DEG
"""Dead band on the pitch [rad], twice the sensor noise, to keep the actuator at rest on a level seat."""


class Leveller:
    """Proportional loop from seat pitch to actuator rate."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._linkage = SeatLinkage(seat)

    def step(self, reading: SeatReading) -> SeatCommand:
        """Return the command for one reading; the same reading always gives the same command."""
        finite = math.isfinite(reading.pitch_rad) and math.isfinite(reading.stroke_m)
        if not finite or abs(reading.pitch_rad) <= DEAD_BAND_RAD:
            return SeatCommand(t_s=reading.t_s, rate_m_s=0.0)
        # Pitch is positive with the front up; a longer stroke leans the seat forward.
        return self.command(reading.t_s, self.stroke_rate(GAIN_PER_S * reading.pitch_rad, reading), reading)

    def stroke_rate(self, pitch_rad_s: float, reading: SeatReading) -> float:
        """Return the stroke rate that turns the seat at a rate [m/s], at the measured stroke or the nearest end of the actuator."""
        low, high = self._linkage.stroke_range
        return pitch_rad_s / self._linkage.rate_ratio(min(max(reading.stroke_m, low), high))

    def command(self, t_s: float, rate_m_s: float, reading: SeatReading) -> SeatCommand:
        """Return the command of a rate within the actuator's limit; of none against an end of its stroke."""
        (low, high), most = self._linkage.stroke_range, self._seat.max_rate_m_s
        at_end = (reading.stroke_m >= high and rate_m_s > 0.0) or (reading.stroke_m <= low and rate_m_s < 0.0)
        return SeatCommand(t_s=t_s, rate_m_s=0.0 if at_end else min(max(rate_m_s, -most), most))


QUIET_RAD_S, QUIET_S = 1.0 * DEG, 0.3
"""Mean pitch rate below which the feed-forward is off [rad/s], and its averaging time [s]; chairs rock at 3 to 4 Hz on nosings."""
ROCKS_S, ROCKS_RAD = 0.8, 1.5 * DEG
"""Window [s] and amplitude [rad] of rocking: two periods at 2.5 Hz; a chair that pitches this far up and down within them rocks."""
FRESH_S = 0.05
SMOOTHING_S = 0.03
"""Time constant of the low-pass [s] that bounds the lead 1 + lag·s and its amplification of gyro noise."""


class _Turned:
    """Integrated upward and downward pitch within a window, from rates."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._sums: deque[tuple[float, float, float]] = deque()

    def step(self, t_s: float, rate_rad_s: float) -> tuple[float, float]:
        """Take one rate; return both angles, neither negative [rad]."""
        before_s, up, down = self._sums[-1] if self._sums else (t_s, 0.0, 0.0)
        turned = rate_rad_s * min(max(t_s - before_s, 0.0), FRESH_S)
        self._sums.append((t_s, up + max(turned, 0.0), down + max(-turned, 0.0)))
        while t_s - self._sums[0][0] > self._window_s + ROUNDING_S:
            self._sums.popleft()
        (_, up_0, down_0), (_, up_1, down_1) = self._sums[0], self._sums[-1]
        return up_1 - up_0, down_1 - down_0


class PitchLeveller:
    """Seat leveller with feed-forward for a pitching chassis.

    The feed-forward is off below ``QUIET_RAD_S`` of mean pitch rate and while the chair rocks: a seat that follows rocking with the
    lag of its actuator would excite it.
    """

    def __init__(self, seat: Seat) -> None:
        self._leveller = Leveller(seat)
        self._lag_s = seat.lag_s
        self._smooth_rad_s = 0.0
        self._t_s: float | None = None
        self._lately, self._longer = _Turned(QUIET_S), _Turned(ROCKS_S)

    def step(self, reading: SeatReading, imu: ImuSample | None) -> SeatCommand:
        """Return the command for one reading; without a fresh IMU sample only the feedback loop acts."""
        levelling = self._leveller.step(reading)
        if imu is None or abs(imu.t_s - reading.t_s) > FRESH_S or not math.isfinite(imu.angular_velocity_rad_s[1]):
            return levelling
        led = self._led(imu, reading, levelling)
        return led if self._manoeuvres(imu) else levelling

    def _led(self, imu: ImuSample, reading: SeatReading, levelling: SeatCommand) -> SeatCommand:
        """Return the leveller's rate plus the rate that keeps a level seat level: a lead filter (1 + lag·s)/(1 + smoothing·s)."""
        pitch_rate = -imu.angular_velocity_rad_s[1]
        dt_s = 0.0 if self._t_s is None else max(imu.t_s - self._t_s, 0.0)
        self._t_s = imu.t_s
        self._smooth_rad_s += (pitch_rate - self._smooth_rad_s) * (1.0 - math.exp(-dt_s / SMOOTHING_S))
        lead = self._smooth_rad_s + (self._lag_s / SMOOTHING_S) * (pitch_rate - self._smooth_rad_s)
        return self._leveller.command(imu.t_s, levelling.rate_m_s + self._leveller.stroke_rate(lead, reading), reading)

    def _manoeuvres(self, imu: ImuSample) -> bool:
        """Whether the chair pitches in one direction instead of rocking."""
        rate_rad_s = imu.angular_velocity_rad_s[1]
        up_lately, down_lately = self._lately.step(imu.t_s, rate_rad_s)
        rocked = min(self._longer.step(imu.t_s, rate_rad_s))
        return abs(up_lately - down_lately) > QUIET_RAD_S * QUIET_S and rocked < ROCKS_RAD
