"""Intervals with a nominal coverage of 95 % contain the true value in 95 % of the runs.

Runs are independent: with n expected hits at 95 % the share scatters by √(0.95·0.05/n), 2.2 % at 100. Poles of one run, and the
gain at several frequencies, are correlated, so their share scatters somewhat more. Bounds are two of these and more; the benchmark
``accuracy`` counts many more runs.
"""

from functools import cache

import numpy as np
import pytest
from jaxtyping import Complex, Float
from scipy.linalg import block_diag
from systems import Draw, fit, oscillation, system

from treadline.core import paper
from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import Identified
from treadline.identification._affine import Affine, to_model
from treadline.identification._gram import units_of
from treadline.identification._intervals import ConfidenceIntervals, of_refined
from treadline.identification._refine import experiments_of, refined

FREE = np.zeros((2, 3), dtype=bool)
OMEGA = np.array([0.05, 0.3, 1.0, 2.5])
"""Frequencies [rad per sample] for the comparison of the gain."""
STEPS = 6


@pytest.fixture(scope="module")
def spring() -> LinearModel:
    """Complex pair at 0.9 e^(±0.5i) and a real pole at 0.6."""
    rng = np.random.default_rng(3)
    B, C, D = (rng.standard_normal(shape) for shape in ((3, 2), (2, 3), (2, 2)))
    return system(block_diag(oscillation(0.9, 0.5), 0.6), B, C, D)


def record_of(true: LinearModel, seed: int, samples: int, noise: float, memory: float = 0.0) -> InputOutputRecord:
    """Return a record under white inputs; the output noise is filtered by a first-order lag."""
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((samples, 2)), rng.standard_normal((samples + 50, 2))
    for k in range(1, len(e)):
        e[k] = memory * e[k - 1] + np.sqrt(1.0 - memory**2) * e[k]
    y = simulate(true, u, np.zeros(true.order))
    return InputOutputRecord(u=u, y=y + noise * y.std(axis=0) * e[50:], dt_s=1.0)


def refined_near(true: LinearModel, record: InputOutputRecord) -> ConfidenceIntervals:
    """Return the intervals of the model refined from the truth, so that the global minimum is found."""
    units = units_of([record])
    into, out = units.input_scale, units.output_scale
    B, D = np.pad(true.B * into, ((0, 0), (0, 1))), np.pad(true.D * into / out[:, None], ((0, 0), (0, 1)))
    start = Affine(A=true.A, B=B, C=true.C / out[:, None], D=D)
    experiments = experiments_of([record], units)
    found = of_refined(refined(start, experiments, fixed=FREE), experiments, FREE, units)
    assert found is not None
    return found


def gain(model: LinearModel) -> Complex[np.ndarray, "w p m"]:
    eye = np.eye(model.order)
    return np.array([model.C @ np.linalg.solve(np.exp(1j * w) * eye - model.A, model.B) + model.D for w in OMEGA])


def model_of(found: ConfidenceIntervals) -> LinearModel:
    return to_model(found.system, found.units, 1.0, ("a", "b", "c", "d"))


def poles_held(found: ConfidenceIntervals, true: LinearModel) -> list[bool]:
    expected, poles = np.linalg.eigvals(true.A), np.linalg.eigvals(found.system.A)
    return [bool(np.abs(pole - expected).min() <= radius) for pole, radius in zip(poles, found.pole_radii(), strict=True)]


def gains_held(found: ConfidenceIntervals, true: LinearModel) -> list[bool]:
    off = np.abs(gain(model_of(found))) - np.abs(gain(true))
    return list((np.abs(off) <= 1.96 * found.frequency(OMEGA)).ravel())


def markov_held(found: ConfidenceIntervals, true: LinearModel) -> list[bool]:
    response = impulse_response(model_of(found), STEPS)
    return list((np.abs(response - impulse_response(true, STEPS)) <= 1.96 * found.impulse(STEPS)).ravel())


@pytest.mark.parametrize(
    ("system", "samples", "noise", "memory"),
    [("eq_12", 300, 0.1, 0.0), ("spring", 400, 0.05, 0.0), ("eq_12", 1000, 0.1, 0.8)],
    ids=["real", "complex", "coloured"],
)
def test_intervals_of_a_refined_model_cover_the_truth_95_times_in_100(
    request: pytest.FixtureRequest, system: str, samples: int, noise: float, memory: float
) -> None:
    true: LinearModel = request.getfixturevalue(system)
    poles, gains, markov = [], [], []
    for seed in range(60):
        found = refined_near(true, record_of(true, 1000 + seed, samples, noise, memory))
        poles += poles_held(found, true)
        gains += gains_held(found, true)
        markov += markov_held(found, true)
    for held in (poles, gains, markov):
        assert 0.90 <= np.mean(held) <= 0.99


def test_intervals_of_the_selected_model_cover_the_truth_under_coloured_noise(eq_12: LinearModel) -> None:
    poles, gains = [], []
    for seed in range(20):
        found = fit(record_of(eq_12, seed, 1000, 0.1, 0.8), order=2).intervals
        if found is not None:  # candidates with refitted B and D only have no intervals
            poles += poles_held(found, eq_12)
            gains += gains_held(found, eq_12)
    assert len(poles) >= 30
    # Forty poles of twenty runs: 95 % ± 4, and two of these below. Over a hundred runs 96 % were counted.
    assert np.mean(poles) >= 0.87
    assert np.mean(gains) >= 0.87


@cache
def fits(method: str, lags: int | None, samples: int, noise: float, memory: float) -> list[Identified]:
    """Return fifty fits of order two to records of Eq. (12)."""
    true = system(paper.A, paper.B, paper.C, paper.D)
    records = [record_of(true, seed, samples, noise, memory) for seed in range(50)]
    return [fit(record, order=2, lags=lags, method=method) for record in records]


@pytest.mark.parametrize(
    ("method", "lags", "samples", "noise", "memory"),
    [
        ("okid-era", 4, 300, 0.1, 0.0),
        ("pbsid", 4, 300, 0.1, 0.0),
        # With β counted twice in the innovation response, 99.8 % were contained under coloured noise.
        ("okid-era", 20, 1000, 0.05, 0.8),
        # Lags by AICc: 92 and 90 to 95 were counted. With the two or three lags of the BIC the coverage was 84.
        ("okid-era", None, 1000, 0.2, 0.8),
    ],
)
def test_intervals_of_a_subspace_model_cover_the_truth_95_times_in_100(
    eq_12: LinearModel, method: str, lags: int | None, samples: int, noise: float, memory: float
) -> None:
    found = [one.intervals for one in fits(method, lags, samples, noise, memory)]
    poles = [hit for item in found if item is not None for hit in poles_held(item, eq_12)]
    gains = [hit for item in found if item is not None for hit in gains_held(item, eq_12)]
    assert len(poles) == 100
    assert np.mean(poles) >= 0.89
    assert method == "okid-era" or 0.90 <= np.mean(gains) <= 0.99


def test_residuals_without_power_at_a_mode_do_not_widen_its_interval() -> None:
    """Two modes of 0.5 % damping under 1 % white noise: the width matches the error."""
    A = block_diag(*(oscillation(np.exp(-0.005 * w), w) for w in (0.7, 1.9)))
    rng = np.random.default_rng(5)
    true = system(A, *(rng.standard_normal(shape) for shape in ((4, 2), (2, 4), (2, 2))))
    errors, radii = [], []
    for seed in range(12):
        found = fit(record_of(true, seed, 2000, 0.01), order=4, method="okid-era").intervals
        poles = np.linalg.eigvals(found.system.A)
        errors += np.abs(poles[:, None] - np.linalg.eigvals(A)).min(axis=1).tolist()
        radii += found.pole_radii().tolist()
    # A disc of 95 % has 1.73 times the root mean square distance, known from 24 pairs to a seventh: 1.39 was found, and 2.33 with
    # weights that decay from lag zero.
    assert np.median(radii) < 2.0 * np.sqrt(np.mean(np.square(errors)))
    assert np.mean(np.array(errors) <= radii) >= 0.85


def test_the_report_contains_the_intervals_of_the_model(draw: Draw) -> None:
    found = fit(draw(0, noise=0.1, samples=400), order=2)
    assert found.report.pole_ci95 == pytest.approx(found.intervals.pole_radii().tolist())
    np.testing.assert_allclose(gain(model_of(found.intervals)), gain(found.model), rtol=1e-9)


def test_intervals_follow_the_units_of_the_record(draw: Draw) -> None:
    record = draw(6, noise=0.1, samples=400)
    into, out = np.array([1e3, 1e-2]), np.array([1e-4, 1e2])
    other = InputOutputRecord(u=record.u * into, y=record.y * out, dt_s=1.0)
    plain, scaled = (fit(item, order=2, method="okid-era").intervals for item in (record, other))
    np.testing.assert_allclose(scaled.pole_radii(), plain.pole_radii(), rtol=1e-6)
    np.testing.assert_allclose(scaled.impulse(STEPS), plain.impulse(STEPS) * out[:, None] / into, rtol=1e-6)
    np.testing.assert_allclose(scaled.frequency(OMEGA), plain.frequency(OMEGA) * out[:, None] / into, rtol=1e-6)


def test_the_interval_of_the_impulse_response_matches_the_scatter_over_many_records() -> None:
    models = fits("okid-era", 4, 300, 0.1, 0.0)
    spread = np.std([impulse_response(item.model, STEPS) for item in models], axis=0)
    declared: Float[np.ndarray, "k p m"] = np.mean([item.intervals.impulse(STEPS) for item in models if item.intervals], axis=0)
    # A standard deviation of 50 runs is known to 10 %: two and a half of those. Beyond the lags, parameters follow from products of
    # noisy ones, and the first-order intervals are too wide by a half at most.
    np.testing.assert_allclose(declared[:2], spread[:2], rtol=0.25)
    assert np.all((declared > 0.8 * spread) & (declared < 1.6 * spread))


def test_an_exact_model_has_vanishing_intervals(draw: Draw) -> None:
    found = fit(draw(7), order=2)
    # Without noise only rounding remains.
    assert found.intervals.pole_radii().max() < 1e-6
