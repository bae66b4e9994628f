"""Error models of the inertial sensors: a low-cost IMU on a vibrating chassis.

MPU-6050 data: gyro noise density 0.005 °/s/√Hz, bias as a Gauss–Markov process with 0.005 °/s and 100 s, residual bias 0.02 °/s
after calibration at rest, scale error 1 %. Track vibration of 0.3 °/s RMS at moving belts is an assumption; vibration is modelled
as motion, the measured rate being the derivative of an angle bounded by a hundredth of a degree (docs/decisions/0011).

The attitude is computed from these samples: a complementary filter corrects the integrated gyro with the accelerometer, so that
accelerations of the chair tilt the attitude and a gyro bias turns its yaw (docs/realism.md). The ideal IMU alone reports the true
attitude.
"""

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np

from treadline.core.angles import DEG
from treadline.core.rotations import Rotation, Vector3, levelling, quaternion_of, rotation_about, rotation_x, rotation_y, rotation_z
from treadline.core.signals import TICK_S, ImuSample
from treadline.plant.sensors import _imu_kernels as kernels
from treadline.scenario.chair import GRAVITY_M_S2


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuErrors:
    """Error parameters of one inertial sensor."""

    gyro_noise_rad_s_rthz: float
    """Gyro noise density [rad/s/√Hz]."""
    bias_wander_rad_s: float
    """Standard deviation of the Gauss–Markov gyro bias [rad/s]."""
    bias_time_s: float
    """Correlation time of the gyro bias [s]."""
    bias_left_rad_s: float
    """Standard deviation of the constant gyro bias after calibration [rad/s]."""
    scale: float
    """Largest relative scale error of the gyro."""
    vibration_rad_s: float
    """RMS angular rate of the chassis vibration at moving belts [rad/s]."""
    accelerometer_noise_m_s2: float
    """Standard deviation of the accelerometer noise per sample [m/s²]."""
    attitude_time_s: float | None = 2.0
    """Time constant of the attitude filter from gyro to accelerometer [s]; None: the true attitude. As in ``estimation.tilt``:
    longer than the jolt of a step, shorter than the time in which a gyro bias of 0.05 °/s turns by 0.1°."""
    vibration_hz: float = 8.0
    """Frequency of the vibration [Hz]: cleats 25 mm apart at 0.2 m/s."""
    vibration_damping: float = 0.15
    """Damping ratio of the vibration."""


MPU6050 = ImuErrors(
    gyro_noise_rad_s_rthz=0.005 * DEG,
    bias_wander_rad_s=0.005 * DEG,
    bias_time_s=100.0,
    bias_left_rad_s=0.02 * DEG,
    scale=0.01,
    vibration_rad_s=0.3 * DEG,
    accelerometer_noise_m_s2=0.03,
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
        attitude_time_s=None,
    ),
}
"""Error parameters by sensor name."""


ALIGNMENT_TICKS = 100
"""Number of samples at rest for the initial tilt of the attitude filter."""


class Imu:
    """Model of an IMU: true motion in, samples at 100 Hz out."""

    def __init__(self, errors: ImuErrors, gravity_error_rad: float, rng: np.random.Generator) -> None:
        self._rng = rng
        self._figures = _figures(errors)
        self._memory = np.zeros((), kernels.MEMORY)
        draw = rng.standard_normal(8)
        self._bias_left = errors.bias_left_rad_s * draw[:3]
        self._memory["bias"] = errors.bias_wander_rad_s * draw[3:6]
        self._scale = 1.0 + errors.scale * (2.0 * rng.random(3) - 1.0)
        self._yaw_rad = rng.uniform(-math.pi, math.pi)
        direction = float(rng.uniform(-math.pi, math.pi))
        error = math.tan(gravity_error_rad) * GRAVITY_M_S2
        # Perpendicular to the chair's z axis: the measured tilt of a chair on horizontal ground equals the gravity error.
        self._force_bias = error * np.array([math.cos(direction), math.sin(direction), 0.0])
        self._alignment_rad = errors.accelerometer_noise_m_s2 / math.sqrt(ALIGNMENT_TICKS) / GRAVITY_M_S2 * draw[6:8]
        self._is_aligned = False

    def _align(self, R_WB: Rotation) -> None:
        """Initialise the attitude filter: tilt from the mean specific force at rest, yaw from an arbitrary zero."""
        force = R_WB[2] * GRAVITY_M_S2 + self._force_bias
        noise = rotation_x(float(self._alignment_rad[0])) @ rotation_y(float(self._alignment_rad[1]))
        R = noise @ rotation_about(levelling(R_WB @ force)) @ R_WB
        self._memory["attitude"] = quaternion_of(rotation_z(self._yaw_rad) @ R)
        self._is_aligned = True

    def sample(self, t_s: float, R_WB: Rotation, rate_B: Vector3, acceleration_W: Vector3, *, moving: bool) -> ImuSample:
        """Return the sample of one tick."""
        if not self._is_aligned:
            self._align(R_WB)
        sample = np.empty(10)
        kernels.imu_sample(
            self._rng.standard_normal(kernels.DRAWS),
            R_WB,
            rate_B,
            acceleration_W,
            moving,
            self._figures,
            self._scale,
            self._bias_left,
            self._force_bias,
            self._memory[()],
            sample,
        )
        qw, qx, qy, qz, gx, gy, gz, ax, ay, az = sample.tolist()
        return ImuSample(
            t_s=t_s,
            orientation=(qw, qx, qy, qz),
            angular_velocity_rad_s=(gx, gy, gz),
            linear_acceleration_m_s2=(ax, ay, az),
        )


def _figures(errors: ImuErrors) -> kernels.ImuFigures:
    """Return the error parameters per tick for the compiled kernel."""
    kept = math.exp(-TICK_S / errors.bias_time_s)
    # The chassis vibration is a damped resonance excited by the belts.
    turn = 2.0 * math.pi * errors.vibration_hz * TICK_S
    keep = math.exp(-errors.vibration_damping * turn)
    angle_rad = errors.vibration_rad_s * TICK_S / math.sqrt(2.0 * (1.0 - keep * math.cos(turn)))
    phasor = keep * cmath.exp(1j * turn)
    return kernels.ImuFigures(
        bias_kept=kept,
        bias_added=errors.bias_wander_rad_s * math.sqrt(1.0 - kept * kept),
        force_share=0.0 if errors.attitude_time_s is None else TICK_S / errors.attitude_time_s,
        gyro_noise=errors.gyro_noise_rad_s_rthz * math.sqrt(0.5 / TICK_S),
        force_noise=errors.accelerometer_noise_m_s2,
        shake_turn=(phasor.real, phasor.imag),
        shake_push=angle_rad * math.sqrt(1.0 - keep * keep),
    )
