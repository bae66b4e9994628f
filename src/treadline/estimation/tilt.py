"""Attitude where the IMU gives none: gyro and accelerometer, blended.

``ImuSample -> orientation``. Depth cameras carry such IMUs; what vision needs of them is the direction of gravity. The yaw is
the gyro's alone: its zero is arbitrary and it drifts, which is all that an ``ImuSample`` promises.
"""

import numpy as np
from jaxtyping import Float

from treadline.angles import levelling, quaternion_of, rotation_about, rotation_of
from treadline.signals import ImuSample

BLEND_S = 2.0
"""Time constant from gyro to accelerometer: longer than a step's jolt, shorter than the drift of a cheap gyro takes for 0.1°."""
AT_REST = 0.1
"""Share by which the specific force may differ from its usual length and still point along gravity."""
LONGEST_S = 0.1
"""A longer pause says nothing of how the chair turned: the accelerometer is believed anew."""


class Tilt:
    """Direction of gravity and yaw from angular rates and specific force."""

    def __init__(self) -> None:
        self._R_WB: Float[np.ndarray, "3 3"] | None = None
        self._t_s = 0.0
        self._usual = 0.0

    def step(self, sample: ImuSample) -> Float[np.ndarray, " 4"] | None:
        """Return the orientation after one more sample, or None before the first force was felt."""
        force, rate = sample.linear_acceleration_m_s2, sample.angular_velocity_rad_s
        if not np.isfinite(rate).all():
            return None  # the next sample's time takes in this one's
        length = float(np.linalg.norm(force))
        felt = np.isfinite(length) and length > 0.0
        dt_s = sample.t_s - self._t_s
        self._t_s = sample.t_s
        if self._R_WB is None or dt_s > LONGEST_S:
            if not felt:
                return None
            R_WB = np.eye(3) if self._R_WB is None else self._R_WB
            R_WB = rotation_about(levelling(R_WB @ force)) @ R_WB
            self._usual = length
        else:
            R_WB = self._R_WB @ rotation_about(dt_s * rate)
            # The usual length is the sensor's own idea of g: some count in g, all have a scale error.
            if felt and abs(length - self._usual) < AT_REST * self._usual:
                share = dt_s / BLEND_S
                self._usual += share * (length - self._usual)
                R_WB = rotation_about(share * levelling(R_WB @ force)) @ R_WB
        orientation = quaternion_of(R_WB)
        # Through the quaternion: rounding never makes it anything but a rotation.
        self._R_WB = rotation_of(orientation)
        return orientation
