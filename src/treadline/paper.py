"""Every number the paper prints, under its label.

Y. Choudhary, N. Malhotra, P. K. Sahoo, S. Kamal: *Data-Driven Modeling of a Track-based Stair-Climbing
Wheelchair*, IEEE/ASME AIM 2021. Arrays are read-only.
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
"""Eq. (13): price of the state."""
R: Final = _printed([[0.05, 0.0], [0.0, 0.05]])
"""Eq. (13): price of the input."""
K: Final = _printed([[0.0239, 0.2868], [1.6589, 0.9201]])
"""Eq. (14): feedback gain."""
SAMPLING_TIME_S: Final = 1.0
"""Section VI.B: Ts of the model and of dlqr."""
SAMPLES: Final = 1000
"""Section VI.B: random inputs given for the identification."""
RANK: Final = 2
"""Section VI.B: rank read from the singular values of H."""

MASS_KG: Final = 23.4
"""Table I: mass of the system."""
PAYLOAD_KG: Final = 50.0
"""Table I: mass of the payload."""
FRICTION: Final = (0.62, 0.5)
"""Table I: μ and μ₂, between rubber and a wooden surface."""
SLOPE_DEG: Final = 25.0
"""Table I: staircase angle β."""
MAX_SPEED_M_S: Final = 1.0
"""Table I: v_system(max)."""
MAX_TURN_RATE_RAD_S: Final = 3.07
"""Table I: ω_system(max); with two tracks at ±1 m/s it implies a gauge of 0.65 m."""
IMU_RATE_HZ: Final = 100.0
"""Table I: freq_imu."""
CAMERA_RATE_HZ: Final = 10.0
"""Table I: freq_camera."""
CONTROL_RATE_HZ: Final = 4.0
"""Table I: freq_control."""

FIG9_DURATION_S: Final = 300.0
"""Fig. 9: open against closed loop from 0°."""
FIG10_DURATION_S: Final = 80.0
"""Fig. 10: the time axis of the ±30° starts."""
FIG10_SLOPE_DEG: Final = 28.0
"""Fig. 10: staircase angle."""
FIG11_SLOPE_DEG: Final = 28.0
"""Fig. 11: stair on which the seat was levelled."""

TABLE_II: Final = {
    (25, 30): 2.83, (28, 30): 1.89, (30, 30): 4.95,
    (25, -30): 3.23, (28, -30): 1.37, (30, -30): 1.29,
}  # fmt: skip
"""Table II: RMS heading error [deg] by (slope [deg], start heading [deg])."""
TABLE_II_AVERAGE: Final = {30: 3.22, -30: 1.96}
"""Table II: the printed averages by start heading [deg]."""
