"""Model selection by cross-validation: order, step and offsets, with a warning if unclear."""

import numpy as np
import pytest
from systems import Draw, fit, markov_error, noise_record

from treadline.core.linear_systems import simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import identify
from treadline.identification._affine import Affine
from treadline.identification._fitting import Candidate, Fitting
from treadline.identification._gram import Units, gram_of
from treadline.identification._model_selection import free_run_squares


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_eq_12_has_two_states_in_nearly_every_record(draw: Draw, noise: float) -> None:
    orders = [fit(draw(seed, noise=noise)).report.order for seed in range(10)]
    # On held-out data a third state changes the error by less than half a percent; chance may keep it.
    assert orders.count(2) >= 8
    assert max(orders) <= 3


def test_progress_lines_are_the_candidates_of_the_report(draw: Draw) -> None:
    told: list[str] = []
    candidates = identify(draw(0, noise=0.1, samples=300), on_progress=told.append).report.candidates
    assert len(told) == len(candidates) > 3
    assert sum(candidate.chosen for candidate in candidates) == 1
    assert {candidate.method for candidate in candidates} >= {"pbsid"}


def test_two_experiments_give_a_smaller_error_than_one(draw: Draw, eq_12: LinearModel) -> None:
    alone, both = [], []
    for seed in range(5):
        first, second = draw(seed, samples=400, noise=0.05), draw(seed + 50, samples=400, noise=0.05, x0=np.array([9.0, -9.0]))
        alone.append(markov_error(fit(first, order=2).model, eq_12))
        both.append(markov_error(fit([first, second], order=2).model, eq_12))
    # Twice the data, 1/√2 of the error; means of five scatter by a tenth each.
    assert np.mean(both) == pytest.approx(np.mean(alone) / np.sqrt(2.0), rel=0.3)


def test_the_same_data_give_the_same_bytes(draw: Draw) -> None:
    first, second = (fit(draw(3, noise=0.1, samples=400)).model for _ in range(2))
    for name in ("A", "B", "C", "D", "observer_gain", "input_offset", "output_offset"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def judged(true: LinearModel, further: int, seed: int) -> float:
    """Return the error of Eq. (12) with additional uncontrollable states, on 40 samples with noise of variance 1."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((40, 2))
    record = InputOutputRecord(u=u, y=simulate(true, u, np.zeros(2)) + rng.standard_normal((40, 2)), dt_s=1.0)
    units = Units(shift=np.zeros(4), scale=np.ones(4), input_count=2)
    held = Fitting(data=gram_of([record], 4, units), records=[record], feedthrough=True)
    n = 2 + further
    A, B, C = np.diag(np.linspace(0.3, 0.98, n)), np.zeros((n, 3)), np.random.default_rng(1).standard_normal((2, n))
    A[:2, :2], B[:2, :2], C[:, :2] = true.A, true.B, true.C
    A[:2, 2:] = 0.0
    system = Affine(A=A, B=B, C=C, D=np.column_stack([true.D, np.zeros(2)]))
    candidate = Candidate(method="pbsid", lags=4, order=n)
    return float(np.sum(free_run_squares(system, held, candidate)[0]) / record.y.size)


def test_additional_initial_states_do_not_reduce_the_validation_error(eq_12: LinearModel) -> None:
    # Eight initial states absorb a tenth of eighty values; with the correction both models have the noise variance.
    alone, beside = ([judged(eq_12, further, seed) for seed in range(400)] for further in (0, 6))
    # 400 runs of 80 values determine a variance to 0.8 %; both use the same noise.
    assert np.mean(alone) == pytest.approx(1.0, abs=0.025)
    assert np.mean(beside) == pytest.approx(np.mean(alone), abs=0.015)


@pytest.mark.parametrize("seed", range(3))
def test_pure_noise_is_reported_as_unclear(seed: int) -> None:
    report = fit(noise_record(seed, 400)).report
    assert any("no clear gap" in warning for warning in report.warnings)
    # A model without explanatory power has the smallest order. Free runs do not help, so forecasts are the criterion.
    assert report.order == 1
    assert {candidate.step for candidate in report.candidates} <= {"subspace", "prediction-error"}


def rates(eq_12: LinearModel, bias: float) -> InputOutputRecord:
    """Return belt speeds and the resulting rate, with 5 % noise and a bias in standard deviations."""
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal((600, 2))
    y = simulate(eq_12, u, np.zeros(2))[:, 1:]
    y = y + y.std() * (bias + 0.05 * rng.standard_normal(y.shape))
    return InputOutputRecord(u=u, y=y, dt_s=1.0, input_names=("left_m_s", "right_m_s"), output_names=("yaw_rad_s",))


def test_rates_rest_at_zero(eq_12: LinearModel) -> None:
    model = fit(rates(eq_12, 0.0)).model
    # Zero up to the rounding of units.
    np.testing.assert_allclose([*model.input_offset, *model.output_offset], 0.0, atol=1e-12)


def test_rates_with_a_bias_keep_their_offsets(eq_12: LinearModel) -> None:
    record = rates(eq_12, 3.0)
    model = fit(record).model
    # The mean of 600 samples is known to a few hundredths of a standard deviation, minus the uncertainty from small inputs.
    at_zero = (
        model.output_offset - (model.C @ np.linalg.solve(np.eye(model.order) - model.A, model.B) + model.D) @ model.input_offset
    )
    assert float(at_zero[0]) == pytest.approx(3.0 * record.y.std(), rel=0.05)


def unstable(seed: int, noise: float = 0.1) -> InputOutputRecord:
    """Return a plant with poles 1.1 and 0.8 under output feedback, with process noise."""
    rng = np.random.default_rng(seed)
    A, B, C = np.array([[1.1, 0.1], [0.0, 0.8]]), np.array([[1.0], [0.5]]), np.array([[1.0, 0.0]])
    x, inputs, outputs = np.zeros(2), [], []
    for _ in range(800):
        outputs.append(C @ x + noise * rng.standard_normal(1))
        inputs.append(rng.standard_normal(1) - 0.6 * outputs[-1])
        x = A @ x + B @ inputs[-1] + noise * rng.standard_normal(2)
    return InputOutputRecord(u=np.array(inputs), y=np.array(outputs), dt_s=1.0)


def test_an_unstable_plant_in_closed_loop_is_selected_by_forecasts() -> None:
    found = fit(unstable(1))
    assert {candidate.step for candidate in found.report.candidates} == {"subspace", "prediction-error"}
    assert max(real for real, _ in found.report.poles) == pytest.approx(1.1, abs=0.02)
    assert any("unstable (spectral radius 1.1" in warning for warning in found.report.warnings)
    K, model = found.model.observer_gain, found.model
    assert K is not None
    assert np.abs(np.linalg.eigvals(model.A - K @ model.C)).max() < 1.0


def test_gaps_leave_a_model_with_a_stable_observer(draw: Draw, eq_12: LinearModel) -> None:
    record = draw(7, noise=0.05, samples=600)
    record.y[::7] = np.nan
    found = fit(record)
    assert found.report.order == 2
    assert markov_error(found.model, eq_12) < 0.02
    assert found.report.whiteness_p > 0.01
    K, model = found.model.observer_gain, found.model
    assert K is not None
    # Runs of six samples do not determine a gain; a free run forgets with the slower pole, 0.71.
    assert np.abs(np.linalg.eigvals(model.A - K @ model.C)).max() < 0.9


def test_missing_inputs_are_not_interpolated(draw: Draw, eq_12: LinearModel) -> None:
    record = draw(8, noise=0.05, samples=600)
    record.u[200:300, 0] = np.nan
    found = fit(record)
    assert found.report.order == 2
    # The complete 600 samples give 0.5 %; a sixth is missing.
    assert markov_error(found.model, eq_12) < 0.01
