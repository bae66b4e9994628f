"""Validation measures on systems with analytical results."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from systems import Draw, fit, system

from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import (
    crosscorrelation_p,
    fit_percent,
    h_step_rmse,
    initial_state,
    predictions,
    prefix,
    simulate,
    whiteness_p,
)
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification.excitation_signal import Excitation, ExcitationConfig

GAIN = np.array([[0.6, 0.1], [0.2, 0.4]])


@pytest.fixture(scope="module")
def innovations(eq_12: LinearModel) -> LinearModel:
    """Return Eq. (12) with an innovation gain and offsets."""
    return replace(eq_12, input_offset=np.array([0.2, 0.2]), output_offset=np.array([0.3, 0.0]), observer_gain=GAIN)


def one_step_residuals(model: LinearModel, record: InputOutputRecord) -> Float[np.ndarray, "T p"]:
    return np.asarray(record.y - predictions(model, record))


def driven(model: LinearModel, samples: int, seed: int, size: float = 1.0) -> tuple[InputOutputRecord, Float[np.ndarray, "T p"]]:
    """Return a record of x⁺ = Ax + Bv + Ke, y = Cx + Dv + e, and its innovations e with standard deviation ``size``."""
    assert model.observer_gain is not None
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((samples, 2)), size * rng.standard_normal((samples, 2))
    x, outputs = np.zeros(model.order), []
    for k in range(samples):
        v = u[k] - model.input_offset
        outputs.append(model.C @ x + model.D @ v + e[k] + model.output_offset)
        x = model.A @ x + model.B @ v + model.observer_gain @ e[k]
    return InputOutputRecord(u=u, y=np.array(outputs), dt_s=model.dt_s), e


def test_the_initial_state_is_found_from_the_record(eq_12: LinearModel) -> None:
    u = np.random.default_rng(1).standard_normal((60, 2))
    x0 = np.array([3.0, -4.0])
    y = simulate(eq_12, u, x0)
    y[4] = np.nan
    found = initial_state(eq_12, InputOutputRecord(u=u, y=y, dt_s=1.0))
    np.testing.assert_allclose(found, x0, atol=1e-12)


def test_the_fit_is_100_for_the_truth_and_0_for_the_mean(eq_12: LinearModel, draw: Draw) -> None:
    record = draw(0)
    np.testing.assert_allclose(fit_percent(eq_12, record), [100.0, 100.0], atol=1e-9)
    np.testing.assert_allclose(h_step_rmse(eq_12, record, 20), [0.0, 0.0], atol=1e-12)
    scored = record.y[prefix(len(record), 1, 2) :]
    dead = system(np.zeros((1, 1)), np.zeros((1, 2)), np.zeros((2, 1)), output_offset=scored.mean(axis=0))
    np.testing.assert_allclose(fit_percent(dead, record), [0.0, 0.0], atol=1e-9)


def test_the_right_observer_leaves_the_innovations(innovations: LinearModel) -> None:
    record, e = driven(innovations, 1000, seed=2)
    residuals = one_step_residuals(innovations, record)
    # The effect of the unknown initial state decays with the observer's pole.
    slowest = float(np.abs(np.linalg.eigvals(innovations.A - GAIN @ innovations.C)).max())
    assert slowest < 0.75
    np.testing.assert_allclose(residuals[100:], e[100:], atol=1e-10)


@pytest.mark.parametrize("steps", [1, 2, 6, 21])
def test_forecast_errors_equal_the_accumulated_innovations(innovations: LinearModel, steps: int) -> None:
    record, _ = driven(innovations, 20_000, seed=3)
    variance = np.ones(2)
    reach = GAIN
    for _ in range(steps - 1):
        variance = variance + np.sum((innovations.C @ reach) ** 2, axis=1)
        reach = innovations.A @ reach
    # Errors over 20 000 samples, correlated over the forecast: half a percent each, three standard deviations.
    np.testing.assert_allclose(h_step_rmse(innovations, record, steps), np.sqrt(variance), rtol=0.02)


def test_a_forecast_longer_than_the_record_is_rejected(eq_12: LinearModel, draw: Draw) -> None:
    with pytest.raises(PoorExcitation, match="12 samples are too few to forecast 20 ahead"):
        h_step_rmse(eq_12, draw(5, samples=12), 20)


def test_a_gap_in_the_outputs_is_bridged_by_the_model(innovations: LinearModel) -> None:
    record, e = driven(innovations, 1000, seed=6)
    y = record.y.copy()
    y[500] = np.nan
    residuals = one_step_residuals(innovations, InputOutputRecord(u=record.u, y=y, dt_s=1.0))
    assert np.isnan(residuals[500]).all()
    # The effect of one missing correction has decayed after 100 samples at the observer's pole.
    np.testing.assert_allclose(residuals[600:], e[600:], atol=1e-10)


def with_inputs_missing(record: InputOutputRecord, rows: list[int]) -> InputOutputRecord:
    u = record.u.copy()
    u[rows, np.arange(len(rows)) % 2] = np.nan
    return InputOutputRecord(u=u, y=record.y, dt_s=record.dt_s)


def test_after_a_missing_input_the_state_is_estimated_anew(innovations: LinearModel) -> None:
    record, e = driven(innovations, 400, seed=6)
    residuals = one_step_residuals(innovations, with_inputs_missing(record, [150]))
    assert np.isnan(residuals[150]).all()
    behind = InputOutputRecord(u=record.u[151:], y=record.y[151:], dt_s=1.0)
    np.testing.assert_allclose(residuals[151:], one_step_residuals(innovations, behind), atol=1e-12)
    np.testing.assert_allclose(residuals[300:], e[300:], atol=1e-10)


def test_missing_inputs_cost_the_true_model_neither_fit_nor_whiteness(innovations: LinearModel) -> None:
    # The innovations are small, and each gap hides an input of normal size.
    values = []
    for seed in range(20):
        record, _ = driven(innovations, 2000, seed=seed, size=0.005)
        rows = sorted(np.random.default_rng(100 + seed).choice(2000, 100, replace=False).tolist())
        gapped = with_inputs_missing(record, rows)
        np.testing.assert_allclose(fit_percent(innovations, gapped), fit_percent(innovations, record), atol=1.5)
        values.append(whiteness_p(one_step_residuals(innovations, gapped)))
    # p is uniform: one of 20 below 5 %.
    assert sum(value < 0.05 for value in values) <= 4


def test_stretches_too_short_to_estimate_the_state_are_left_out(innovations: LinearModel) -> None:
    record, _ = driven(innovations, 300, seed=6)
    # Two outputs: 20 values are ten samples. If all stretches are shorter, the longest is taken.
    assert with_inputs_missing(record, [100, 110]).stretches(20) == [slice(0, 100), slice(111, 300)]
    assert with_inputs_missing(record, [100, 111]).stretches(20) == [slice(0, 100), slice(101, 111), slice(112, 300)]
    assert with_inputs_missing(record, [100, 111]).stretches(2000) == [slice(112, 300)]
    assert record.stretches(2000) == [slice(0, 300)]
    residuals = one_step_residuals(innovations, with_inputs_missing(record, [100, 110]))
    assert np.isnan(residuals[100:111]).all()
    assert np.isfinite(np.delete(residuals, slice(100, 111), axis=0)).all()


def test_white_residuals_pass_at_the_nominal_rate() -> None:
    values = [whiteness_p(np.random.default_rng(seed).standard_normal((1000, 2))) for seed in range(200)]
    # p is uniform: 10 of 200 below 5 %, with a standard deviation of 3.
    assert 1 <= sum(value < 0.05 for value in values) <= 19
    assert np.mean(values) == pytest.approx(0.5, abs=0.08)


def test_residuals_that_blow_up_are_tested_as_small_ones_are() -> None:
    rng = np.random.default_rng(3)
    e, u = rng.standard_normal((500, 2)), rng.standard_normal((500, 1))
    expected = whiteness_p(e), crosscorrelation_p(e, u)
    # Their squares overflow.
    assert (whiteness_p(1e200 * e), crosscorrelation_p(1e200 * e, u)) == pytest.approx(expected)
    e[300:] = np.inf
    assert whiteness_p(e) == pytest.approx(whiteness_p(e[:300]))
    assert np.isnan(whiteness_p(np.full((500, 2), np.inf)))


def test_correlated_residuals_fail_the_whiteness_test() -> None:
    for seed in range(20):
        e = np.random.default_rng(seed).standard_normal((1001, 2))
        assert whiteness_p(e[1:] + 0.3 * e[:-1]) < 1e-4


def test_the_observer_of_identification_predicts_as_well_as_the_true_one(innovations: LinearModel) -> None:
    record, e = driven(innovations, 5000, seed=7)
    found = fit(record, order=2, method="okid-era")
    assert found.model.observer_gain is not None
    excess = np.var(one_step_residuals(found.model, record), axis=0) / np.var(e, axis=0)
    # Two dozen coefficients from 5000 samples cost half a percent.
    np.testing.assert_array_less(excess, 1.02)


def test_excitation_moves_the_belts_independently_around_the_climb_speed() -> None:
    source = Excitation(ExcitationConfig(), np.random.default_rng(0))
    speeds = np.array([source.step(0.0) for _ in range(4000)])
    # Uniform within ±0.1: standard deviation 0.1/√3, mean to 0.0577/√4000 · 4, correlation to 4/√4000.
    np.testing.assert_allclose(speeds.mean(axis=0), 0.2, atol=0.004)
    np.testing.assert_allclose(speeds.std(axis=0), 0.1 / np.sqrt(3.0), rtol=0.04)
    assert abs(np.corrcoef(speeds.T)[0, 1]) < 0.07
    assert speeds.min() >= 0.1
    assert speeds.max() <= 0.3


@pytest.mark.parametrize("heading_rad", [-0.15, -0.03, 0.03, 0.15])
def test_excitation_steers_the_chair_back_to_zero_heading(heading_rad: float) -> None:
    free = Excitation(ExcitationConfig(), np.random.default_rng(1)).step(0.0)
    left, right = Excitation(ExcitationConfig(), np.random.default_rng(1)).step(heading_rad)
    # A positive heading needs a right turn, i.e. a faster left belt; the gain doubles beyond 5° (0.087).
    strength = 0.3 if abs(heading_rad) < 0.08 else 0.6
    assert (left - free[0]) - (right - free[1]) == pytest.approx(strength * heading_rad)
    assert left + right == pytest.approx(sum(free))
