"""Where the chair has come by its belts, for RViz and other planners; nothing of ours steers by it.

``ImuSample, TrackReading -> Odometry``.
"""

import numpy as np

from treadline.angles import rotation_of
from treadline.nodes.words import Odometry
from treadline.signals import ImuSample, TrackReading

GAP_S = 0.2
"""Between two readings of the belts, over which nothing is made up."""


class DeadReckoning:
    """Adds up what the belts run along the way that the IMU says the chair looks; belts slip, and nothing corrects it."""

    def __init__(self) -> None:
        self._p_OB = np.zeros(3)
        self._imu: ImuSample | None = None
        self._t_s: float | None = None

    def feel(self, sample: ImuSample) -> None:
        """Take an attitude."""
        self._imu = sample

    def step(self, reading: TrackReading) -> Odometry | None:
        """Return where the chair is after what the belts ran; None before the first attitude."""
        if self._imu is None:
            return None
        speed_m_s = 0.5 * (reading.left_m_s + reading.right_m_s)
        passed_s = 0.0 if self._t_s is None else reading.t_s - self._t_s
        self._t_s = reading.t_s
        if 0.0 < passed_s <= GAP_S:
            self._p_OB = self._p_OB + speed_m_s * passed_s * rotation_of(self._imu.orientation)[:, 0]
        return Odometry(
            t_s=reading.t_s,
            p_OB=self._p_OB,
            orientation=self._imu.orientation,
            speed_m_s=speed_m_s,
            angular_velocity_rad_s=self._imu.angular_velocity_rad_s,
        )
