"""Identification recovers Eq. (12) from records simulated with it."""

from dataclasses import replace

import numpy as np
import pytest
from systems import STEPS, Draw, fit, markov_error

from treadline.core.linear_systems import impulse_response
from treadline.core.models import InputOutputRecord, LinearModel


def test_records_without_noise_give_eq_12_to_rounding(draw: Draw, eq_12: LinearModel) -> None:
    found = fit(draw(0), name_prior=False)  # Eq. (12) turns the same way with both belts
    # 2e-15 was measured; 1e-12 allows for another BLAS.
    assert markov_error(found.model, eq_12) < 1e-12
    assert (found.report.order, found.report.feedthrough, found.report.warnings) == (2, True, [])


@pytest.mark.parametrize(("noise", "bound"), [(0.01, 7.8e-4), (0.1, 7.8e-3)])
@pytest.mark.parametrize(("method", "times"), [("okid-era", 1.3), ("pbsid", 1.3)])
def test_the_error_under_noise_is_near_the_cramer_rao_bound(
    draw: Draw, eq_12: LinearModel, noise: float, bound: float, method: str, times: float
) -> None:
    errors = [markov_error(fit(draw(seed, noise=noise), order=2, method=method).model, eq_12) for seed in range(10)]
    # Cramér–Rao bound with a free initial state; the mean of ten such errors scatters by 8 %.
    assert np.mean(errors) < times * bound


def test_a_chair_that_already_moves_is_identified_as_well(draw: Draw, eq_12: LinearModel) -> None:
    assert markov_error(fit(draw(1, x0=np.array([50.0, -30.0]))).model, eq_12) < 1e-12


def test_offsets_of_inputs_and_outputs_do_not_change_the_dynamics(draw: Draw, eq_12: LinearModel) -> None:
    still = draw(2)
    shifted = InputOutputRecord(u=still.u + np.array([0.2, 0.2]), y=still.y + np.array([1.0, -0.5]), dt_s=still.dt_s)
    found = fit(shifted)
    # The squares of the offsets are added to those of the signals in the normal equations, which costs a few digits.
    assert markov_error(found.model, eq_12) < 1e-10
    # At the operating point the state is constant: y - y₀ = G (u - u₀) with the static gain G.
    gain = eq_12.C @ np.linalg.solve(np.eye(2) - eq_12.A, eq_12.B) + eq_12.D
    at_rest = np.array([1.0, -0.5]) + gain @ (found.model.input_offset - 0.2)
    np.testing.assert_allclose(found.model.output_offset, at_rest, atol=1e-9)


def test_experiments_are_treated_as_separate(draw: Draw, eq_12: LinearModel) -> None:
    first, second = draw(3, samples=500), draw(4, samples=400, x0=np.array([20.0, 20.0]))
    glued = replace(first, u=np.vstack([first.u, second.u]), y=np.vstack([first.y, second.y]))
    assert markov_error(fit([first, second], order=2).model, eq_12) < 1e-12
    # A single row across the seam would spoil the fit: no input explains the jump of the state.
    assert markov_error(fit(glued, order=2).model, eq_12) > 0.1


def test_rows_with_a_gap_are_left_out_and_counted(draw: Draw, eq_12: LinearModel) -> None:
    whole = draw(5)
    whole.y[100, 0] = whole.u[500, 1] = np.nan
    found = fit(whole, order=2, lags=3)
    assert markov_error(found.model, eq_12) < 1e-12
    # With three lags a gap affects four windows: its own and three later ones.
    assert found.report.dropped == 2 * 4
    assert found.report.samples == len(whole) - 3 - 2 * 4
    assert any("8 windows" in warning for warning in found.report.warnings)


@pytest.mark.parametrize("share", [0.05, 0.15, 0.19])
def test_scattered_gaps_cost_only_windows_of_the_selected_lags(draw: Draw, eq_12: LinearModel, share: float) -> None:
    whole, rng = draw(12, noise=0.05), np.random.default_rng(13)
    whole.y[rng.choice(1000, round(share * 1000), replace=False)] = np.nan
    found = fit(whole, method="okid-era")
    # A window of p lags is complete with probability (1 - share)^(p + 1): 12 lags would leave 6 % of them.
    kept = (1.0 - share) ** (found.report.lags + 1)
    assert found.report.samples / 1000 == pytest.approx(kept, rel=0.1)
    assert kept > 0.4
    # The complete record gives 0.53 %; with half of its windows noise costs 1.4 times as much, and 0.81 % was measured.
    assert markov_error(found.model, eq_12) < 0.012


def test_identification_does_not_modify_its_inputs(draw: Draw) -> None:
    record = draw(6, noise=0.1)
    record.y[7, 0] = np.nan
    u, y = record.u.copy(), record.y.copy()
    fit(record, order=2, validation=0.3)
    np.testing.assert_array_equal(record.u, u)
    np.testing.assert_array_equal(record.y, y)


def test_units_do_not_change_what_is_found(draw: Draw, eq_12: LinearModel) -> None:
    record = draw(7)
    scale_u, scale_y = np.array([1e3, 1e-2]), np.array([1e-4, 1e2])
    other = InputOutputRecord(u=record.u * scale_u, y=record.y * scale_y, dt_s=record.dt_s)
    model = fit(other).model
    response = impulse_response(model, STEPS) * scale_u / scale_y[:, None]
    expected = impulse_response(eq_12, STEPS)
    assert np.linalg.norm(response - expected) < 1e-12 * np.linalg.norm(expected)


def test_validation_figures_use_only_data_that_were_not_fitted(draw: Draw) -> None:
    record = draw(8, noise=0.1)
    found = fit(record, order=2, validation=0.3)
    # 700 samples are fitted; the first ones have an incomplete past.
    assert found.report.samples == 700 - found.gram.lags
    # Independent noise of 10 % leaves 1 % of the variance; the model error adds little.
    assert min(found.report.one_step_vaf_percent.values()) == pytest.approx(99.0, abs=0.3)
    assert min(found.report.fit_percent.values()) == pytest.approx(90.0, abs=2.0)
