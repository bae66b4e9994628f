"""Modes from outputs alone: two lightly damped modes that white noise drives."""

import math

import numpy as np
import pytest
from jaxtyping import Float
from scipy.linalg import block_diag
from systems import oscillation

import treadline as tl
from treadline.core.errors import PoorExcitation, SettingsError

DT_S = 0.02
FREQUENCIES_HZ, DAMPINGS = np.array([2.1, 5.7]), np.array([0.02, 0.01])


def shaken(seed: int, noise: float, samples: int = 20_000) -> Float[np.ndarray, "T 2"]:
    """Return two outputs of the two modes under white noise, with noise of the sensors."""
    rng = np.random.default_rng(seed)
    pairs = zip(2.0 * math.pi * DT_S * FREQUENCIES_HZ, DAMPINGS, strict=True)
    A = block_diag(*(oscillation(math.exp(-zeta * omega), omega * math.sqrt(1.0 - zeta**2)) for omega, zeta in pairs))
    C, pushes = np.array([[1.0, 0.0, 1.0, 0.0], [1.0, 0.0, -1.0, 0.0]]), rng.standard_normal((samples, 4))
    x, y = np.zeros(4), np.empty((samples, 2))
    for k in range(samples):
        y[k], x = C @ x, A @ x + pushes[k]
    return y + noise * y.std(axis=0) * rng.standard_normal(y.shape)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_two_light_modes_are_found_with_frequency_and_damping(seed: int, noise: float) -> None:
    found = tl.identify(None, shaken(seed, noise), DT_S)
    assert found.model.order == 4
    np.testing.assert_allclose(found.frequency_hz, FREQUENCIES_HZ, rtol=0.01)
    # 400 s know the damping to standard deviations of 10 and 8 % at best: 1 / √(2π f ζ T).
    np.testing.assert_allclose(found.damping, DAMPINGS, rtol=0.3)
    assert repr(found).count("damping") == 2


def test_on_average_the_damping_is_right() -> None:
    dampings = [tl.identify(None, shaken(seed, 0.1), DT_S, order=4).damping / DAMPINGS for seed in range(10)]
    # The mean of ten runs has a standard deviation of 4 %.
    np.testing.assert_allclose(np.mean(dampings, axis=0), 1.0, atol=0.12)


def test_every_form_of_outputs_alone_gives_the_same_modes(tmp_path) -> None:
    y = shaken(0, 0.1, 2000)
    expected = tl.identify(None, y, DT_S, lags=20)
    np.savetxt(tmp_path / "log.csv", np.column_stack([DT_S * np.arange(2000), y]), header="t_s,a,b", delimiter=",", comments="")
    halves = tl.identify(None, [y[:1000], y[1000:]], DT_S, lags=20)
    assert (expected.samples, halves.samples) == (1980, 1960)
    for other in (
        tl.identify(None, y.T, DT_S, channels_first=True, lags=20),
        tl.identify(tmp_path / "log.csv", inputs=[], outputs=["a", "b"], lags=20),
    ):
        np.testing.assert_allclose(other.damping, expected.damping, rtol=1e-9)
    ahead = expected.model.predict(np.empty((2000, 0)), y)
    assert np.std(y[200:] - ahead[200:]) < 0.6 * np.std(y[200:])


def test_outputs_alone_take_order_and_lags_and_have_to_move() -> None:
    y = shaken(0, 0.1, 2000)
    with pytest.raises(SettingsError, match="stable is of models with inputs; outputs alone take order and lags"):
        tl.identify(None, y, DT_S, stable=True)
    with pytest.raises(PoorExcitation, match="output 'y2' is constant"):
        tl.identify(None, y * [1.0, 0.0], DT_S)
