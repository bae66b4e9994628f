"""Each step of identification, called by itself as a user would."""

from collections.abc import Callable

import numpy as np
import pytest

from treadline.errors import PoorExcitation
from treadline.identification import era, okid, pbsid, system_markov
from treadline.identification.validate import impulse_response
from treadline.models import InputOutputRecord, LinearModel

Draw = Callable[..., InputOutputRecord]


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


def test_what_the_data_do_not_carry_is_refused(draw: Draw) -> None:
    with pytest.raises(PoorExcitation, match="order 3 is above the rank 2"):
        pbsid(draw(3), order=3, lags=3)
    with pytest.raises(PoorExcitation, match="too few"):
        okid(draw(4, samples=30), lags=20)
