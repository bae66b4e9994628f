"""ERA on known impulse responses, and the order from singular values."""

import numpy as np
import pytest
from scipy.signal import lfilter
from systems import Draw, fit, system, white_record

from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import impulse_response
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import era
from treadline.identification._era import HankelSvd, hankel
from treadline.identification._model_order import choose_order


def modal(poles: list[float], seed: int) -> LinearModel:
    """Return a system of two inputs and outputs with given poles and modes of equal size."""
    rng = np.random.default_rng(seed)
    n = len(poles)
    angles = rng.uniform(0.0, 2.0 * np.pi, (2, n))
    weight = np.sqrt(1.0 - np.square(poles))
    B = (weight * np.array([np.cos(angles[0]), np.sin(angles[0])])).T
    C = np.array([np.cos(angles[1]), np.sin(angles[1])])
    return system(np.diag(poles), B, C)


@pytest.mark.parametrize("seed", range(5))
def test_a_response_gives_back_its_system(seed: int) -> None:
    true = modal([0.9, 0.5, -0.4], seed)
    response = impulse_response(true, 15)
    A, B, C, D = era(response, 3)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A).real), [-0.4, 0.5, 0.9], atol=1e-9)
    np.testing.assert_allclose(impulse_response(system(A, B, C, D), 15), response, atol=1e-11)


def test_a_realisation_is_balanced() -> None:
    response = impulse_response(modal([0.8, 0.3], 1), 41)
    svd = HankelSvd(markov=response, rows=20, columns=20)
    A, B, C, _ = era(response, 2, rows=20)
    controllability = sum(np.linalg.matrix_power(A, k) @ B @ B.T @ np.linalg.matrix_power(A, k).T for k in range(60))
    observability = sum(np.linalg.matrix_power(A, k).T @ C.T @ C @ np.linalg.matrix_power(A, k) for k in range(60))
    # Both Gramians are diag(σ); the truncation after 20 samples of response leaves 0.8^40 = 1e-4.
    np.testing.assert_allclose(controllability, np.diag(svd.s[:2]), atol=1e-3)
    np.testing.assert_allclose(observability, np.diag(svd.s[:2]), atol=1e-3)


def test_very_small_singular_values_are_computed_from_the_matrix_itself() -> None:
    response = impulse_response(modal([0.9], 4), 21) + 1e-9 * impulse_response(modal([-0.3], 5), 21)
    svd = HankelSvd(markov=response, rows=10, columns=10)
    _, s, _ = svd.leading(2)
    assert 1e-12 < s[1] / s[0] < 1e-8  # the square of the ratio is below rounding
    np.testing.assert_allclose(s, np.linalg.svd(svd.matrix, compute_uv=False)[:2], rtol=1e-6)
    A, _, _, _ = era(response, 2, rows=10)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A).real), [-0.3, 0.9], atol=1e-5)


def test_the_matrix_free_decomposition_equals_the_dense_one() -> None:
    poles = [0.99, 0.97, 0.9, -0.95, 0.5, -0.6]
    response = impulse_response(modal(poles, 5), 402)
    noisy = response + 1e-3 * np.random.default_rng(1).standard_normal(response.shape)
    for markov, atol in ((response, 1e-12), (noisy, 1e-9)):
        svd = HankelSvd(markov=markov, rows=200, columns=200)
        s = np.linalg.svd(hankel(markov, 200, 200, 0), compute_uv=False)
        np.testing.assert_allclose(svd.s[:6] / s[0], s[:6] / s[0], atol=atol)
    found = np.sort(np.linalg.eigvals(era(response, 6, rows=200)[0]).real)
    np.testing.assert_allclose(found, np.sort(poles), atol=1e-8)


def test_an_order_above_the_rank_of_the_response_is_rejected() -> None:
    with pytest.raises(PoorExcitation, match="order 3 is above the rank 2"):
        era(impulse_response(modal([0.8, 0.3], 3), 13), 3)


@pytest.mark.parametrize(
    ("values", "order", "clear"),
    [
        ([10.0, 5.0, 0.1, 0.09, 0.08, 0.07], 2, True),
        ([10.0, 0.1, 0.09, 0.08], 1, True),
        ([10.0, 9.0, 8.0, 1.0, 0.9, 0.8, 0.7, 0.6], 3, True),
        ([10.0, 8.0, 6.0, 5.0, 4.0, 3.5], 1, False),
        # A gap among noise values is not the system's.
        ([10.0, 5.0, 0.1, 0.09, 0.08, 1e-9], 2, True),
    ],
)
def test_the_largest_gap_above_the_noise_is_the_order(values: list[float], order: int, *, clear: bool) -> None:
    choice = choose_order(np.array(values))
    assert choice.clear is clear
    if clear:
        assert choice.order == order
        assert choice.gap == pytest.approx(values[order - 1] / values[order])
    else:
        assert choice.gap < 4.0


def test_a_gap_under_the_noise_is_not_clear() -> None:
    values = np.array([10.0, 0.1, 0.09, 0.08])
    assert choose_order(values, noise=3.0).clear
    assert not choose_order(values, noise=4.0).clear


@pytest.mark.parametrize("poles", [[0.7], [0.9, 0.4], [0.9, 0.5, -0.5], [0.9, 0.6, 0.1, -0.6]], ids=len)
def test_records_show_the_order_of_the_system_that_made_them(poles: list[float]) -> None:
    report = fit(white_record(modal(poles, 4), 5, 2000, noise=0.01)).report
    assert (report.order, report.warnings) == (len(poles), [])
    assert np.sort([real for real, _ in report.poles]) == pytest.approx(sorted(poles), abs=0.05)


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_eq_12_has_rank_two_as_the_paper_says(draw: Draw, noise: float) -> None:
    report = fit(draw(11, noise=noise), method="okid-era", name_prior=False).report
    assert (report.order, report.warnings) == (2, [])
    # The gap is about signal over noise of 1000 samples: 1/(0.1 · a few tenths) at 10 %.
    assert report.gap > 2.0 / noise


@pytest.mark.parametrize("pole", [0.0, 0.9], ids=["white", "coloured"])
@pytest.mark.parametrize("seed", range(6))
def test_outputs_that_no_input_moves_have_no_clear_gap(pole: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, 1000, 2))
    record = InputOutputRecord(u=u, y=lfilter([1.0], [1.0, -pole], e, axis=0), dt_s=1.0)
    warnings = fit(record).report.warnings
    assert any("no clear gap" in warning for warning in warnings)


def test_without_a_clear_gap_pbsid_selects_the_order_by_bic() -> None:
    # Three lags in series, as heat through a wall: singular values 1 : 0.26 : 0.04 : 0.01 under 20 % noise.
    true = system([[0.9, 0.0, 0.0], [0.1, 0.8, 0.0], [0.0, 0.2, 0.7]], [[0.3], [0.0], [0.0]], [[0.0, 0.0, 1.0]])
    for seed in range(4):
        found = fit(white_record(true, seed, 1500, noise=0.2), method="pbsid")
        assert found.model.order == 3
        assert any("by BIC; the largest gap" in warning and "at order 2" in warning for warning in found.report.warnings)
