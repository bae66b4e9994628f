"""Identification recovers Eq. (12) from records simulated with it."""

from collections.abc import Callable

import numpy as np
import pytest

from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, identify
from treadline.identification.validate import impulse_response

Draw = Callable[..., InputOutputRecord]
STEPS = 20
"""Number of Markov parameters compared; the slower pole, 0.71, has decayed to a thousandth by then."""


def markov_error(model: LinearModel, true: LinearModel) -> float:
    """Return ‖Y - Ŷ‖/‖Y‖ over the Markov parameters, independent of the choice of states."""
    expected = impulse_response(true, STEPS)
    return float(np.linalg.norm(impulse_response(model, STEPS) - expected) / np.linalg.norm(expected))


def test_records_without_noise_give_eq_12_to_rounding(draw: Draw, eq_12: LinearModel) -> None:
    found = identify(draw(0))
    # 2e-15 was measured; 1e-12 allows for another BLAS.
    assert markov_error(found.model, eq_12) < 1e-12
    assert (found.report.order, found.report.feedthrough, found.report.warnings) == (2, True, [])


@pytest.mark.parametrize(("noise", "bound"), [(0.01, 7.8e-4), (0.1, 7.8e-3)])
@pytest.mark.parametrize(("method", "times"), [("okid-era", 1.3), ("pbsid", 1.3)])
def test_the_error_under_noise_is_near_the_cramer_rao_bound(
    draw: Draw, eq_12: LinearModel, noise: float, bound: float, method: str, times: float
) -> None:
    errors = [
        markov_error(identify(draw(seed, noise=noise), IdentificationOptions(order=2, method=method)).model, eq_12)
        for seed in range(10)
    ]
    # Cramér–Rao bound with a free initial state; the mean of ten such errors scatters by 8 %.
    assert np.mean(errors) < times * bound


def test_a_chair_that_already_moves_is_identified_as_well(draw: Draw, eq_12: LinearModel) -> None:
    found = identify(draw(1, x0=np.array([50.0, -30.0])))
    assert markov_error(found.model, eq_12) < 1e-12


def test_offsets_of_inputs_and_outputs_do_not_change_the_dynamics(draw: Draw, eq_12: LinearModel) -> None:
    still = draw(2)
    shifted = InputOutputRecord(u=still.u + np.array([0.2, 0.2]), y=still.y + np.array([1.0, -0.5]), dt_s=still.dt_s)
    found = identify(shifted)
    # The squares of the offsets are added to those of the signals in the normal equations, which costs a few digits.
    assert markov_error(found.model, eq_12) < 1e-10
    # At the operating point the state is constant: y - y₀ = G (u - u₀) with the static gain G.
    gain = eq_12.C @ np.linalg.solve(np.eye(2) - eq_12.A, eq_12.B) + eq_12.D
    at_rest = np.array([1.0, -0.5]) + gain @ (found.model.input_offset - 0.2)
    np.testing.assert_allclose(found.model.output_offset, at_rest, atol=1e-9)


def test_experiments_are_treated_as_separate(draw: Draw, eq_12: LinearModel) -> None:
    first, second = draw(3, samples=500), draw(4, samples=400, x0=np.array([20.0, 20.0]))
    glued = InputOutputRecord(u=np.vstack([first.u, second.u]), y=np.vstack([first.y, second.y]), dt_s=first.dt_s)
    assert markov_error(identify([first, second], IdentificationOptions(order=2)).model, eq_12) < 1e-12
    # A single row across the seam would spoil the fit: no input explains the jump of the state.
    assert markov_error(identify(glued, IdentificationOptions(order=2)).model, eq_12) > 0.1


def test_rows_with_a_gap_are_left_out_and_counted(draw: Draw, eq_12: LinearModel) -> None:
    whole = draw(5)
    u, y = whole.u.copy(), whole.y.copy()
    y[100, 0] = u[500, 1] = np.nan
    found = identify(InputOutputRecord(u=u, y=y, dt_s=whole.dt_s), IdentificationOptions(order=2, lags=3))
    assert markov_error(found.model, eq_12) < 1e-12
    # With three lags a gap affects four windows: its own and three later ones.
    assert found.report.dropped == 2 * 4
    assert found.report.samples == len(whole) - 3 - 2 * 4
    assert any("8 windows" in warning for warning in found.report.warnings)


@pytest.mark.parametrize("share", [0.05, 0.15, 0.19])
def test_scattered_gaps_cost_only_windows_of_the_selected_lags(draw: Draw, eq_12: LinearModel, share: float) -> None:
    whole, rng = draw(12, noise=0.05), np.random.default_rng(13)
    y = whole.y.copy()
    y[rng.choice(len(y), round(share * len(y)), replace=False)] = np.nan
    found = identify(InputOutputRecord(u=whole.u, y=y, dt_s=whole.dt_s), IdentificationOptions(method="okid-era"))
    # A window of p lags is complete with probability (1 - share)^(p + 1): 12 lags would leave 6 % of them.
    kept = (1.0 - share) ** (found.report.lags + 1)
    assert found.report.samples / len(y) == pytest.approx(kept, rel=0.1)
    assert kept > 0.4
    # The complete record gives 0.53 %; with half of its windows noise costs 1.4 times as much, and 0.81 % was measured.
    assert markov_error(found.model, eq_12) < 0.012


def test_identification_does_not_modify_its_inputs(draw: Draw) -> None:
    record = draw(6, noise=0.1)
    u, y = record.u.copy(), record.y.copy()
    y[7, 0] = np.nan
    given = InputOutputRecord(u=u.copy(), y=y.copy(), dt_s=record.dt_s)
    identify(given, IdentificationOptions(order=2, validation=0.3))
    np.testing.assert_array_equal(given.u, u)
    np.testing.assert_array_equal(given.y, y)


def test_units_do_not_change_what_is_found(draw: Draw, eq_12: LinearModel) -> None:
    record = draw(7)
    scale_u, scale_y = np.array([1e3, 1e-2]), np.array([1e-4, 1e2])
    other = InputOutputRecord(u=record.u * scale_u, y=record.y * scale_y, dt_s=record.dt_s)
    model = identify(other).model
    response = impulse_response(model, STEPS) * scale_u / scale_y[:, None]
    expected = impulse_response(eq_12, STEPS)
    assert np.linalg.norm(response - expected) < 1e-12 * np.linalg.norm(expected)


def test_validation_figures_use_only_data_that_were_not_fitted(draw: Draw) -> None:
    record = draw(8, noise=0.1)
    found = identify(record, IdentificationOptions(order=2, validation=0.3))
    # 700 samples are fitted; the first ones have an incomplete past.
    assert found.report.samples == 700 - found.gram.lags
    # Independent noise of 10 % leaves 1 % of the variance; the model error adds little.
    assert min(found.report.one_step_vaf_percent.values()) == pytest.approx(99.0, abs=0.3)
    assert min(found.report.fit_percent.values()) == pytest.approx(90.0, abs=2.0)


def test_the_model_carries_provenance_and_channel_names(draw: Draw) -> None:
    found = identify(draw(9, noise=0.01), IdentificationOptions(order=2))
    assert found.model.input_names == ("left_m_s", "right_m_s")
    assert found.model.output_names == ("heading", "yaw_rate")
    assert found.model.dt_s == 1.0
    assert found.model.provenance["order"] == 2
    assert found.model.observer_gain is not None
    closed = np.linalg.eigvals(found.model.A - found.model.observer_gain @ found.model.C)
    assert np.abs(closed).max() < 1.0
