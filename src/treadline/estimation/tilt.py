"""Attitude from gyro and accelerometer (complementary filter), for IMUs without an orientation output.

``ImuSample -> orientation``. Depth cameras contain such IMUs; vision needs the direction of gravity. The yaw is the
integrated gyro rate: its zero is arbitrary and it drifts, as documented for ``ImuSample``.
"""

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import Rotation, levelling, quaternion_of, rotation_about, rotation_of
from treadline.core.signals import ImuSample

BLEND_S = 2.0
"""Time constant of the complementary filter [s]: longer than a step's jolt, shorter than 0.1° of drift of a low-cost gyro."""
AT_REST = 0.1
"""Largest relative deviation of the specific force from its usual magnitude at which it points along gravity."""
LONGEST_S = 0.1
"""Longest gap between samples [s]; after a longer gap the attitude is reset from the accelerometer."""


class Tilt:
    """Estimator of the gravity direction and yaw from angular rates and specific force."""

    def __init__(self) -> None:
        self._R_WB: Rotation | None = None
        self._t_s = 0.0
        self._usual_force = 0.0

    def step(self, sample: ImuSample) -> Float[np.ndarray, " 4"] | None:
        """Return the orientation after one more sample, or None before the first valid force."""
        force, rate = np.array(sample.linear_acceleration_m_s2), np.array(sample.angular_velocity_rad_s)
        if not np.isfinite(rate).all():
            return None  # the next time step covers this sample's interval
        length = float(np.linalg.norm(force))
        valid = np.isfinite(length) and length > 0.0
        dt_s = sample.t_s - self._t_s
        self._t_s = sample.t_s
        if self._R_WB is None or dt_s > LONGEST_S:
            if not valid:
                return None
            R_WB = np.eye(3) if self._R_WB is None else self._R_WB
            R_WB = rotation_about(levelling(R_WB @ force)) @ R_WB
            self._usual_force = length
        else:
            R_WB = self._R_WB @ rotation_about(dt_s * rate)
            # The usual magnitude is the sensor's own value of g: some sensors report g units, all have a scale error.
            if valid and abs(length - self._usual_force) < AT_REST * self._usual_force:
                share = dt_s / BLEND_S
                self._usual_force += share * (length - self._usual_force)
                R_WB = rotation_about(share * levelling(R_WB @ force)) @ R_WB
        orientation = quaternion_of(R_WB)
        # Conversion through the quaternion keeps the matrix orthonormal.
        self._R_WB = rotation_of(orientation)
        return orientation
