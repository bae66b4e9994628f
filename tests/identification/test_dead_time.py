"""Dead time is found to the sample, in open and closed loop; a start far from rest and a slow plant are none."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from systems import fit, oscillation, system

from treadline.core.linear_systems import fit_percent, impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._dead_time import dead_time

SAMPLES = 600
INPUTS = ["white", "prbs", "lowpass"]


def plant(rng: np.random.Generator, inputs: int, *, slow: bool = False) -> LinearModel:
    """Return a stable plant of order 1 to 6 without feedthrough; a slow one is a single lag of 20 to 100 samples."""
    if slow:
        pole = np.exp(-1.0 / rng.uniform(20.0, 100.0))
        return system([[pole]], rng.normal(size=(1, inputs)), [[1.0]])
    order = int(rng.integers(1, 7))
    A = np.diag(rng.uniform(0.2, 0.95, order))
    if order > 1:
        A[:2, :2] = oscillation(rng.uniform(0.5, 0.95), rng.uniform(0.1, 2.0))
    return system(A, rng.normal(size=(order, inputs)), rng.normal(size=(1, order)))


def inputs_of(rng: np.random.Generator, kind: str, count: int) -> np.ndarray:
    if kind == "prbs":
        return np.repeat(rng.choice([-1.0, 1.0], size=(SAMPLES // 3, count)), 3, axis=0)
    white = rng.standard_normal((SAMPLES, count))
    return white if kind == "white" else lfilter(*butter(2, 0.2), white, axis=0)


def late(u: np.ndarray, shifts: tuple[int, ...]) -> np.ndarray:
    return np.column_stack([np.concatenate([np.zeros(d), u[: len(u) - d, j]]) for j, d in enumerate(shifts)])


def record_of(seed: int, kind: str, shift: int, *, start: float = 0.0, slow: bool = False) -> InputOutputRecord:
    """Return a record of a random plant with 1 to 20 % noise; ``start`` is its initial state."""
    rng = np.random.default_rng(seed)
    count = 1 + seed % 2
    model, u = plant(rng, count, slow=slow), inputs_of(rng, kind, count)
    moved = late(u, (shift,) * count)
    rest = simulate(model, moved, np.zeros(model.order))
    y = simulate(model, moved, start * rng.normal(size=model.order))
    return InputOutputRecord(u=u, y=y + rng.uniform(0.01, 0.2) * rest.std() * rng.standard_normal(y.shape), dt_s=0.1)


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("shift", [0, 10, 30])
def test_dead_time_is_found_to_the_sample(kind: str, shift: int) -> None:
    found = [dead_time([record_of(seed, kind, shift)]) for seed in range(100, 104)]
    assert found == [[shift] * len(one) for one in found]


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("far", [{"start": 300.0}, {"slow": True}])
def test_neither_a_long_decay_nor_a_slow_plant_is_dead_time(kind: str, far: dict[str, float]) -> None:
    assert not any(any(dead_time([record_of(seed, kind, 0, **far)])) for seed in range(200, 204))


def test_dead_time_is_found_in_closed_loop() -> None:
    """Test: an integrator with dead time, held by its noisy output through a law without dead time, and dithered."""
    for seed in range(300, 306):
        rng = np.random.default_rng(seed)
        u, y, x = np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 1)), 0.0
        for k in range(SAMPLES):
            y[k] = x + 0.02 * rng.standard_normal()
            u[k] = -0.01 * y[k] + 0.1 * rng.standard_normal()
            x += u[k - 30, 0] if k >= 30 else 0.0
        assert dead_time([InputOutputRecord(u=u, y=y, dt_s=0.1)]) == [30], seed


@pytest.mark.parametrize("shifts", [(30, 0), (30, 12)])
def test_each_input_has_its_own_dead_time(shifts: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal((SAMPLES, 2))
    truth = plant(rng, 2)
    y = simulate(truth, late(u, shifts), np.zeros(truth.order))
    assert dead_time([InputOutputRecord(u=u, y=y + 0.02 * rng.standard_normal(y.shape), dt_s=0.1)]) == list(shifts)


def test_a_path_without_dead_time_beside_one_with_it_is_kept() -> None:
    rng = np.random.default_rng(2)
    u = rng.standard_normal((SAMPLES, 1))
    y = lfilter([0.0, 1.0], [1.0, -0.8], late(u, (30,)), axis=0) + 0.3 * late(u, (1,)) + 0.05 * rng.standard_normal((SAMPLES, 1))
    assert dead_time([InputOutputRecord(u=u, y=y, dt_s=0.1)]) == [0]


def test_a_periodic_input_is_not_found_a_period_late() -> None:
    rng = np.random.default_rng(3)
    u = np.tile(rng.choice([-1.0, 1.0], size=(63, 1)), (10, 1))
    for shift in (0, 30):
        y = lfilter([0.0, 1.0], [1.0, -0.8], late(u, (shift,)), axis=0) + 0.05 * rng.standard_normal((630, 1))
        assert dead_time([InputOutputRecord(u=u, y=y, dt_s=0.1)]) == [shift]


def test_missing_samples_and_a_constant_input_do_not_hide_dead_time() -> None:
    record = record_of(104, "white", 30)
    u, y = np.column_stack([record.u, np.ones(SAMPLES)]), record.y.copy()
    y[np.random.default_rng(4).random(SAMPLES) < 0.05] = np.nan
    assert dead_time([InputOutputRecord(u=u, y=y, dt_s=0.1)]) == [30, 0]


def test_outputs_that_no_input_moves_have_no_dead_time() -> None:
    rng = np.random.default_rng(5)
    walk = np.cumsum(rng.standard_normal((SAMPLES, 2)), axis=0)
    for y in (rng.standard_normal((SAMPLES, 2)), walk):
        assert dead_time([InputOutputRecord(u=rng.standard_normal((SAMPLES, 2)), y=y, dt_s=0.1)]) == [0, 0]


def test_dead_time_is_a_property_of_the_model_and_costs_no_states() -> None:
    rng = np.random.default_rng(6)
    truth, u = system([[0.8, 0.2], [-0.1, 0.5]], [[1.0], [0.3]], [[1.0, 0.0]]), rng.standard_normal((SAMPLES, 1))
    y = simulate(truth, late(u, (30,)), np.zeros(2))
    record = InputOutputRecord(u=u, y=y + 0.05 * y.std() * rng.standard_normal(y.shape), dt_s=1.0)
    found = fit(record, order=2)
    assert found.model.input_delay == (30,)
    assert found.report.delays == [30]
    assert fit_percent(found.model, record) > 93.0
    expected = np.concatenate([np.zeros((30, 1, 1)), impulse_response(truth, 20)])
    np.testing.assert_allclose(impulse_response(found.model, 50), expected, atol=0.05)
    assert fit(record, order=2, delays=0).model.input_delay == (0,)
    assert fit(record, order=2, delays=[29]).model.input_delay == (29,)
