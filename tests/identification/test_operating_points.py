"""A second operating point is named where the static gain differs, and only there."""

import re
from collections.abc import Callable

import numpy as np
import pytest

import treadline as tl

FIRST, SECOND = 0.5, 2.0
"""Means of the input in the halves of a record."""


def motor(gain: Callable[[np.ndarray], np.ndarray], means: tuple[float, float], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return 1200 samples of a lag behind a static gain, with 1 % noise, about one mean and then about another."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.standard_normal(300), 4)
    u = np.repeat(means, 600) + 0.15 * held
    y, driven = np.zeros(1200), gain(u)
    y[0] = driven[0]
    for k in range(1199):
        y[k + 1] = 0.8 * y[k] + 0.2 * driven[k]
    return u[:, None], (y + 0.01 * y.std() * rng.standard_normal(1200))[:, None]


def named(u: np.ndarray, y: np.ndarray, validation: float | None) -> list[str]:
    found = tl.identify(u, y, 0.05, inputs=["volt"], outputs=["speed"], validation=validation)
    return [line for line in found.report.warnings if line.startswith("second operating point")]


@pytest.mark.parametrize("validation", [None, 0.5])
@pytest.mark.parametrize("gain", [np.square, np.sqrt, np.tanh])
def test_a_plant_with_another_gain_about_another_mean_is_named(gain: Callable[..., np.ndarray], validation: float | None) -> None:
    (line,) = named(*motor(gain, (FIRST, SECOND), 0), validation)
    parts = ("first half", "second half") if validation is None else ("fitted data", "validation data")
    # The means of 150 random levels are known to 0.15 / √150.
    assert re.search(
        rf"'volt' is about 0\.(4[7-9]|5[0-3]?)\d* in the {parts[0]} and (1\.9[7-9]|2\.?0?[0-3]?)\d* in the {parts[1]};", line
    )
    assert f"the model holds about {'neither' if validation is None else 'the first alone'}: fit each by itself" in line


@pytest.mark.parametrize("validation", [None, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_linear_plant_and_one_mean_have_no_second_operating_point(seed: int, validation: float | None) -> None:
    assert named(*motor(lambda u: 3.0 * u, (FIRST, SECOND), seed), validation) == []
    assert named(*motor(np.square, (SECOND, SECOND), seed), validation) == []
