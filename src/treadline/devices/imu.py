"""Error models of the inertial sensors: what a cheap IMU on a shaking chassis reports.

MPU-6050 figures: gyro noise 0.005 °/s/√Hz, bias a Gauss–Markov process of 0.005 °/s and 100 s, 0.02 °/s left after the
bias was taken at rest, scale error 1 %. Track vibration of 0.3 °/s RMS while the belts move is an assumption; vibration is
motion, so what is felt is the rate of an angle that stays within a hundredth of a degree (docs/decisions/0011).
"""

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float

from treadline.angles import DEG, quaternion_of, rotation_x, rotation_y, rotation_z
from treadline.devices.kernels import TICK_S
from treadline.signals import ImuSample

GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuErrors:
    """One sensor's data sheet."""

    gyro_noise_rad_s_rthz: float
    bias_wander_rad_s: float
    bias_time_s: float
    bias_left_rad_s: float
    scale: float
    vibration_rad_s: float
    """RMS of the rate at which the chassis shakes while the belts move."""
    accelerometer_noise_m_s2: float
    tilt_noise_rad: float
    """Of the attitude filter, correlated over ``tilt_time_s``."""
    tilt_time_s: float = 1.0
    vibration_hz: float = 8.0
    """Cleats 25 mm apart at 0.2 m/s."""
    vibration_damping: float = 0.15


MPU6050 = ImuErrors(
    gyro_noise_rad_s_rthz=0.005 * DEG,
    bias_wander_rad_s=0.005 * DEG,
    bias_time_s=100.0,
    bias_left_rad_s=0.02 * DEG,
    scale=0.01,
    vibration_rad_s=0.3 * DEG,
    accelerometer_noise_m_s2=0.03,
    tilt_noise_rad=0.05 * DEG,
)
IMUS = {
    "mpu6050": MPU6050,
    "mpu9250": replace(MPU6050, gyro_noise_rad_s_rthz=0.01 * DEG),
    "ideal": ImuErrors(
        gyro_noise_rad_s_rthz=0.0,
        bias_wander_rad_s=0.0,
        bias_time_s=100.0,
        bias_left_rad_s=0.0,
        scale=0.0,
        vibration_rad_s=0.0,
        accelerometer_noise_m_s2=0.0,
        tilt_noise_rad=0.0,
    ),
}


class Imu:
    """Turns true motion into samples at 100 Hz."""

    def __init__(self, errors: ImuErrors, gravity_error_rad: float, rng: np.random.Generator) -> None:
        self._errors = errors
        self._rng = rng
        draw = rng.standard_normal(8)
        self._bias_left = errors.bias_left_rad_s * draw[:3]
        self._bias = errors.bias_wander_rad_s * draw[3:6]
        self._scale = 1.0 + errors.scale * (2.0 * rng.random(3) - 1.0)
        self._yaw_error = float(rng.uniform(-math.pi, math.pi))
        direction = float(rng.uniform(-math.pi, math.pi))
        tilt = gravity_error_rad
        self._R_tilt = rotation_x(tilt * math.cos(direction)) @ rotation_y(tilt * math.sin(direction))
        self._wander = errors.tilt_noise_rad * draw[6:8]
        self._shaken = np.zeros(3, dtype=np.complex128)

    def sample(
        self,
        t_s: float,
        R_WB: Float[np.ndarray, "3 3"],
        rate_B: Float[np.ndarray, " 3"],
        acceleration_W: Float[np.ndarray, " 3"],
        *,
        moving: bool,
    ) -> ImuSample:
        """Return the sample of one instant."""
        errors = self._errors
        draw = self._rng.standard_normal(17)
        keep = math.exp(-TICK_S / errors.bias_time_s)
        self._bias = keep * self._bias + errors.bias_wander_rad_s * math.sqrt(1.0 - keep * keep) * draw[0:3]
        noise = errors.gyro_noise_rad_s_rthz * math.sqrt(0.5 / TICK_S) * draw[3:6]
        noise = noise + self._shake(draw[6:9] + 1j * draw[14:17], moving=moving)
        measured = self._scale * rate_B + self._bias_left + self._bias + noise
        # The attitude's tilt is held by gravity; its yaw is what the gyro makes of it.
        self._yaw_error += TICK_S * float(R_WB[2] @ (measured - rate_B))
        keep = math.exp(-TICK_S / errors.tilt_time_s)
        self._wander = keep * self._wander + errors.tilt_noise_rad * math.sqrt(1.0 - keep * keep) * draw[12:14]
        small = np.array(
            [
                [1.0, 0.0, self._wander[1]],
                [0.0, 1.0, -self._wander[0]],
                [-self._wander[1], self._wander[0], 1.0],
            ]
        )
        force = R_WB.T @ (acceleration_W + np.array([0.0, 0.0, GRAVITY_M_S2]))
        return ImuSample(
            t_s=t_s,
            orientation=quaternion_of(rotation_z(self._yaw_error) @ R_WB @ self._R_tilt @ small),
            angular_velocity_rad_s=measured,
            linear_acceleration_m_s2=force + errors.accelerometer_noise_m_s2 * draw[9:12],
        )

    def _shake(self, draw: Complex[np.ndarray, " 3"], *, moving: bool) -> Float[np.ndarray, " 3"]:
        """Return the mean rate of the chassis' shaking over one tick: a damped resonance that the belts drive.

        The angle is the real part of a phasor; the rate is its difference, so the sum of all rates is the angle itself.
        """
        errors = self._errors
        turn = 2.0 * math.pi * errors.vibration_hz * TICK_S
        keep = math.exp(-errors.vibration_damping * turn)
        angle_rad = errors.vibration_rad_s * TICK_S / math.sqrt(2.0 * (1.0 - keep * math.cos(turn)))
        driven = angle_rad * math.sqrt(1.0 - keep * keep) * draw if moving else 0.0
        before = self._shaken.real
        self._shaken = keep * cmath.exp(1j * turn) * self._shaken + driven
        return np.asarray((self._shaken.real - before) / TICK_S)
