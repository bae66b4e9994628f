"""Odometry of the belts, for RViz and other planners; no block of this package uses it.

``ImuSample, TrackReading -> Odometry``.
"""

import math
from dataclasses import dataclass

import numpy as np

from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import ImuSample, Quaternion, TrackReading, Vector
from treadline.core.step_sizes import ON_A_FLIGHT_RAD

GAP_S = 0.2
"""Longest interval between two belt readings that is integrated [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry:
    """Pose of the chair by its belts and IMU, in a level frame O with its origin at the start; belts slip, so it drifts."""

    t_s: float
    p_OB: Vector3
    orientation: Quaternion
    """The IMU's quaternion (w, x, y, z) of B in O: its yaw drifts."""
    speed_m_s: float
    angular_velocity_rad_s: Vector
    X_OS: tuple[Rotation, Vector3] | None = None
    """Pose of the stair ahead, R_OS and p_OS, for viewers; None before one is in view. S is on the nearest nosing in view."""


class DeadReckoning:
    """Dead reckoning: integrates the belt speed along the forward axis from the IMU. Slip is not corrected."""

    def __init__(self) -> None:
        self._p_OB = np.zeros(3)
        self._imu: ImuSample | None = None
        self._t_s: float | None = None

    def update(self, sample: ImuSample) -> None:
        """Store the newest attitude."""
        self._imu = sample

    def step(self, reading: TrackReading) -> Odometry | None:
        """Return the odometry after a belt reading; None before the first attitude."""
        if self._imu is None:
            return None
        w, x, y, z = self._imu.orientation
        forward_W = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        speed_m_s = _speed(reading, pitched=abs(forward_W[2]) > math.sin(ON_A_FLIGHT_RAD))
        passed_s = 0.0 if self._t_s is None else reading.t_s - self._t_s
        self._t_s = reading.t_s
        if 0.0 < passed_s <= GAP_S:
            self._p_OB = self._p_OB + speed_m_s * passed_s * np.array(forward_W)
        return Odometry(
            t_s=reading.t_s,
            p_OB=self._p_OB,
            orientation=self._imu.orientation,
            speed_m_s=speed_m_s,
            angular_velocity_rad_s=self._imu.angular_velocity_rad_s,
        )


def _speed(reading: TrackReading, *, pitched: bool) -> float:
    """Return the chair's speed [m/s]: the mean of the belts; on a flight the slower belt's, because the other slips in a turn."""
    left, right = reading.left_m_s, reading.right_m_s
    if not pitched:
        return 0.5 * (left + right)
    return min(left, right, key=abs) if left * right > 0.0 else 0.0
