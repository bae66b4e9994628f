"""Stabilised models keep their stable poles; reduced models satisfy the error bound."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Complex, Float
from systems import Draw, fit, oscillation, system, white_record

from treadline.core.errors import ModelError
from treadline.core.models import LinearModel
from treadline.identification import balanced_truncation
from treadline.identification._affine import Affine
from treadline.identification.reduction import stabilised
from treadline.identification.validate import impulse_response

GRID = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 300)])
"""Frequencies [rad per sample]."""


def random_model(seed: int, order: int, *, radius: float = 0.95) -> LinearModel:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((order, order))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    B, C, D = (rng.standard_normal(shape) for shape in ((order, 2), (3, order), (3, 2)))
    return system(A, B, C, D, dt_s=0.1, input_offset=np.array([1.0, 2.0]), output_offset=np.array([3.0, 4.0, 5.0]))


def response(model: LinearModel) -> Complex[np.ndarray, "w p m"]:
    eye = np.eye(model.order)
    return np.array([model.C @ np.linalg.solve(np.exp(1j * w) * eye - model.A, model.B) + model.D for w in GRID])


def affine(A: Float[np.ndarray, "n n"]) -> Affine:
    n = len(A)
    return Affine(A=A, B=np.eye(n), C=np.eye(n), D=np.zeros((n, n)))


def sorted_poles(A: Float[np.ndarray, "n n"]) -> Complex[np.ndarray, " n"]:
    return np.sort_complex(np.linalg.eigvals(A))


@pytest.mark.parametrize("seed", range(8))
def test_stabilisation_moves_only_unstable_poles(seed: int) -> None:
    A = random_model(seed, 5, radius=1.3).A
    before, after = np.linalg.eigvals(A), np.linalg.eigvals(stabilised(affine(A)).A)
    assert np.abs(before).max() > 1.0
    assert np.abs(after).max() <= 0.9999 + 1e-12
    for pole in before[np.abs(before) < 1.0]:
        assert np.abs(after - pole).min() < 1e-9


def test_a_pole_outside_is_mirrored_and_one_on_the_circle_moved_inside() -> None:
    T = np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.0]])
    found = stabilised(affine(T @ np.diag([1.25, 1.0, 0.5]) @ np.linalg.inv(T))).A
    np.testing.assert_allclose(sorted_poles(found), [0.5, 0.8, 0.9999], atol=1e-12)


def test_a_complex_pair_outside_stays_a_pair_at_its_frequency() -> None:
    found = stabilised(affine(oscillation(1.25, 0.7))).A
    np.testing.assert_allclose(sorted_poles(found), 0.8 * np.exp([-0.7j, 0.7j]), atol=1e-12)


def test_a_stable_model_is_unchanged() -> None:
    system = affine(random_model(0, 4).A)
    assert stabilised(system) is system


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


@pytest.mark.parametrize("seed", range(5))
def test_the_truncation_error_is_below_the_bound_at_every_frequency(seed: int) -> None:
    model = random_model(seed, 6)
    for order in range(1, 7):
        cut = balanced_truncation(model, order)
        worst = np.linalg.norm(response(cut.model) - response(model), 2, axis=(1, 2)).max()
        assert cut.model.order == order
        # The grid may miss the peak, so the check is one-sided; 1e-9 is rounding without truncation.
        assert worst <= cut.bound + 1e-9
        assert np.abs(np.linalg.eigvals(cut.model.A)).max() < 1.0
        assert cut.bound == pytest.approx(2.0 * cut.hankel_values[order:].sum())


def test_hankel_values_are_those_of_the_hankel_matrix() -> None:
    model = random_model(7, 3, radius=0.6)
    Y = impulse_response(model, 81)[1:]
    H = np.block([[Y[i + j] for j in range(40)] for i in range(40)])
    # 0.6^40 of the response is truncated.
    np.testing.assert_allclose(balanced_truncation(model, 2).hankel_values, np.linalg.svd(H)[1][:3], rtol=1e-8)


def test_uncontrollable_and_unobservable_states_are_truncated_without_loss() -> None:
    small = random_model(8, 2)
    A = np.zeros((4, 4))
    A[:2, :2], A[2, 2], A[3, 3], A[0, 3] = small.A, 0.9, 0.8, 0.7
    B, C = np.vstack([small.B, np.ones((1, 2)), np.zeros((1, 2))]), np.hstack([small.C, np.zeros((3, 1)), np.ones((3, 1))])
    model = system(A, B, C, small.D)
    cut = balanced_truncation(model, 2)
    # The third state is unobservable, the fourth uncontrollable.
    np.testing.assert_allclose(impulse_response(cut.model, 30), impulse_response(small, 30), atol=1e-7)
    assert cut.bound < 1e-6
    again = balanced_truncation(model, 4).model
    np.testing.assert_allclose(impulse_response(again, 30), impulse_response(small, 30), atol=1e-6)


def test_a_smaller_model_keeps_its_operating_point_and_its_names(draw: Draw) -> None:
    model = fit(draw(0, noise=0.05), order=2, method="okid-era").model
    cut = balanced_truncation(model, 1).model
    np.testing.assert_array_equal(cut.input_offset, model.input_offset)
    np.testing.assert_array_equal(cut.output_offset, model.output_offset)
    assert (cut.input_names, cut.output_names, cut.dt_s) == (model.input_names, model.output_names, model.dt_s)
    if cut.observer_gain is not None:
        assert np.abs(np.linalg.eigvals(cut.A - cut.observer_gain @ cut.C)).max() < 1.0


@pytest.mark.parametrize("radius", [1.0, 1.2])
def test_an_unstable_model_is_not_cut(radius: float) -> None:
    unstable = replace(random_model(9, 3), A=np.diag([radius, 0.5, 0.2]))
    with pytest.raises(ModelError, match=rf"needs a stable model, this one's spectral radius is {radius:.4f}"):
        balanced_truncation(unstable, 2)


@pytest.mark.parametrize("order", [0, -1, 4])
def test_an_order_that_is_not_below_the_models_is_rejected(order: int) -> None:
    with pytest.raises(ModelError, match=f"the model has 3 states; it cannot be cut to {order}"):
        balanced_truncation(random_model(10, 3), order)
