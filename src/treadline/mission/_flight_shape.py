"""Rise and run of a flight from all frames. ``shapes of frames, nosings -> run, rise, variances``.

Frames and tracked nosings determine rise and run in two ways. The detector's fit of one frame also uses treads and their normals,
and averages over frames; tracked nosings combine the near and precise part of many frames, but lean by the error of the IMU's
gravity. Both come from the same images with unknown correlation, so that each of rise and run is that of the smaller variance,
which is covariance intersection for a scalar.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.mission._nosing_filter import CORRELATED_M, FAR_1_M, OWN_M, OWN_SHARE

IRREGULAR_M = np.array([0.008, 0.006])
"""Standard deviation of a nosing from the lattice, along and in height [m]: that of the detector (docs/decisions/0024)."""
FRAME_M = np.array([0.0015, 0.0017])
"""Standard deviation of run and rise in a frame with nosings near the chair [m]: ``slope`` (0.31°) and ``pitch`` (1.35 mm) for four
nosings in ``data/cameras/statistical.json``, on a flight of 28°."""
GRAVITY_RAD = 0.5 * DEG
"""Standard deviation of the IMU's tilt at rest [rad], as in ``benchmarks/statistical.py``."""
DIFFUSE_M = 0.1
"""Standard deviation of run and rise before the first frame [m]."""


class FlightShape:
    """Run and rise with their variances, each a Kalman filter with a correlated error."""

    def __init__(self) -> None:
        self.mean_m = np.zeros(2)
        """Run and rise [m]; zero before the first frame."""
        self.variance_m2 = np.full(2, math.inf)
        self._state = np.zeros((2, 2))
        """Run and rise by frames alone, each with its correlated error in units of its standard deviation."""
        self._covariance = np.array([np.diag([DIFFUSE_M**2, 1.0])] * 2)

    def update(self, frame_m: tuple[float, float], distances_m: Sequence[float], travel_m: float) -> None:
        """Update with the run and rise of one frame.

        Args:
            frame_m: Run and rise.
            distances_m: Horizontal distances of the frame's nosings from the chair's middle.
            travel_m: Travel of the belts since the frame before, without sign.
        """
        kept = math.exp(-travel_m / CORRELATED_M)
        frame = _lattice(np.zeros((len(distances_m), 2)), _frame_covariance(distances_m), np.arange(float(len(distances_m))))
        sigma_m = np.sqrt(FRAME_M**2 + frame[1]) if len(distances_m) > 1 else np.full(2, DIFFUSE_M)
        if not np.isfinite(self.variance_m2).any():
            self._state[:, 0] = frame_m
        for axis in range(2):
            state, covariance = self._state[axis], self._covariance[axis]
            factor = np.array([1.0, kept])
            covariance = covariance * np.outer(factor, factor) + np.diag([0.0, 1.0 - kept**2])
            state = state * factor
            row = np.array([1.0, math.sqrt(1.0 - OWN_SHARE) * sigma_m[axis]])
            gain = covariance @ row / (row @ covariance @ row + OWN_SHARE * sigma_m[axis] ** 2)
            self._state[axis] = state + gain * (frame_m[axis] - row @ state)
            self._covariance[axis] = covariance - np.outer(gain, row @ covariance)
        self.mean_m, self.variance_m2 = self._state[:, 0].copy(), self._covariance[:, 0, 0].copy()

    def combine(self, places_m: Sequence[tuple[float, float]], covariance_m2: Float[np.ndarray, "k k"]) -> None:
        """Replace run or rise by that of the tracked nosings if its variance is smaller.

        Args:
            places_m: Places (x, z) of the nosings, the lowest first.
            covariance_m2: Covariance of the places in this order, x before z.
        """
        if len(places_m) < 2:
            return
        places = np.asarray(places_m)
        apart = np.maximum(np.rint(np.diff(places, axis=0) @ self.mean_m / (self.mean_m @ self.mean_m)), 1.0)
        found, variance_m2 = _lattice(places, covariance_m2, np.concatenate([[0.0], np.cumsum(apart)]))
        variance_m2 = variance_m2 + (GRAVITY_RAD * found[::-1]) ** 2
        better = variance_m2 < self.variance_m2
        self.mean_m = np.where(better, found, self.mean_m)
        self.variance_m2 = np.where(better, variance_m2, self.variance_m2)


def _frame_covariance(distances_m: Sequence[float]) -> Float[np.ndarray, "k k"]:
    variances = OWN_M**2 + (FAR_1_M * np.square(distances_m)) ** 2
    return np.diag(np.repeat(variances, 2))


def _lattice(
    places: Float[np.ndarray, "n 2"], covariance_m2: Float[np.ndarray, "k k"], numbers: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Return run and rise of numbered nosings by generalised least squares, and the variances of their errors.

    Irregularity weighs the nosings, and is no error: run and rise are the means of the flight as built.
    """
    if len(places) < 2:
        return np.zeros(2), np.full(2, math.inf)
    design = np.hstack([np.kron(np.ones((len(places), 1)), np.eye(2)), np.kron(np.reshape(numbers, (-1, 1)), np.eye(2))])
    weighted = np.linalg.solve(covariance_m2 + np.diag(np.tile(IRREGULAR_M**2, len(places))), design)
    gain = np.linalg.solve(design.T @ weighted, weighted.T)[2:]
    return gain @ places.ravel(), np.diag(gain @ covariance_m2 @ gain.T)
