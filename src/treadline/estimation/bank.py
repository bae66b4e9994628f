"""The filter's mathematics: one Kalman filter per level of gyro noise, weighed by how well each foretells the vision.

State of each: heading [rad], gyro bias [rad/s], gyro scale error, and what frames err by together [rad]. How much a gyro
random-walks cannot be read off its samples: a chassis that shakes looks like noise and adds up to nothing. What vision says a
minute later does tell, so the level is learned.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, wrap
from treadline.estimation import kernels


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroModel:
    """What a gyro may err by."""

    walk_rad_rts: tuple[float, ...] = (0.004 * DEG, 0.036 * DEG)
    """Levels of white rate noise, as what they walk in a second: an MPU-6050 alone (0.005 °/s/√Hz), and nine times that, which
    is 0.36 °/s on each of 100 samples a second. More levels in between told sigma no better."""
    bias_walk_rad_s2: float = 0.0007 * DEG
    """Gauss–Markov bias of 0.005 °/s and 100 s, per root second."""
    bias_sigma_rad_s: float = 0.03 * DEG
    """Of the bias at the start."""
    scale_sigma: float = 0.006
    """Of the scale at the start, 1 % at most; turns that vision sees tell it."""
    log_odds: float = -0.7
    """Of each level over the one below at the start: two to one that the sensor is as its data sheet says."""
    shared_s: float = 15.0
    """How long errors last that frames share: nosings askew stay in view for ten seconds, calibration for good."""
    memory_s: float = 300.0
    """How long what a level foretold counts for or against it."""


class Belief(NamedTuple):
    """What the levels say on average, weighed; variances include the differences between them."""

    heading: float
    bias: float
    """The gyro's [rad/s]."""
    scale: float
    """The gyro's, less one."""
    walk_rad_rts: float
    """The level of noise [rad/√s]."""
    variance: float
    """Of the heading."""
    seen: float
    """The heading that vision would show: errors that frames share included."""
    seen_variance: float


class KalmanBank:
    """The filters, side by side."""

    belief: Belief

    def __init__(self, model: GyroModel) -> None:
        self._model = model
        levels = len(model.walk_rad_rts)
        self._walk = np.square(np.array(model.walk_rad_rts))
        self._x = np.zeros((levels, 4))
        self._P = np.zeros((levels, 4, 4))
        self._shared = 0.0
        self._evidence = model.log_odds * np.arange(levels)
        self._weights = np.exp(self._evidence) / np.exp(self._evidence).sum()
        self._believe()

    def start(self, heading: float, white: float, shared: float, *, known: bool) -> None:
        """Put the heading where vision has it; a gyro that is ``known`` keeps its bias and scale.

        Args:
            white: Variance of what one frame errs by alone.
            shared: Of what it errs by together with its neighbours.
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
        self._believe()

    def share(self, shared: float) -> None:
        """Say how large the variance is now that frames share."""
        if shared < self._shared:
            # What was taken for shared turns out to be each frame's own.
            factor = math.sqrt(shared / self._shared)
            self._x[:, 3] *= factor
            self._P[:, 3, :] *= factor
            self._P[:, :, 3] *= factor
            self._believe()
        self._shared = shared

    def propagate(self, dt: float, rate_rad_s: float) -> Float[np.ndarray, "4 4"]:
        """Turn by what the gyro measured over ``dt``; return the transition of errors."""
        model = self._model
        keep = math.exp(-dt / model.shared_s)
        F: Float[np.ndarray, "4 4"] = kernels.propagate(
            self._x, self._P, self._weights, self._walk, rate_rad_s, dt, model.bias_walk_rad_s2**2, keep, self._shared
        )
        self._believe()
        return F

    def widen(self, variance: float) -> None:
        """Forget where the chair heads, by ``variance``."""
        self._P[:, 0, 0] += variance
        self._believe()

    def correct(self, heading: float, variance: float, dt_s: float) -> Float[np.ndarray, " 4"]:
        """Take a heading that vision saw ``dt_s`` after the one before; return the gain."""
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
        self._believe()
        return np.asarray(self._weights @ gain)

    def shift(self, error: Float[np.ndarray, " 4"], spread: Float[np.ndarray, "4 4"]) -> None:
        """Take an error off every state, and add what is not known of it."""
        self._x -= error
        self._P += spread
        self._believe()

    def _believe(self) -> None:
        heading, bias, scale, walk, variance, seen, seen_variance = kernels.tell(self._x, self._P, self._weights, self._walk)
        self.belief = Belief(wrap(heading), bias, scale, math.sqrt(walk), variance, wrap(seen), seen_variance)
