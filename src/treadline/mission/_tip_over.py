"""Tip-over feed-forward: belt speed that follows a chair tipping over a nosing. ``ImuSample -> pitch rate, added belt speed``.

A rigid chair tips about a nosing that its centre of mass has passed, onto the next nosing. A belt acceleration a moves the line of
the weight by a/g of its height above the belts. The belts move in the direction of the fall, downhill as the rear drops and uphill
as the front drops, so that the chair falls more slowly and stops less hard (docs/decisions/0019).
"""

import math

from treadline.control.flipper import SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import TICK_S, ImuSample

TIME_CONSTANT_S = 0.015
"""Time constant of the pitch rate filter [s]: a sliding chair vibrates."""
DEAD_BAND_RAD_S = 2.0 * DEG
"""Absolute pitch rate above which the belts act [rad/s]. The belts can change their speed only once; an earlier action would
prolong the fall."""
MAX_DURATION_S = 0.4
"""Longest fall [s]; a longer pitch motion is the stair itself or a gyro bias."""
DECAY_M_S2 = 0.2
"""Rate at which the added speed decreases [m/s²]: the decrease tips the chair in the other direction and takes friction."""


class TipOverFeedforward:
    """Filters the pitch rate and computes the added belt speed, positive uphill."""

    def __init__(self) -> None:
        self.rate_rad_s = 0.0
        """Filtered pitch rate [rad/s], positive as the front drops, negative as the rear drops."""
        self._imu_s = math.nan
        self._added_m_s = 0.0
        self._since_s: float | None = None
        """Time at which the fall began [s]."""

    def update(self, imu: ImuSample) -> None:
        """Update with one IMU sample."""
        dt_s = 0.0 if math.isnan(self._imu_s) else max(imu.t_s - self._imu_s, 0.0)
        self._imu_s = imu.t_s
        self.rate_rad_s += (imu.angular_velocity_rad_s[1] - self.rate_rad_s) * (1.0 - math.exp(-dt_s / TIME_CONSTANT_S))

    def step(self, t_s: float, *, allowed: bool) -> float:
        """Return the speed added to both belts at this tick [m/s], positive uphill.

        Args:
            t_s: Mission time.
            allowed: Whether speed may be added; speed that was added before still decreases.
        """
        if abs(self.rate_rad_s) <= DEAD_BAND_RAD_S:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = t_s
        falls = allowed and self._since_s is not None and t_s - self._since_s < MAX_DURATION_S
        asked = math.copysign(SLOW_M_S, self.rate_rad_s) if falls else 0.0  # belts at the slow speed do not turn round
        kept = math.copysign(max(abs(self._added_m_s) - DECAY_M_S2 * TICK_S, 0.0), self._added_m_s)
        self._added_m_s = asked if abs(asked) > abs(kept) else kept
        return self._added_m_s
