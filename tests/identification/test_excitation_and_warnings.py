"""Order of excitation, residual tests, and warnings with their numbers."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from systems import Draw, fit, system, white_record

from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import crosscorrelation_p, simulate, whiteness_p
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import gram_of
from treadline.identification._checks import excitation_order
from treadline.identification._gram import units_of

LAGS = 12


def excited(u: Float[np.ndarray, "T m"], *, samples: float = 0.0) -> int:
    """Return the order that the inputs excite, up to twelve lags."""
    y = np.random.default_rng(99).standard_normal((len(u), 1))
    record = InputOutputRecord(u=u, y=y, dt_s=1.0)
    return excitation_order(gram_of([record], LAGS, units_of([record])), samples=samples)


@pytest.mark.parametrize("inputs", [1, 2, 3])
def test_white_inputs_excite_every_order_up_to_the_lags(inputs: int) -> None:
    assert excited(np.random.default_rng(0).standard_normal((600, inputs))) == LAGS + 1


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_sinusoids_excite_two_orders_each(count: int) -> None:
    t = np.arange(2000.0)
    u = sum(np.sin(omega * t + omega) for omega in np.linspace(0.5, 2.7, count))
    # A constant would add one order, but the mean belongs to the operating point.
    assert excited(5.0 + np.asarray(u)[:, None]) == 2 * count


def test_the_least_exciting_input_limits_the_order_of_excitation() -> None:
    t = np.arange(2000.0)
    assert excited(np.column_stack([np.random.default_rng(0).standard_normal(2000), np.sin(t)])) == 2
    assert excited(t[:600, None]) == 1  # a ramp
    assert excited(np.where(t < 300, 0.0, 1.0)[:600, None], samples=4.0) == 1  # a step
    assert excited(np.random.default_rng(0).standard_normal((600, 1)), samples=4.0) == LAGS + 1


def test_an_order_above_the_excited_one_is_rejected_with_both_numbers() -> None:
    t = np.arange(600.0)
    u = np.column_stack([np.sin(0.3 * t), np.sin(0.7 * t + 1.0)])
    rng = np.random.default_rng(1)
    y = np.array([[0.0, 0.0], *(u[:-1] @ np.array([[1.0, 0.5], [0.2, 1.0]]))]) + 0.01 * rng.standard_normal((600, 2))
    with pytest.raises(PoorExcitation, match=r"the inputs excite order 2 persistently, not 4; .*ask for order 2 or less"):
        fit(InputOutputRecord(u=u, y=y, dt_s=1.0), order=4, method="pbsid")


def test_the_report_counts_the_excited_order(draw: Draw) -> None:
    found = fit(draw(0, noise=0.05), order=2, method="okid-era")
    assert found.report.excitation_order == found.gram.lags + 1


def response_residuals(seed: int, leak: float) -> tuple[Float[np.ndarray, "T p"], Float[np.ndarray, "T m"]]:
    """Return white residuals with a share of the inputs of three samples ago, and those inputs."""
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, 1000, 2))
    e[3:] += leak * u[:-3]
    return e, u


def test_residuals_independent_of_the_inputs_pass_at_the_nominal_rate() -> None:
    values = [crosscorrelation_p(*response_residuals(seed, 0.0)) for seed in range(150)]
    # p is uniform: mean 0.5 ± 0.024, and 7.5 ± 2.7 of 150 below 5 %. Three standard deviations.
    assert np.mean(values) == pytest.approx(0.5, abs=0.07)
    assert sum(value < 0.05 for value in values) <= 15


def test_residuals_that_depend_on_inputs_fail() -> None:
    assert max(crosscorrelation_p(*response_residuals(seed, 0.2)) for seed in range(20)) < 1e-3


def test_gaps_do_not_make_white_residuals_coloured() -> None:
    values = []
    for seed in range(60):
        e, u = response_residuals(seed, 0.0)
        e[np.random.default_rng(seed + 1000).integers(0, 1000, 100)] = np.nan
        values += [whiteness_p(e), crosscorrelation_p(e, u)]
    assert np.mean(values) == pytest.approx(0.5, abs=0.1)


def test_the_right_model_passes_both_tests_on_data_it_has_not_seen(draw: Draw) -> None:
    # Fitted to nine times as much data, because the model's own error would shift the p-values by a twentieth.
    records = [draw(seed, noise=0.1, samples=2000) for seed in range(16)]
    reports = [fit(record, order=2, method="okid-era", lags=8, validation=0.1).report for record in records]
    for values in ([report.whiteness_p for report in reports], [report.crosscorrelation_p for report in reports]):
        # Uniform: mean 0.5 ± 0.07, and 0.2 of 16 below 1 %.
        assert 0.3 < np.mean(values) < 0.7
        assert sum(value < 0.01 for value in values) <= 2


def test_a_wrong_model_is_reported_with_both_p_values(draw: Draw) -> None:
    wrong = fit(draw(0, noise=0.1), order=1, method="okid-era").report
    assert max(wrong.crosscorrelation_p, wrong.whiteness_p) < 1e-6
    assert any("not white (p < 0.001)" in warning for warning in wrong.warnings)
    assert any("still depend on the inputs (p < 0.001)" in warning for warning in wrong.warnings)


def test_an_unstable_model_is_reported_with_its_radius() -> None:
    report = fit(white_record(system([[1.02]], [[1.0]], [[1.0]]), 2, 300)).report
    assert any("the model is unstable (spectral radius 1.0200)" in warning for warning in report.warnings)


def test_a_validation_part_with_little_motion_is_reported_with_its_ratio(draw: Draw, eq_12: LinearModel) -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal((1000, 2)) * np.where(np.arange(1000) < 700, 1.0, 0.1)[:, None]
    y = simulate(eq_12, u, np.zeros(2))
    record = replace(draw(0), u=u, y=y + 0.005 * rng.standard_normal(y.shape))
    warnings = fit(record, order=2, method="okid-era", validation=0.3).report.warnings
    assert any("'heading' moves 0.1" in warning and "in the validation part" in warning for warning in warnings)


def test_nearly_collinear_inputs_are_reported_with_their_independent_variance(draw: Draw, eq_12: LinearModel) -> None:
    rng = np.random.default_rng(4)
    common = rng.standard_normal((800, 1))
    u = np.hstack([common, common]) + 0.2 * rng.standard_normal((800, 2))
    y = simulate(eq_12, u, np.zeros(2))
    record = replace(draw(0), u=u, y=y + 0.01 * y.std(axis=0) * rng.standard_normal(y.shape))
    warnings = fit(record, order=2, method="okid-era").report.warnings
    # Variances 1 + 0.04, covariance 1: the difference has a variance of 0.04/1.04, within a tenth.
    (said,) = [warning for warning in warnings if "move nearly together" in warning]
    assert re.search("has [345] % of one input's variance", said)


def test_a_good_record_gives_no_warning(draw: Draw) -> None:
    assert fit(draw(5, noise=0.05), order=2, validation=0.3, name_prior=False).report.warnings == []


@pytest.mark.parametrize(
    ("samples", "noise", "options"),
    [
        (400, 0.05, {}),
        (400, 0.0, {}),
        (400, 0.05, {"order": 2, "method": "okid-era"}),
        (110, 0.05, {"validation": 0.2}),
        (200, 0.05, {"delays": [1, 0], "method": "pbsid"}),
    ],
    ids=["best", "exact", "order", "short", "delays"],
)
def test_a_report_is_json_without_nan_or_infinity(
    draw: Draw, samples: int, noise: float, options: dict[str, str | float | list[int]]
) -> None:
    report = fit(draw(6, noise=noise, samples=samples), **options).report
    again = json.loads(json.dumps(report.as_json(), allow_nan=False))
    assert (again["order"], again["fit_percent"]) == (report.order, report.fit_percent)
