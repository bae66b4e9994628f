"""Error models of the inertial sensors: what a cheap IMU on a shaking chassis reports.

MPU-6050 figures: gyro noise 0.005 °/s/√Hz, bias a Gauss–Markov process of 0.005 °/s and 100 s, 0.02 °/s left after the
bias was taken at rest, scale error 1 %. Track vibration of 0.3 °/s RMS while the belts move is an assumption; vibration is
motion, so what is felt is the rate of an angle that stays within a hundredth of a degree (docs/decisions/0011).
"""

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rotation_x, rotation_y
from treadline.devices import kernels
from treadline.signals import TICK_S, ImuSample


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
        self._rng = rng
        self._figures = _figures(errors)
        self._memory = np.zeros(kernels.MEMORY)
        draw = rng.standard_normal(8)
        self._bias_left = errors.bias_left_rad_s * draw[:3]
        self._memory[kernels.BIAS : kernels.BIAS + 3] = errors.bias_wander_rad_s * draw[3:6]
        self._scale = 1.0 + errors.scale * (2.0 * rng.random(3) - 1.0)
        self._memory[kernels.YAW] = rng.uniform(-math.pi, math.pi)
        direction = float(rng.uniform(-math.pi, math.pi))
        tilt = gravity_error_rad
        self._R_tilt = rotation_x(tilt * math.cos(direction)) @ rotation_y(tilt * math.sin(direction))
        self._memory[kernels.TILT : kernels.TILT + 2] = errors.tilt_noise_rad * draw[6:8]

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
        orientation, rate, force = kernels.imu_sample(
            self._rng.standard_normal(kernels.DRAWS),
            R_WB,
            rate_B,
            acceleration_W,
            moving,
            self._figures,
            self._scale,
            self._bias_left,
            self._R_tilt,
            self._memory,
        )
        return ImuSample(t_s=t_s, orientation=orientation, angular_velocity_rad_s=rate, linear_acceleration_m_s2=force)


def _figures(errors: ImuErrors) -> Float[np.ndarray, " n"]:
    """Return a data sheet's figures per tick, as the compiled sample takes them."""
    figures = np.empty(kernels.FIGURES)
    for kept, added, time_s, sigma in (
        (kernels.BIAS_KEPT, kernels.BIAS_ADDED, errors.bias_time_s, errors.bias_wander_rad_s),
        (kernels.TILT_KEPT, kernels.TILT_ADDED, errors.tilt_time_s, errors.tilt_noise_rad),
    ):
        keep = math.exp(-TICK_S / time_s)
        figures[kept], figures[added] = keep, sigma * math.sqrt(1.0 - keep * keep)
    figures[kernels.GYRO_NOISE] = errors.gyro_noise_rad_s_rthz * math.sqrt(0.5 / TICK_S)
    figures[kernels.FORCE_NOISE] = errors.accelerometer_noise_m_s2
    # The chassis shakes as a damped resonance that the belts drive.
    turn = 2.0 * math.pi * errors.vibration_hz * TICK_S
    keep = math.exp(-errors.vibration_damping * turn)
    angle_rad = errors.vibration_rad_s * TICK_S / math.sqrt(2.0 * (1.0 - keep * math.cos(turn)))
    phasor = keep * cmath.exp(1j * turn)
    figures[kernels.SHAKE_TURN : kernels.SHAKE_TURN + 2] = phasor.real, phasor.imag
    figures[kernels.SHAKE_PUSH] = angle_rad * math.sqrt(1.0 - keep * keep)
    return figures
