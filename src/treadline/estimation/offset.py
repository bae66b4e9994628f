"""The paper's fusion: the offset between the heading seen and the IMU's yaw.

Paper: Section III.B, Eq. (5). Its yaw is about gravity, while heading turns about the nosing plane's normal: on a 28°
stair, 30° of heading are 33.2° of yaw. The mode is kept as printed; ``HeadingFilter`` is what drives.
"""

import math
from collections import deque

import numpy as np

from treadline.angles import DEG, rotation_of, wrap
from treadline.estimation.aberration import AberrationRule
from treadline.signals import HeadingEstimate, HeadingMeasurement, ImuSample, TrackReading

OFFSET_SIGMA_RAD = 0.5 * DEG
"""Declared uncertainty: the method gives none of its own."""
COAST_S = 0.5
PAIRED_S = 0.05
"""A yaw further than this from a frame in time does not belong to it."""
MEMORY_S = 1.0
"""How far back a late frame may lie."""


def heading_offset(seen_rad: float, yaw_rad: float) -> float:
    """Return φ = θ - γ, the offset between the heading seen and the IMU's yaw.

    Paper: Eq. (5).
    """
    return wrap(seen_rad - yaw_rad)


class OffsetEstimator:
    """θ = γ + φ; φ is renewed whenever vision and IMU are in step."""

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
    """The paper's rule watches nothing."""

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Take one signal; return the heading now, or None before the first heading. Belts tell it nothing."""
        match signal:
            case ImuSample():
                self._update(signal)
            case HeadingMeasurement():
                self._see(signal)
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
        rate = float(sample.angular_velocity_rad_s[2])
        finite = math.isfinite(sample.t_s) and math.isfinite(rate) and bool(np.isfinite(R).all())
        if not finite or (self._t_s is not None and not sample.t_s > self._t_s):
            return
        self._t_s, self._rate = sample.t_s, rate
        self._yaw = float(np.arctan2(R[1, 0], R[0, 0]))
        self._yaws.append((self._t_s, self._yaw))
        while self._t_s - self._yaws[0][0] > MEMORY_S:
            self._yaws.popleft()

    def _see(self, seen: HeadingMeasurement) -> None:
        if not (math.isfinite(seen.t_s) and math.isfinite(seen.heading_rad) and seen.t_s > self._frame_s):
            return
        yaw = self._yaw_at(seen.t_s)
        if yaw is None:
            return
        self._frame_s = seen.t_s
        if self._offset is not None and self._rule.breaks(seen.heading_rad, wrap(yaw + self._offset)):
            self.rejected_count += 1
            return
        self._offset = heading_offset(seen.heading_rad, yaw)
        self._seen_s = seen.t_s

    def _yaw_at(self, t_s: float) -> float | None:
        """Return the yaw that the IMU had when a frame was taken, or None if that is too far from all it remembers."""
        nearest = min(self._yaws, key=lambda yaw: abs(yaw[0] - t_s), default=None)
        return None if nearest is None or abs(nearest[0] - t_s) > PAIRED_S else nearest[1]
