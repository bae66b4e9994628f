"""Heading and gyro bias from 100 Hz of gyro and 10 Hz of vision: a Kalman filter with a gate.

``ImuSample | HeadingMeasurement -> HeadingEstimate``. Heading turns about the nosing plane's normal, which is the
chair's own z axis while its flat run lies on the nosings: the gyro's z is its rate, with no gravity in between. (The
IMU's yaw is about gravity and reads 33.2° where the heading is 30° on a 28° stair.)
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from treadline.angles import DEG, wrap
from treadline.estimation.reacquire import ReacquisitionRule, Refused
from treadline.signals import HeadingEstimate, HeadingMeasurement, ImuSample

FULL_SCALE_RAD_S = 2000.0 * DEG
"""Widest range of the gyro (MPU-6050): a rate beyond it was never measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """What the sensors are trusted with."""

    gyro_sigma_rad_s: float = 0.35 * DEG
    """White noise of one gyro sample: sensor and track vibration (MPU-6050, 100 Hz)."""
    scale_sigma: float = 0.01
    """Of the gyro's scale: a fast turn is measured worse."""
    bias_walk_rad_s2: float = 0.0007 * DEG
    """Gauss–Markov bias of 0.005 °/s and 100 s, per root second."""
    bias_sigma_rad_s: float = 0.05 * DEG
    """Of the bias at the start."""
    gate: float = 9.0
    """χ² of one measurement beyond which it is not believed: three sigma."""
    reacquisition: ReacquisitionRule = field(default_factory=ReacquisitionRule)
    coast_s: float = 0.5
    """Without vision for longer, the source is the gyro."""
    vision_floor_rad: float = 0.1 * DEG
    """Errors that consecutive frames share (mount, gravity) do not average out: no measurement is better than this."""
    memory_s: float = 1.0
    """How far back a late frame may lie, and how long vision carries the heading without a gyro."""
    gap_s: float = 0.05
    """Without a gyro sample for longer, the chair has moved unseen."""
    unseen_rate_rad_s: float = 10.0 * DEG
    """One sigma of how fast it turns then; a turn back to square reaches twice that."""


class HeadingFilter:
    """State: heading [rad] and gyro bias [rad/s]."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self._config = config or FilterConfig()
        self._t_s: float | None = None
        self._imu_s: float | None = None
        self._frame_s: float | None = None
        self._seen_s: float | None = None
        self._heading = 0.0
        self._bias = 0.0
        self._P = np.zeros((2, 2))
        self._rate = 0.0
        self._turned = 0.0
        self._history: deque[tuple[float, float]] = deque()
        self._refused = Refused(self._config.reacquisition)
        self.rejected_count = 0

    def step(self, signal: ImuSample | HeadingMeasurement) -> HeadingEstimate | None:
        """Take one signal; return the heading now, or None before the first heading."""
        if isinstance(signal, ImuSample):
            self._predict(signal)
        else:
            self._correct(signal)
        return self._estimate()

    def _estimate(self) -> HeadingEstimate | None:
        if self._seen_s is None or self._t_s is None:
            return None
        fresh = self._t_s - self._seen_s <= self._config.coast_s
        return HeadingEstimate(
            t_s=self._t_s,
            heading_rad=self._heading,
            # Without a gyro the rate is nobody's to tell.
            heading_rate_rad_s=self._rate - self._bias if self._t_s == self._imu_s else 0.0,
            sigma_rad=float(np.sqrt(self._P[0, 0])),
            source="vision" if fresh else "gyro",
        )

    def _predict(self, sample: ImuSample) -> None:
        t_s, rate = sample.t_s, float(sample.angular_velocity_rad_s[2])
        if not (math.isfinite(t_s) and abs(rate) <= FULL_SCALE_RAD_S):  # NaN fails too
            return
        if self._imu_s is not None and not t_s > self._imu_s:
            return  # a repeated or earlier stamp carries no new motion
        # The mean rate over the step, by the trapezoid rule.
        mean = rate if self._imu_s is None else 0.5 * (rate + self._rate)
        gap = t_s - self._last_known(t_s)
        dt = min(gap, self._config.memory_s)
        self._t_s = self._imu_s = t_s
        self._rate = rate
        self._turned += dt * mean
        self._remember(t_s)
        if self._seen_s is None:
            return
        self._propagate(dt, mean)
        self._move_unseen(gap)

    def _last_known(self, t_s: float) -> float:
        """Return the time up to which the heading is known, for a gyro sample at ``t_s``."""
        if self._t_s is not None and self._t_s <= t_s:
            return self._t_s
        # A frame stamped ahead of the gyro's clock did not show the future.
        self._frame_s = None
        return t_s if self._imu_s is None else self._imu_s

    def _remember(self, t_s: float) -> None:
        self._history.append((t_s, self._turned))
        while t_s - self._history[0][0] > self._config.memory_s:
            self._history.popleft()

    def _propagate(self, dt: float, mean: float) -> None:
        config = self._config
        self._heading = wrap(self._heading + dt * (mean - self._bias))
        p00, p01, p11 = self._P[0, 0], self._P[0, 1], self._P[1, 1]
        noise = (config.gyro_sigma_rad_s * dt) ** 2 + (config.scale_sigma * (mean - self._bias) * dt) ** 2
        self._P[0, 0] = p00 - 2.0 * dt * p01 + dt * dt * p11 + noise
        self._P[0, 1] = self._P[1, 0] = p01 - dt * p11
        self._P[1, 1] = p11 + config.bias_walk_rad_s2**2 * dt

    def _move_unseen(self, gap_s: float) -> None:
        """Add what the chair may have turned while no gyro sample came."""
        if gap_s > self._config.gap_s:
            # Beyond half a turn there is nothing more to forget.
            self._P[0, 0] += min(self._config.unseen_rate_rad_s * gap_s, math.pi) ** 2

    def _correct(self, seen: HeadingMeasurement) -> None:
        if not self._usable(seen):
            return
        self._frame_s = seen.t_s
        self._carry_without_gyro(seen.t_s)
        heading = wrap(seen.heading_rad + self._turned_since(seen.t_s))
        variance = max(seen.sigma_rad, self._config.vision_floor_rad) ** 2
        if self._seen_s is None:
            self._take(heading, variance, seen.t_s)
            return
        innovation = wrap(heading - self._heading)
        spread = float(self._P[0, 0]) + variance
        if innovation * innovation > self._config.gate * spread:
            self.rejected_count += 1
            # What the gyro turned is taken out, so that a turning chair's measurements can agree.
            if self._refused.agree(seen.t_s, wrap(heading - self._turned)):
                self._take(heading, variance, seen.t_s)
                # A gyro that went this far off in that time may go on doing so: its bias is to be learned anew.
                self._P[1, 1] += (innovation / self._config.reacquisition.for_s) ** 2
            return
        self._refused.clear()
        gain = self._P[:, 0] / spread
        self._heading = wrap(self._heading + float(gain[0]) * innovation)
        self._bias += float(gain[1]) * innovation
        self._P = self._P - np.outer(gain, self._P[0])
        self._P = 0.5 * (self._P + self._P.T)
        self._seen_s = seen.t_s

    def _usable(self, seen: HeadingMeasurement) -> bool:
        """Say whether a measurement is a number, newer than the one before, and near enough to the gyro's clock."""
        if not (math.isfinite(seen.t_s) and math.isfinite(seen.heading_rad) and 0.0 < seen.sigma_rad <= math.pi):
            return False
        if self._frame_s is not None and not seen.t_s > self._frame_s:
            return False
        return self._imu_s is None or abs(seen.t_s - self._imu_s) <= self._config.memory_s

    def _carry_without_gyro(self, t_s: float) -> None:
        """Go on to a frame that comes after the gyro has fallen silent."""
        if self._t_s is None:
            self._t_s = t_s
        elif t_s - self._t_s > self._config.gap_s:
            self._move_unseen(t_s - self._t_s)
            self._t_s = t_s

    def _take(self, heading: float, variance: float, seen_s: float) -> None:
        bias_variance = self._config.bias_sigma_rad_s**2
        known = self._seen_s is not None
        self._heading = heading
        self._P = np.diag([variance, min(float(self._P[1, 1]), bias_variance) if known else bias_variance])
        self._seen_s = seen_s

    def _turned_since(self, t_s: float) -> float:
        """Return how far the chair has turned since a frame was taken."""
        if self._t_s is None or t_s >= self._t_s or not self._history:
            return 0.0
        then = self._history[0][1]
        for at_s, turned in self._history:
            if at_s > t_s + 1e-9:
                break
            then = turned
        return self._turned - then - self._bias * (self._t_s - t_s)
