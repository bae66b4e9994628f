"""Compiled kernels of the multiple-model Kalman filter, called at 100 Hz."""

import math

import numpy as np

from treadline.core.fma import dot
from treadline.core.kernel_cache import njit

STATES = 4


@njit(cache=True)
def moments(x, P, weights, walk):
    """Return the fields of ``MixtureMoments``: weighted means over the noise levels, variances with the spread between levels."""
    heading, shown = x[:, 0], x[:, 0] + x[:, 3]
    among, shown_among = heading - dot(weights, heading), shown - dot(weights, shown)
    shown_P = P[:, 0, 0] + 2.0 * P[:, 0, 3] + P[:, 3, 3]
    return (
        (heading[0] + dot(weights, heading - heading[0]) + math.pi) % math.tau - math.pi,
        dot(weights, x[:, 1]),
        dot(weights, x[:, 2]),
        math.sqrt(dot(weights, walk)),
        dot(weights, P[:, 0, 0] + among * among),
        (shown[0] + dot(weights, shown - shown[0]) + math.pi) % math.tau - math.pi,
        dot(weights, shown_P + shown_among * shown_among),
    )


@njit(cache=True)
def propagate(x, P, weights, walk, rate, dt, bias_walk, keep, shared):
    """Propagate each level by the gyro rate, updating ``x`` and ``P`` in place.

    Return the error transition matrix, and ``moments``.

    Args:
        x, P: States and covariances per level.
        weights: Weights of the levels.
        walk: Variance of each level's heading per second; ``bias_walk`` is the variance of the bias.
        rate: Gyro rate [rad/s].
        dt: Time step [s].
        bias_walk: Variance of the bias per second.
        keep: Decay factor of the shared error; ``shared`` is its stationary variance.
        shared: Stationary variance of the shared error.
    """
    turned = dt * (rate - x[:, 1]) * (1.0 - x[:, 2])
    x[:, 0] += turned
    x[:, 3] *= keep
    F = np.eye(STATES)
    F[0, 1], F[0, 2], F[3, 3] = -dt, -dot(weights, turned), keep
    FP = np.empty((STATES, STATES))
    for level in range(x.shape[0]):
        for i in range(STATES):
            for j in range(STATES):
                FP[i, j] = dot(F[i], P[level, :, j])
        for i in range(STATES):
            for j in range(STATES):
                P[level, i, j] = dot(FP[i], F[j])
        P[level, 0, 0] += walk[level] * dt
        P[level, 1, 1] += bias_walk * dt
        P[level, 3, 3] += (1.0 - keep * keep) * shared
    return F, moments(x, P, weights, walk)
