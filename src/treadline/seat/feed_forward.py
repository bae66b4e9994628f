"""The seat moves with the chassis: a feed-forward from the chassis' pitch rate, ahead of the actuator's lag.

``ImuSample, SeatReading, SeatCommand -> SeatCommand``: added to the leveller's rate. A loop alone waits for an error; over a crest
the chassis turns 10° in a second, and a gain of 2/s would leave the seat 5° behind.
"""

import math

from treadline.angles import DEG
from treadline.mechanics.chair import Seat
from treadline.mechanics.linkage import SeatLinkage
from treadline.seat.leveller import Leveller, LevellerConfig
from treadline.signals import ImuSample, SeatCommand, SeatReading

QUIET_RAD_S, QUIET_SHARE = 1.0 * DEG, 0.05
"""Mean pitch rate below which there is nothing to lead, and each sample's share in that mean: 0.2 s of them."""
FRESH_S = 0.05
SMOOTHING_S = 0.03
"""The lead 1 + lag·s needs a bound, or it would play the gyro's noise."""


class PitchFeedForward:
    """Lead filter (1 + lag·s)/(1 + smoothing·s) from pitch rate to stroke rate."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._linkage = SeatLinkage(seat)
        self._smooth_rad_s = 0.0
        self._t_s: float | None = None

    def step(self, imu: ImuSample, seat: SeatReading, levelling: SeatCommand) -> SeatCommand:
        """Return the leveller's rate and what keeps a level seat level."""
        pitch_rate = -float(imu.angular_velocity_rad_s[1])
        dt_s = 0.0 if self._t_s is None else max(imu.t_s - self._t_s, 0.0)
        self._t_s = imu.t_s
        self._smooth_rad_s += (pitch_rate - self._smooth_rad_s) * (1.0 - math.exp(-dt_s / SMOOTHING_S))
        lead = self._smooth_rad_s + (self._seat.lag_s / SMOOTHING_S) * (pitch_rate - self._smooth_rad_s)
        low, high = self._linkage.stroke_range
        stroke = min(max(seat.stroke_m, low), high)
        limit = self._seat.max_rate_m_s
        rate = levelling.rate_m_s + lead / self._linkage.rate_ratio(stroke)
        if (stroke >= high and rate > 0.0) or (stroke <= low and rate < 0.0):
            rate = 0.0
        return SeatCommand(t_s=imu.t_s, rate_m_s=min(max(rate, -limit), limit))


class PitchLeveller:
    """The seat's loop with the feed-forward: what a chair that pitches needs.

    Below ``QUIET_RAD_S`` of pitch rate the loop is alone: vibration is not a manoeuvre.
    """

    def __init__(self, config: LevellerConfig) -> None:
        self._leveller = Leveller(config)
        self._feed_forward = PitchFeedForward(config.seat)
        self._slow_rad_s = 0.0

    def step(self, reading: SeatReading, imu: ImuSample | None) -> SeatCommand:
        """Answer one reading; without a fresh IMU sample the loop is alone."""
        levelling = self._leveller.step(reading)
        if imu is None or abs(imu.t_s - reading.t_s) > FRESH_S:
            return levelling
        self._slow_rad_s += (abs(float(imu.angular_velocity_rad_s[1])) - self._slow_rad_s) * QUIET_SHARE
        led = self._feed_forward.step(imu, reading, levelling)
        return led if self._slow_rad_s > QUIET_RAD_S else levelling
