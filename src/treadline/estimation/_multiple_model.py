"""Multiple-model Kalman filter: one filter per candidate gyro noise level, weighted by predictive likelihood.

State of each filter: heading [rad], gyro bias [rad/s], gyro scale error, and the error shared by successive frames [rad].
The angle random walk of a gyro cannot be read off its samples, because chassis vibration looks like noise but does not
integrate to a drift. Vision a minute later distinguishes the two, so the noise level is learned.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.estimation import _multiple_model_kernels as kernels


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroModel:
    """Gyro error model: noise, bias, scale, and the prior over noise levels."""

    angle_random_walk_rad_sqrt_s: tuple[float, ...] = (0.004 * DEG, 0.036 * DEG)
    """Candidate gyro angle random walks [rad/√s], one filter each: MPU-6050 data sheet (0.005 °/s/√Hz), and nine times that,
    equal to 0.36 °/s on each of 100 samples a second. Intermediate levels did not improve the estimate of sigma."""
    bias_walk_rad_s2: float = 0.0007 * DEG
    """Rate random walk of the bias [rad/s/√s], from a Gauss–Markov bias of 0.005 °/s and 100 s."""
    bias_sigma_rad_s: float = 0.03 * DEG
    """Standard deviation of the initial bias [rad/s]."""
    scale_sigma: float = 0.006
    """Standard deviation of the initial scale error, at most 1 %; observable in turns seen by vision."""
    log_odds: float = -0.7
    """Prior log odds of each noise level over the next lower: two to one for the data sheet's level."""
    shared_s: float = 15.0
    """Correlation time of the errors shared by frames [s]: skewed nosings stay in view for ten seconds, calibration is constant."""
    memory_s: float = 300.0
    """Time constant of the likelihoods [s] that weight the noise levels."""


class MixtureMoments(NamedTuple):
    """Mean and variance of the Gaussian mixture over the noise levels, including the spread between levels."""

    heading: float
    bias: float
    """Gyro bias [rad/s]."""
    scale: float
    """Gyro scale error (scale factor minus one)."""
    angle_random_walk_rad_sqrt_s: float
    """Gyro angle random walk [rad/√s]."""
    variance: float
    """Variance of the heading [rad²]."""
    vision: float
    """Predicted vision heading [rad], including the shared frame error."""
    vision_variance: float


class MultipleModelKalmanFilter:
    """Kalman filters with different gyro noise levels, and their weights."""

    moments: MixtureMoments

    def __init__(self, model: GyroModel) -> None:
        self._model = model
        levels = len(model.angle_random_walk_rad_sqrt_s)
        self._walk = np.square(np.array(model.angle_random_walk_rad_sqrt_s))
        self._x = np.zeros((levels, 4))
        self._P = np.zeros((levels, 4, 4))
        self._shared = 0.0
        self._evidence = model.log_odds * np.arange(levels)
        self._weights = np.exp(self._evidence) / np.exp(self._evidence).sum()
        self._update_moments()

    def start(self, heading: float, white: float, shared: float, *, known: bool) -> None:
        """Initialise the heading from vision.

        Args:
            heading: Heading [rad].
            white: Variance of the error independent between frames [rad²].
            shared: Variance of the error shared by neighbouring frames [rad²].
            known: Whether to keep the estimated gyro bias and scale.
        """
        model = self._model
        if not known:
            self._x[:] = 0.0
            self._P[:] = np.diag([0.0, model.bias_sigma_rad_s**2, model.scale_sigma**2, 0.0])
        for at in (0, 3):
            self._P[:, at, :] = self._P[:, :, at] = 0.0
        self._P[:, 0, 0] = white + shared
        self._P[:, 3, 3] = shared
        self._P[:, 0, 3] = self._P[:, 3, 0] = -shared
        self._x[:, 0], self._x[:, 3] = heading, 0.0
        self._shared = shared
        self._update_moments()

    def share(self, shared: float) -> None:
        """Set the current variance of the shared frame error [rad²]."""
        if shared < self._shared:
            # The variance formerly attributed to the shared error is now independent noise.
            factor = math.sqrt(shared / self._shared)
            self._x[:, 3] *= factor
            self._P[:, 3, :] *= factor
            self._P[:, :, 3] *= factor
            self._update_moments()
        self._shared = shared

    def propagate(self, dt: float, rate_rad_s: float) -> Float[np.ndarray, "4 4"]:
        """Integrate the gyro rate over ``dt``; return the error transition matrix."""
        model = self._model
        keep = math.exp(-dt / model.shared_s)
        F: Float[np.ndarray, "4 4"]
        F, moments = kernels.propagate(
            self._x, self._P, self._weights, self._walk, rate_rad_s, dt, model.bias_walk_rad_s2**2, keep, self._shared
        )
        self.moments = MixtureMoments(*moments)
        return F

    def widen(self, variance: float) -> None:
        """Add ``variance`` to the heading uncertainty."""
        self._P[:, 0, 0] += variance
        self._update_moments()

    def correct(self, heading: float, variance: float, dt_s: float) -> Float[np.ndarray, " 4"]:
        """Update with a vision heading, ``dt_s`` after the previous update; return the mean Kalman gain."""
        x, P = self._x, self._P
        innovation = np.array([wrap(heading - float(at)) for at in x[:, 0] + x[:, 3]])
        PH = P[:, :, 0] + P[:, :, 3]
        S = PH[:, 0] + PH[:, 3] + variance
        gain = PH / S[:, None]
        x += gain * innovation[:, None]
        P -= gain[:, :, None] * PH[:, None, :]
        P[:] = 0.5 * (P + P.transpose(0, 2, 1))
        keep = math.exp(-min(max(dt_s, 0.0), self._model.memory_s) / self._model.memory_s)
        self._evidence = keep * self._evidence - 0.5 * (np.square(innovation) / S + np.log(S))
        self._evidence -= self._evidence.max()
        weights = np.exp(self._evidence)
        self._weights = weights / weights.sum()
        self._update_moments()
        return np.asarray(self._weights @ gain)

    def shift(self, error: Float[np.ndarray, " 4"], covariance: Float[np.ndarray, "4 4"]) -> None:
        """Subtract an estimated error from every filter's state and add its covariance."""
        self._x -= error
        self._P += covariance
        self._update_moments()

    def _update_moments(self) -> None:
        self.moments = MixtureMoments(*kernels.moments(self._x, self._P, self._weights, self._walk))
