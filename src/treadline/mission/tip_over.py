"""A chair that falls over a nosing: told by the gyro, eased by its belts.

``ImuSample -> rate of the fall, speed added to both belts``. A rigid chair tips about a nosing that its centre of mass has
passed, onto the next. Belts that change their speed by a shift the weight's line by a/g of its height above them: they go the way
in which the chair falls, downhill as its rear drops, uphill as its front does, so that it falls more slowly and stops less hard
(docs/decisions/0019).
"""

import math

from treadline.angles import DEG
from treadline.signals import TICK_S, ImuSample

TIME_CONSTANT_S = 0.015
"""In which the rate is smoothed: a chair that slides trembles."""
FALL_RATE_RAD_S = 1.0 * DEG
"""Of pitch, either way, from which on it is a fall."""
DEAD_BAND_RAD_S = 2.0 * DEG
"""From which on the belts go along: they can change their speed but once, and spent at the outset that draws the fall out, …"""
GAIN_M_RAD = 10.0
"""… how much faster, per rate beyond it …"""
LIMIT_M_S = 0.1
"""… and at most: half the cruise speed."""
MAX_DURATION_S = 0.4
"""For which a fall lasts at most; what goes on for longer is the stair, or a gyro that is off."""
DECAY_M_S2 = 0.2
"""At which the speed comes back: that tips the chair the other way, and takes grip."""


class TipOverFeedforward:
    """What is felt of a chair's fall, and what its belts do about it."""

    def __init__(self) -> None:
        self.rate_rad_s = 0.0
        """Of the chair's pitch going down, smoothed; negative as it falls onto its rear."""
        self._imu_s = math.nan
        self._added_m_s = 0.0
        self._since_s: float | None = None
        """When the fall began."""

    def update(self, imu: ImuSample) -> None:
        """Take one sample."""
        dt_s = 0.0 if math.isnan(self._imu_s) else max(imu.t_s - self._imu_s, 0.0)
        self._imu_s = imu.t_s
        self.rate_rad_s += (float(imu.angular_velocity_rad_s[1]) - self.rate_rad_s) * (1.0 - math.exp(-dt_s / TIME_CONSTANT_S))

    def step(self, t_s: float, *, allowed: bool) -> float:
        """Return what is added to both belts at this tick [m/s], uphill positive.

        Args:
            t_s: Now.
            may: Whether the belts are free to go along; what they have added comes back all the same.
        """
        beyond = max(abs(self.rate_rad_s) - DEAD_BAND_RAD_S, 0.0)
        if beyond == 0.0:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = t_s
        falls = allowed and self._since_s is not None and t_s - self._since_s < MAX_DURATION_S
        asked = math.copysign(min(GAIN_M_RAD * beyond, LIMIT_M_S), self.rate_rad_s) if falls else 0.0
        kept = math.copysign(max(abs(self._added_m_s) - DECAY_M_S2 * TICK_S, 0.0), self._added_m_s)
        self._added_m_s = asked if abs(asked) > abs(kept) else kept
        return self._added_m_s
