"""The innovation gain of A and C is recovered from OKID's observer."""

import numpy as np
import pytest

from treadline.core.models import LinearModel
from treadline.identification._okid import ObserverMarkov
from treadline.identification._realisation import observer_gain

LAGS = 60


def observer_of(model: LinearModel, K: np.ndarray) -> ObserverMarkov:
    """Return the observer of a model with a gain: α_i = C (A-KC)^(i-1) (B-KD), β_i = C (A-KC)^(i-1) K."""
    p, m = model.D.shape
    alpha, beta, reach = np.empty((LAGS, p, m)), np.empty((LAGS, p, p)), model.C.copy()
    for i in range(LAGS):
        alpha[i], beta[i] = reach @ (model.B - K @ model.D), reach @ K
        reach = reach @ (model.A - K @ model.C)
    q = 1 + m + LAGS * (m + p)
    return ObserverMarkov(
        bias=np.zeros(p),
        D=model.D.copy(),
        alpha=alpha,
        beta=beta,
        residual_covariance=np.eye(p),
        information=np.eye(q),
        count=1e4,
        feedthrough=True,
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_gain_of_a_known_observer_is_recovered(eq_12: LinearModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Gain that places the poles of the observer, A - KC, at two random numbers well inside the circle.
    K = (eq_12.A - np.diag(rng.uniform(-0.6, 0.6, 2))) @ np.linalg.inv(eq_12.C)
    found = observer_gain(eq_12.A, eq_12.C, observer_of(eq_12, K))
    assert found is not None
    # After sixty samples 0.6^60 = 5e-14 of the observer's response remains.
    np.testing.assert_allclose(found, K, atol=1e-9)
