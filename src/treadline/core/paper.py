"""All numbers printed in the paper, under their labels.

Y. Choudhary, N. Malhotra, P. K. Sahoo, S. Kamal: *Data-Driven Modeling of a Track-based Stair-Climbing Wheelchair*, IEEE/ASME AIM
2021. Arrays are read-only.
"""

from typing import Final

import numpy as np
from jaxtyping import Float


def _printed(rows: list[list[float]]) -> Float[np.ndarray, "n m"]:
    array = np.array(rows)
    array.setflags(write=False)
    return array


A: Final = _printed([[0.8605, 0.1844], [-0.2944, 0.3492]])
"""Eq. (12): state transition at Ts = 1 s."""
B: Final = _printed([[0.0334, 0.1474], [0.0740, 0.2090]])
"""Eq. (12): effect of the (left, right) track velocity [m/s]."""
C: Final = _printed([[0.1087, -0.0500], [0.1498, 0.1459]])
"""Eq. (12): outputs heading [rad] and angular velocity [rad/s]."""
D: Final = _printed([[-0.0501, -0.0490], [0.0160, 0.0416]])
"""Eq. (12): direct effect of the inputs on the outputs."""
Q: Final = _printed([[1.0, 0.0], [0.0, 1.0]])
"""Eq. (13): state weight."""
R: Final = _printed([[0.05, 0.0], [0.0, 0.05]])
"""Eq. (13): input weight."""
K: Final = _printed([[0.0239, 0.2868], [1.6589, 0.9201]])
"""Eq. (14): feedback gain."""
SAMPLING_TIME_S: Final = 1.0
"""Section VI.B: sampling time Ts of the model and of dlqr [s]."""
SAMPLES: Final = 1000
"""Section VI.B: number of random input samples for the identification."""
RANK: Final = 2
"""Section VI.B: rank from the singular values of H."""

MASS_KG: Final = 23.4
"""Table I: mass of the system [kg]."""
PAYLOAD_KG: Final = 50.0
"""Table I: mass of the payload [kg]."""
FRICTION: Final = (0.62, 0.5)
"""Table I: friction coefficients μ and μ₂ of rubber on wood."""
SLOPE_DEG: Final = 25.0
"""Table I: staircase angle β [deg]."""
MAX_SPEED_M_S: Final = 1.0
"""Table I: v_system(max) [m/s]."""
MAX_TURN_RATE_RAD_S: Final = 3.07
"""Table I: ω_system(max) [rad/s]; two tracks at ±1 m/s imply a gauge of 0.65 m."""
IMU_RATE_HZ: Final = 100.0
"""Table I: freq_imu [Hz]."""
CAMERA_RATE_HZ: Final = 10.0
"""Table I: freq_camera [Hz]."""
CONTROL_RATE_HZ: Final = 4.0
"""Table I: freq_control [Hz]."""

FIG9_DURATION_S: Final = 300.0
"""Fig. 9: duration of the open-loop and closed-loop runs from 0° [s]."""
FIG10_DURATION_S: Final = 80.0
"""Fig. 10: length of the time axis of the ±30° starts [s]."""
FIG10_SLOPE_DEG: Final = 28.0
"""Fig. 10: staircase angle [deg]."""
FIG11_SLOPE_DEG: Final = 28.0
"""Fig. 11: staircase angle of the seat levelling experiment [deg]."""

TABLE_II: Final = {
    (25, 30): 2.83, (28, 30): 1.89, (30, 30): 4.95,
    (25, -30): 3.23, (28, -30): 1.37, (30, -30): 1.29,
}  # fmt: skip
"""Table II: RMS heading error [deg] by (slope [deg], start heading [deg])."""
TABLE_II_AVERAGE: Final = {30: 3.22, -30: 1.96}
"""Table II: printed averages by start heading [deg]."""
