"""Where the chair has come by its belts, for RViz and other planners; nothing of ours steers by it.

``ImuSample, TrackReading -> Odometry``.
"""

import math

import numpy as np

from treadline.angles import rotation_of
from treadline.mission.stair_tracker import PITCHED_RAD
from treadline.nodes.node_messages import Odometry
from treadline.signals import ImuSample, TrackReading

GAP_S = 0.2
"""Between two readings of the belts, over which nothing is made up."""


class DeadReckoning:
    """Adds up what the belts run along the way that the IMU says the chair looks; belts slip, and nothing corrects it."""

    def __init__(self) -> None:
        self._p_OB = np.zeros(3)
        self._imu: ImuSample | None = None
        self._t_s: float | None = None

    def update(self, sample: ImuSample) -> None:
        """Take an attitude."""
        self._imu = sample

    def step(self, reading: TrackReading) -> Odometry | None:
        """Return where the chair is after what the belts ran; None before the first attitude."""
        if self._imu is None:
            return None
        forward_W = rotation_of(self._imu.orientation)[:, 0]
        speed_m_s = _speed(reading, pitched=abs(float(forward_W[2])) > math.sin(PITCHED_RAD))
        passed_s = 0.0 if self._t_s is None else reading.t_s - self._t_s
        self._t_s = reading.t_s
        if 0.0 < passed_s <= GAP_S:
            self._p_OB = self._p_OB + speed_m_s * passed_s * forward_W
        return Odometry(
            t_s=reading.t_s,
            p_OB=self._p_OB,
            orientation=self._imu.orientation,
            speed_m_s=speed_m_s,
            angular_velocity_rad_s=self._imu.angular_velocity_rad_s,
        )


def _speed(reading: TrackReading, *, pitched: bool) -> float:
    """Return how fast the chair goes: as its belts on average; on a flight as the slower one, for the other slips in a turn."""
    left, right = reading.left_m_s, reading.right_m_s
    if not pitched:
        return 0.5 * (left + right)
    return min(left, right, key=abs) if left * right > 0.0 else 0.0
