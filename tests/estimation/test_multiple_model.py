"""The multiple-model Kalman filter between two frames."""

import math

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.estimation._multiple_model import GyroModel, MultipleModelKalmanFilter


def started(model: GyroModel) -> MultipleModelKalmanFilter:
    bank = MultipleModelKalmanFilter(model)
    bank.start(0.3, 1e-4, 4e-5, known=False)
    return bank


def test_the_covariance_follows_the_error_transition() -> None:
    model = GyroModel(angle_random_walk_rad_sqrt_s=(0.01 * DEG,))
    bank = started(model)
    P, dt, rate = bank._P[0].copy(), 0.5, 0.2
    F = bank.propagate(dt, rate)
    keep = math.exp(-dt / model.shared_s)
    np.testing.assert_allclose(F, [[1.0, -dt, -dt * rate, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, keep]])
    Q = np.diag([(0.01 * DEG) ** 2 * dt, model.bias_walk_rad_s2**2 * dt, 0.0, (1.0 - keep**2) * 4e-5])
    np.testing.assert_allclose(bank._P[0], F @ P @ F.T + Q, rtol=1e-12, atol=1e-18)
    assert bank.moments.heading == pytest.approx(0.3 + dt * rate)


def test_the_mixture_variance_includes_the_difference_of_the_levels() -> None:
    bank = started(GyroModel())
    alone = bank.moments.variance
    bank._x[1, 0] += 0.02
    bank._update_moments()
    weight = bank._weights[1]
    assert bank.moments.heading == pytest.approx(0.3 + weight * 0.02)
    # Variance of a mixture: the variance of its parts, plus weight · (1 - weight) · gap² for their distance.
    assert bank.moments.variance == pytest.approx(alone + weight * (1.0 - weight) * 0.02**2)


def test_the_moments_follow_every_change() -> None:
    bank = started(GyroModel())
    before = bank.moments
    bank.widen(1e-3)
    assert bank.moments.variance == pytest.approx(before.variance + 1e-3)
    bank.share(1e-5)  # half of the shared error's sigma
    assert bank.moments.vision_variance != before.vision_variance
    bank.shift(np.array([0.1, 0.0, 0.0, 0.0]), np.zeros((4, 4)))
    assert bank.moments.heading == pytest.approx(0.2)
    bank.correct(0.25, 1e-6, 0.1)
    assert bank.moments.vision == pytest.approx(0.25, abs=1e-3)
