"""Identification continues from the Gram matrix of earlier data, with or without forgetting."""

from dataclasses import replace

import numpy as np
import pytest
from systems import Draw, fit, system

from treadline.core.errors import SettingsError
from treadline.core.linear_systems import impulse_response, part, simulate
from treadline.core.models import InputOutputRecord
from treadline.identification import gram_of

METHODS = ("okid-era", "pbsid")


@pytest.mark.parametrize("method", METHODS)
def test_updating_a_gram_matrix_equals_both_experiments_at_once(draw: Draw, method: str) -> None:
    first, second = draw(0, noise=0.05, samples=500), draw(1, noise=0.05, samples=400)
    prior = fit(first, order=2, method=method).gram
    gone_on = fit(second, order=2, method=method, prior=prior)
    # All data in the units of the first experiment; common units would change the last digits.
    both = gram_of([first], prior.lags, prior.units) + gram_of([second], prior.lags, prior.units)
    np.testing.assert_array_equal(gone_on.gram.sums, both.sums)
    assert gone_on.gram.count == 900 - 2 * prior.lags
    at_once = fit([first, second], order=2, method=method, lags=gone_on.report.lags)
    # Other units and, with fewer lags, a few more windows at the start: a hundredth of the noise's effect.
    expected = impulse_response(at_once.model, 20)
    assert np.linalg.norm(impulse_response(gone_on.model, 20) - expected) < 1e-3 * np.linalg.norm(expected)


def test_a_record_cut_in_two_lacks_the_windows_across_the_seam(draw: Draw) -> None:
    record = draw(2, noise=0.05)
    whole = fit(record, order=2, lags=6, method="okid-era")
    prior = gram_of([part(record, 0, 500)], 6, whole.gram.units)
    gone_on = fit(part(record, 500, 1000), order=2, method="okid-era", prior=prior)
    # Six windows begin in the first half and end in the second; neither part contains them.
    assert whole.gram.count - gone_on.gram.count == 6
    seam = gram_of([part(record, 494, 506)], 6, whole.gram.units)
    np.testing.assert_allclose(gone_on.gram.sums + seam.sums, whole.gram.sums, atol=1e-9)


def test_gaps_in_later_data_do_not_cost_the_earlier_ones(draw: Draw) -> None:
    prior = fit(draw(0, noise=0.05, samples=500), order=2, method="pbsid").gram
    later = draw(1, noise=0.05, samples=400)
    later.y[100, 0] = np.nan
    found = fit(later, order=2, method="pbsid", prior=prior).gram
    assert found.count == prior.count + 400 - prior.lags - (prior.lags + 1)
    assert found.dropped == prior.dropped + prior.lags + 1


def test_forgetting_reduces_the_weight_with_every_new_sample(draw: Draw) -> None:
    prior = fit(draw(0, noise=0.05, samples=500), order=2, method="okid-era").gram
    later = draw(1, noise=0.05, samples=100)
    found = fit(later, order=2, method="okid-era", prior=prior, forgetting=0.99).gram
    expected = 0.99**100 * prior.sums + gram_of([later], prior.lags, prior.units).sums
    np.testing.assert_allclose(found.sums, expected, rtol=1e-12)
    assert found.count == pytest.approx(0.99**100 * prior.count + 100 - prior.lags)


def changed(seed: int, pole: float, samples: int) -> InputOutputRecord:
    """Return a record of a first-order lag with the given pole."""
    rng = np.random.default_rng(seed)
    plant = system([[pole]], [[1.0, 0.5]], [[1.0]])
    u = rng.standard_normal((samples, 2))
    return InputOutputRecord(u=u, y=simulate(plant, u, np.zeros(1)) + 0.01 * rng.standard_normal((samples, 1)), dt_s=1.0)


@pytest.mark.parametrize("method", METHODS)
def test_forgetting_follows_a_changing_plant(method: str) -> None:
    prior = fit(changed(0, 0.5, 1000), order=1, method=method).gram
    forgetful, faithful = prior, prior
    for seed in range(1, 7):
        record = changed(seed, 0.8, 100)
        following = fit(record, order=1, method=method, prior=forgetful, forgetting=0.98)
        holding = fit(record, order=1, method=method, prior=faithful)
        forgetful, faithful = following.gram, holding.gram
    # 0.98^600 = 5e-6 of the old weight remains; without forgetting a thousand samples at 0.5 outweigh six hundred at 0.8.
    assert float(following.model.A[0, 0]) == pytest.approx(0.8, abs=0.01)
    assert float(holding.model.A[0, 0]) < 0.75


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "best"}, "method 'best' needs all samples; with a prior give okid-era or pbsid"),
        ({"method": "deconvolution"}, "method 'deconvolution' needs all samples"),
        ({"forgetting": 0.0}, r"forgetting is 0\.0; it must be above 0 and at most 1"),
        ({"forgetting": 1.1}, r"forgetting is 1\.1; it must be above 0 and at most 1"),
        ({"lags": 99}, r"lags is 99; .*prior"),
    ],
)
def test_an_option_that_does_not_go_with_a_prior_is_rejected(draw: Draw, options: dict[str, str | float], message: str) -> None:
    prior = fit(draw(0, samples=300, noise=0.05), order=2, method="pbsid").gram
    with pytest.raises(SettingsError, match=message):
        fit(draw(1, samples=300, noise=0.05), prior=prior, **options)


def test_a_prior_of_other_channels_or_period_is_rejected(draw: Draw) -> None:
    record = draw(0, samples=300, noise=0.05)
    prior, difference = (fit(replace(record, u=u), method="pbsid").gram for u in (record.u, record.u[:, :1] * [-1.0, 1.0]))
    with pytest.raises(SettingsError, match=r"the prior has right_less_left, .*; the record has left_m_s, right_m_s, .*; identify"):
        fit(record, prior=difference)
    with pytest.raises(SettingsError, match=r"the prior's period is 1 s, the record's 0\.5 s"):
        fit(replace(record, dt_s=0.5), prior=prior)
