"""Eq. (9c) as printed: when it works, and why OKID replaces it."""

import numpy as np
import pytest
from systems import fit, markov_error, system

from treadline.core.errors import PoorExcitation, SettingsError
from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel

SAMPLES = 50


def one_input(eq_12: LinearModel) -> LinearModel:
    """Return Eq. (12) with only the left belt as input."""
    return system(eq_12.A, eq_12.B[:, :1], eq_12.C, eq_12.D[:, :1])


def knock(model: LinearModel) -> InputOutputRecord:
    """Return a record with a first input much larger than the rest."""
    u = 0.05 * np.random.default_rng(0).standard_normal((SAMPLES, 1))
    u[0] = 1.0
    return InputOutputRecord(u=u, y=simulate(model, u, np.zeros(2)), dt_s=model.dt_s)


def test_identify_recovers_the_system_from_an_impulse_like_input(eq_12: LinearModel) -> None:
    model = one_input(eq_12)
    found = fit(knock(model), method="deconvolution")
    assert (found.report.order, found.report.method) == (2, "deconvolution")
    assert found.intervals is found.report.pole_ci95 is None
    np.testing.assert_allclose(impulse_response(found.model, 20), impulse_response(model, 20), atol=1e-12)


def test_random_inputs_are_refused_with_the_condition(eq_12: LinearModel) -> None:
    model = one_input(eq_12)
    u = np.random.default_rng(1).standard_normal((SAMPLES, 1))
    record = InputOutputRecord(u=u, y=simulate(model, u, np.zeros(2)), dt_s=model.dt_s)
    with pytest.raises(PoorExcitation, match=r"condition \d\.\de\+\d+ at 50 samples; use method okid-era"):
        fit(record, method="deconvolution")


def test_two_inputs_give_half_the_rank_that_is_needed(eq_12: LinearModel) -> None:
    u = np.random.default_rng(0).standard_normal((SAMPLES, 2))
    record = InputOutputRecord(u=u, y=simulate(eq_12, u, np.zeros(2)), dt_s=1.0)
    with pytest.raises(PoorExcitation, match="asks for 100 Markov rows of a matrix of rank 50"):
        fit(record, method="deconvolution")


def test_deconvolution_rejects_two_experiments(eq_12: LinearModel) -> None:
    record = knock(one_input(eq_12))
    with pytest.raises(SettingsError, match="takes one experiment, not 2"):
        fit([record, record], method="deconvolution")


def test_a_moving_chair_invalidates_the_deconvolution_but_not_okid(eq_12: LinearModel) -> None:
    model = one_input(eq_12)
    rng = np.random.default_rng(2)
    u = 0.05 * rng.standard_normal((400, 1))
    u[0] = 1.0
    record = InputOutputRecord(u=u, y=simulate(model, u, np.array([1.0, -1.0])), dt_s=1.0)
    assert markov_error(fit(record, method="okid-era", order=2).model, model) < 1e-10
    # The free response is mistaken for a response to the input.
    assert markov_error(fit(record, method="deconvolution", order=2).model, model) > 0.1
