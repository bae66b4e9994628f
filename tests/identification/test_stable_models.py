"""Stabilised models keep their stable poles."""

import numpy as np
import pytest
from jaxtyping import Float
from systems import fit, system, white_record

from treadline.identification._affine import Affine, stabilised


def random_matrix(seed: int, order: int, radius: float) -> Float[np.ndarray, "n n"]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((order, order))
    return np.asarray(radius / np.abs(np.linalg.eigvals(A)).max() * A)


def affine(A: Float[np.ndarray, "n n"]) -> Affine:
    n = len(A)
    return Affine(A=A, B=np.eye(n), C=np.eye(n), D=np.zeros((n, n)))


@pytest.mark.parametrize("seed", range(8))
def test_stabilisation_mirrors_poles_outside_the_circle_and_moves_no_other(seed: int) -> None:
    A = random_matrix(seed, 5, 1.3)
    before, after = np.linalg.eigvals(A), np.linalg.eigvals(stabilised(affine(A)).A)
    assert np.abs(before).max() > 1.0
    for pole in before:
        expected = pole if abs(pole) < 1.0 else 1.0 / pole.conjugate()
        assert np.abs(after - expected).min() < 1e-9


def test_a_double_integrator_made_stable_still_integrates_twice() -> None:
    found = stabilised(affine(np.array([[1.0, 1.0], [0.0, 1.0]]))).A
    assert np.abs(np.linalg.eigvals(found)).max() < 1.0
    # The second state drives the first one sample later, as before.
    np.testing.assert_allclose(found, [[1.0, 1.0], [0.0, 1.0]], atol=1e-3)


def test_identification_with_stable_gives_a_stable_model_of_a_growing_plant() -> None:
    noisy = white_record(system([[1.01]], [[1.0]], [[1.0]]), 1, 200, noise=0.01)
    plain, stable = (fit(noisy, order=1, method="okid-era", stable=stable).model for stable in (False, True))
    assert float(plain.A[0, 0]) == pytest.approx(1.01, abs=1e-3)
    assert float(stable.A[0, 0]) == pytest.approx(1.0 / 1.01, abs=1e-3)
    assert stable.observer_gain is not None
    assert np.abs(np.linalg.eigvals(stable.A - stable.observer_gain @ stable.C)).max() < 1.0
