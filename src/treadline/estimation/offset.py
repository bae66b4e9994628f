"""The paper's fusion: the offset between the heading seen and the IMU's yaw.

Paper: Section III.B, Eq. (5). Its yaw is about gravity, while heading turns about the nosing plane's normal: on a 28°
stair, 30° of heading are 33.2° of yaw. The mode is kept as printed; ``HeadingFilter`` is what drives.
"""

import numpy as np

from treadline.angles import DEG, rotation_of, wrap
from treadline.estimation.aberration import AberrationRule
from treadline.signals import HeadingEstimate, HeadingMeasurement, ImuSample

OFFSET_SIGMA_RAD = 0.5 * DEG
"""Declared uncertainty: the method gives none of its own."""
COAST_S = 0.5


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
        self.rejected_count = 0

    def step(self, signal: ImuSample | HeadingMeasurement) -> HeadingEstimate | None:
        """Take one signal; return the heading now, or None before the first heading."""
        if isinstance(signal, ImuSample):
            self._feel(signal)
        else:
            self._see(signal)
        if self._offset is None or self._yaw is None or self._t_s is None:
            return None
        return HeadingEstimate(
            t_s=self._t_s,
            heading_rad=wrap(self._yaw + self._offset),
            heading_rate_rad_s=self._rate,
            sigma_rad=OFFSET_SIGMA_RAD,
            source="vision" if self._t_s - self._seen_s <= COAST_S else "gyro",
        )

    def _feel(self, sample: ImuSample) -> None:
        R = rotation_of(sample.orientation)
        rate = float(sample.angular_velocity_rad_s[2])
        if np.isfinite(R).all() and np.isfinite(rate) and (self._t_s is None or sample.t_s > self._t_s):
            self._t_s, self._rate = sample.t_s, rate
            self._yaw = float(np.arctan2(R[1, 0], R[0, 0]))

    def _see(self, seen: HeadingMeasurement) -> None:
        if self._yaw is None or not np.isfinite(seen.heading_rad):
            return
        if self._offset is not None and self._rule.breaks(seen.heading_rad, wrap(self._yaw + self._offset)):
            self.rejected_count += 1
            return
        self._offset = heading_offset(seen.heading_rad, self._yaw)
        self._seen_s = seen.t_s
