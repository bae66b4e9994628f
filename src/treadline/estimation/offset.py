"""Heading by the paper's fusion: an offset between the vision heading and the IMU's yaw, and a rule against outliers.

Paper: Section III.B, Eq. (5). The IMU's yaw is about gravity, the heading about the nosing plane's normal: on a 28° stair a
heading of 30° is a yaw of 33.2°. This mode is implemented as printed; ``HeadingFilter`` is the default estimator.

The paper gives no rule for what it calls "an aberration in θ", a jump larger than the chair can make; the rule here compares the
turn between frames by vision with the turn by the IMU.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from treadline.core.angles import DEG, wrap
from treadline.core.rotations import rotation_of
from treadline.core.signals import HeadingEstimate, HeadingMeasurement, ImuSample, TrackReading


@dataclass(frozen=True, slots=True, kw_only=True)
class AberrationRule:
    """Threshold on the difference between a measured heading and the gyro's prediction."""

    jump_rad: float = 5.0 * DEG


OFFSET_SIGMA_RAD = 0.5 * DEG
"""Declared standard deviation [rad]; the method provides none."""
COAST_S = 0.5
"""Time without vision after which the source of an estimate is the gyro [s], also of the heading filter."""
PAIRED_S = 0.05
"""Largest time between a frame and its IMU sample [s]."""
MEMORY_S = 1.0
"""Largest age of a late frame [s]."""


def heading_offset(seen_rad: float, yaw_rad: float) -> float:
    """Return φ = θ - γ, the offset between the vision heading and the IMU's yaw.

    Paper: Eq. (5).
    """
    return wrap(seen_rad - yaw_rad)


class OffsetEstimator:
    """Estimator θ = γ + φ; φ is updated with every accepted vision heading."""

    def __init__(self, rule: AberrationRule | None = None) -> None:
        self._rule = rule or AberrationRule()
        self._t_s: float | None = None
        self._yaw: float | None = None
        self._rate = 0.0
        self._offset: float | None = None
        self._seen_s = 0.0
        self._frame_s = -math.inf
        self._yaws: deque[tuple[float, float]] = deque()
        self.rejected_count = 0

    health: None = None
    """Sensor health; None, because the paper's method detects no faults."""

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Take one signal; return the current heading, or None before the first heading. Belt readings are ignored."""
        match signal:
            case ImuSample():
                self._update(signal)
            case HeadingMeasurement():
                self._correct(signal)
            case _:
                pass
        if self._offset is None or self._yaw is None or self._t_s is None:
            return None
        return HeadingEstimate(
            t_s=self._t_s,
            heading_rad=wrap(self._yaw + self._offset),
            heading_rate_rad_s=self._rate,
            sigma_rad=OFFSET_SIGMA_RAD,
            source="vision" if self._t_s - self._seen_s <= COAST_S else "gyro",
        )

    def _update(self, sample: ImuSample) -> None:
        R = rotation_of(sample.orientation)
        rate = sample.angular_velocity_rad_s[2]
        finite = math.isfinite(sample.t_s) and math.isfinite(rate) and bool(np.isfinite(R).all())
        if not finite or (self._t_s is not None and not sample.t_s > self._t_s):
            return
        self._t_s, self._rate = sample.t_s, rate
        self._yaw = float(np.arctan2(R[1, 0], R[0, 0]))
        self._yaws.append((self._t_s, self._yaw))
        while self._t_s - self._yaws[0][0] > MEMORY_S:
            self._yaws.popleft()

    def _correct(self, seen: HeadingMeasurement) -> None:
        if not (math.isfinite(seen.t_s) and math.isfinite(seen.heading_rad) and seen.t_s > self._frame_s):
            return
        t_s, yaw = min(self._yaws, key=lambda sample: abs(sample[0] - seen.t_s), default=(-math.inf, 0.0))
        if abs(t_s - seen.t_s) > PAIRED_S:  # no IMU sample near the time of the frame
            return
        self._frame_s = seen.t_s
        if self._offset is not None and abs(wrap(seen.heading_rad - wrap(yaw + self._offset))) > self._rule.jump_rad:
            self.rejected_count += 1
            return
        self._offset = heading_offset(seen.heading_rad, yaw)
        self._seen_s = seen.t_s
