"""Each step of identification, called on its own."""

from collections.abc import Callable

import numpy as np
import pytest
from systems import Draw, fit

from treadline.core.errors import NotFinite, RecordError, SettingsError, ShapeMismatch, TreadlineError
from treadline.core.linear_systems import impulse_response
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import era, okid, pbsid, system_markov


def test_okid_and_era_give_eq_12_back(draw: Draw, eq_12: LinearModel) -> None:
    observer = okid([draw(0, samples=400), draw(1, samples=300)], lags=4)
    response = system_markov(observer, 13)
    np.testing.assert_allclose(response, impulse_response(eq_12, 13), atol=1e-10)
    A, *_ = era(response, 2)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A)), np.sort(np.linalg.eigvals(eq_12.A)), atol=1e-9)


def test_pbsid_gives_eq_12_back_with_its_channels(draw: Draw, eq_12: LinearModel) -> None:
    model = pbsid(draw(2), order=2, lags=3)
    np.testing.assert_allclose(impulse_response(model, 20), impulse_response(eq_12, 20), atol=1e-9)
    assert model.input_names == ("left_m_s", "right_m_s")


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (lambda record: fit(record, order=2.5), r"order is 2\.5; it must be an integer, at least 1"),
        (lambda _: era(np.ones((9, 1, 1)), 0), "order is 0; it must be an integer, at least 1"),
    ],
)
@pytest.mark.usefixtures("without_shape_checks")
def test_an_invalid_count_is_rejected(draw: Draw, step: Callable[[InputOutputRecord], object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        step(draw(5))


@pytest.mark.parametrize(
    ("markov", "error", "message"),
    [
        (np.ones((9, 2)), ShapeMismatch, r"markov is of shape \(9, 2\); wanted \(steps, outputs, inputs\)"),
        (np.full((9, 1, 1), np.nan), NotFinite, "markov holds NaN"),
        (np.ones((2, 1, 1)), ShapeMismatch, "markov has 2 steps; 1 block rows need at least 3"),
        ("impulse", RecordError, "markov is 'impulse', of type str; wanted"),
    ],
)
@pytest.mark.usefixtures("without_shape_checks")
def test_an_invalid_impulse_response_is_rejected(markov: object, error: type[TreadlineError], message: str) -> None:
    with pytest.raises(error, match=message):
        era(markov, 1)
