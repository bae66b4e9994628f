"""Heading and gyro bias from 100 Hz of gyro and 10 Hz of vision: a Kalman filter with a gate.

``ImuSample | HeadingMeasurement -> HeadingEstimate``. Heading turns about the nosing plane's normal, which is the
chair's own z axis while its flat run lies on the nosings: the gyro's z is its rate, with no gravity in between. (The
IMU's yaw is about gravity and reads 33.2° where the heading is 30° on a 28° stair.)
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from treadline.angles import DEG, wrap
from treadline.signals import HeadingEstimate, HeadingMeasurement, ImuSample


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
    reacquire_s: float = 4.0
    """Consistent measurements outside the gate for this long take over."""
    reacquire_spread_rad: float = 1.5 * DEG
    """What counts as consistent, once the turning since is taken out."""
    coast_s: float = 0.5
    """Without vision for longer, the source is the gyro."""
    vision_floor_rad: float = 0.1 * DEG
    """Errors that consecutive frames share (mount, gravity) do not average out: no measurement is better than this."""
    memory_s: float = 1.0
    """How far back a late frame may lie."""


class HeadingFilter:
    """State: heading [rad] and gyro bias [rad/s]."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self._config = config or FilterConfig()
        self._t_s: float | None = None
        self._heading = 0.0
        self._bias = 0.0
        self._P = np.zeros((2, 2))
        self._rate = 0.0
        self._turned = 0.0
        self._seen_s: float | None = None
        self._history: deque[tuple[float, float]] = deque()
        self._outside: deque[tuple[float, float]] = deque()
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
            heading_rate_rad_s=self._rate - self._bias,
            sigma_rad=float(np.sqrt(self._P[0, 0])),
            source="vision" if fresh else "gyro",
        )

    def _predict(self, sample: ImuSample) -> None:
        rate = float(sample.angular_velocity_rad_s[2])
        if not np.isfinite(rate):
            return
        dt = 0.0 if self._t_s is None else sample.t_s - self._t_s
        if self._t_s is not None and not dt > 0.0:
            return  # a repeated or earlier stamp carries no new motion
        config = self._config
        # The mean rate over the step, by the trapezoid rule.
        mean = 0.5 * (rate + self._rate) if self._t_s is not None else rate
        self._t_s, self._rate = sample.t_s, rate
        self._turned += dt * mean
        self._history.append((sample.t_s, self._turned))
        while self._history and sample.t_s - self._history[0][0] > config.memory_s:
            self._history.popleft()
        if self._seen_s is None:
            return
        self._heading = wrap(self._heading + dt * (mean - self._bias))
        p00, p01, p11 = self._P[0, 0], self._P[0, 1], self._P[1, 1]
        noise = (config.gyro_sigma_rad_s * dt) ** 2 + (config.scale_sigma * (mean - self._bias) * dt) ** 2
        self._P[0, 0] = p00 - 2.0 * dt * p01 + dt * dt * p11 + noise
        self._P[0, 1] = self._P[1, 0] = p01 - dt * p11
        self._P[1, 1] = p11 + config.bias_walk_rad_s2**2 * dt

    def _correct(self, seen: HeadingMeasurement) -> None:
        if not (np.isfinite(seen.heading_rad) and np.isfinite(seen.sigma_rad) and seen.sigma_rad > 0.0):
            return
        now = seen.t_s if self._t_s is None else self._t_s
        heading = wrap(seen.heading_rad + self._turned_since(seen.t_s))
        variance = max(seen.sigma_rad, self._config.vision_floor_rad) ** 2
        if self._seen_s is None:
            self._take(heading, variance, now)
            return
        innovation = wrap(heading - self._heading)
        spread = float(self._P[0, 0]) + variance
        if innovation * innovation > self._config.gate * spread:
            self.rejected_count += 1
            self._doubt(heading, variance, now)
            return
        self._outside.clear()
        gain = self._P[:, 0] / spread
        self._heading = wrap(self._heading + float(gain[0]) * innovation)
        self._bias += float(gain[1]) * innovation
        self._P = self._P - np.outer(gain, self._P[0])
        self._P = 0.5 * (self._P + self._P.T)
        self._seen_s = now

    def _doubt(self, heading: float, variance: float, now: float) -> None:
        """Collect what the gate refused; believe it once it has agreed with itself for long enough."""
        config = self._config
        carried = wrap(heading - self._turned)
        if self._outside and abs(wrap(carried - self._outside[-1][1])) > config.reacquire_spread_rad:
            self._outside.clear()
        self._outside.append((now, carried))
        if now - self._outside[0][0] >= config.reacquire_s:
            self._outside.clear()
            self._take(heading, variance, now)

    def _take(self, heading: float, variance: float, now: float) -> None:
        bias_variance = self._config.bias_sigma_rad_s**2
        known = self._seen_s is not None
        self._heading = heading
        self._P = np.diag([variance, min(float(self._P[1, 1]), bias_variance) if known else bias_variance])
        self._seen_s = now
        if self._t_s is None:
            self._t_s = now

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
