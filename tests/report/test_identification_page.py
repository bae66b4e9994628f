"""Figures of one identification: responses, correlations and thinned curves against known truth, and the size of the page."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_text import PageText

from treadline.core import linear_systems as validate
from treadline.core import transfer_function as transfer
from treadline.core.arrays import decimated
from treadline.core.errors import TreadlineError
from treadline.report import _model_runs as runs
from treadline.report.identification_page import IdentificationPage

from .pages import A_CALM, ONE, TWO, found, identification_page, identified, model_with, record_of

SIZE_MOST = 1_500_000
"""Largest page [bytes]: an attachment of a mail."""


def of_channels(inputs: int, outputs: int) -> Any:
    model = model_with(A_CALM, [f"u{j}_m_s" for j in range(inputs)], [f"y{i}_rad" for i in range(outputs)])
    return identified(model, lambda: record_of(model, 1000, seed=2), bare=True)


@pytest.mark.parametrize(
    "make",
    [
        of_channels(3, 4),
        of_channels(6, 1),
        identified(None, lambda: record_of(model_with(A_CALM, *ONE), 30_000)),
        identified(None, lambda: record_of(model_with(A_CALM, *ONE), 10)),
        identified(model_with(np.diag([3.0, 0.5]), *ONE), lambda: record_of(model_with(np.diag([0.9, 0.5]), *ONE), 3000)),
    ],
    ids=["3 inputs, 4 outputs", "6 inputs", "long record", "ten samples", "a model that grows threefold"],
)
def test_the_page_of_any_model_and_record_is_whole_and_small(make: Any, tmp_path: Path) -> None:
    page = make(tmp_path)
    assert len(page.encode()) < SIZE_MOST
    assert "copy" in PageText(page).ids


def test_the_same_numbers_give_the_same_bytes(tmp_path: Path) -> None:
    assert identification_page(tmp_path) == identification_page(tmp_path)


def test_a_page_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    there = found()
    with pytest.raises(TreadlineError, match="cannot be written"):
        IdentificationPage(title="", model=there.model, said=there.report, records=there.fitted, judged=there.judged).write(
            tmp_path
        )


@pytest.mark.parametrize("A", [A_CALM, [[0.5, 1.0], [0.0, 0.5]]], ids=["diagonalisable", "defective"])
def test_responses_are_those_of_the_model(A: Any) -> None:
    model = model_with(np.array(A), *TWO)
    response = validate.impulse_response(model, transfer.response_steps(model))
    assert np.abs(response[-1]).max() < 0.05 * np.abs(response).max()
    omega = transfer.frequency_grid(model, 1000)
    assert omega[-1] == pytest.approx(math.pi)
    markov = validate.impulse_response(model, 400)
    np.testing.assert_allclose(response, markov[: len(response)], atol=1e-12)
    summed = np.einsum("wk,kpm->wpm", np.exp(-1j * np.outer(omega, np.arange(400))), markov)
    np.testing.assert_allclose(transfer.frequency_response(model, omega), summed, atol=1e-6)


@pytest.mark.parametrize("gap", [False, True])
def test_a_measured_response_follows_the_model_that_made_the_record(gap: bool) -> None:
    model = model_with(A_CALM, *TWO)
    record = record_of(model, 20_000)
    if gap:
        record.y[9_000:9_010] = np.nan
    estimate = runs.measured_response([record])
    assert estimate is not None
    omega, response = estimate
    true = transfer.frequency_response(model, omega)
    # Windows of 2500 samples resolve the resonance; with 15 of them and 1 % noise the median error is a few per cent.
    assert np.median(np.abs(response - true) / np.abs(true).max(axis=0)) < 0.03


def test_no_response_is_measured_where_inputs_explain_nothing_or_data_are_few() -> None:
    model = model_with(A_CALM, *TWO)
    record = record_of(model, 2000)
    noise = replace(record, y=np.random.default_rng(9).standard_normal(record.y.shape))
    estimate = runs.measured_response([noise])
    assert estimate is not None
    assert len(estimate[0]) < 0.2 * 125  # of 125 frequencies few pass by chance
    assert runs.measured_response([record_of(model, 100)]) is None


def test_a_delayed_copy_correlates_at_its_positive_lag() -> None:
    given = np.random.default_rng(0).standard_normal(500)
    late = np.concatenate([np.zeros(3), given[:-3]])
    r = runs.correlation(late, given, 10)
    assert int(np.argmax(r)) - 10 == 3
    assert r.max() > 0.95


def test_independent_white_series_stay_within_the_band_as_often_as_said() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 4000))
    band = runs.correlation_band(runs.correlation(a, a, 200), runs.correlation(b, b, 200), 4000)
    inside = np.abs(runs.correlation(a, b, 200)) <= band
    # 401 trials of 95 %: three deviations are 3.3 %.
    assert inside.mean() > 0.917


def test_thinning_keeps_peaks_and_gaps() -> None:
    values = np.zeros(100_000)
    values[54_321], values[60_000:70_000] = 7.0, np.nan
    t, thin = decimated(np.arange(100_000.0), values)
    assert len(thin) <= 600
    assert np.nanmax(thin) == 7.0
    assert np.isnan(thin).any()
    assert len(t) == len(thin)
