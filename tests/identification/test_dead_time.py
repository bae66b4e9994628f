"""Dead time is estimated to the sample, removed from the data, and restored in the model as states."""

import numpy as np
import pytest
from systems import fit, system

from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._input_structure import with_delays, without_delays


@pytest.fixture(scope="module")
def plant() -> LinearModel:
    """Two states without feedthrough, with operating point and observer gain."""
    return system(
        A=[[0.8, 0.2], [-0.1, 0.5]],
        B=[[1.0, 0.5], [0.3, -1.0]],
        C=[[1.0, 0.0], [0.5, 1.0]],
        dt_s=0.1,
        input_offset=np.array([0.2, -0.1]),
        output_offset=np.array([1.0, 2.0]),
        observer_gain=np.array([[0.2, 0.0], [0.0, 0.1]]),
    )


def late(u: np.ndarray, shifts: tuple[int, int]) -> np.ndarray:
    """Return delayed inputs; the first samples are those of rest."""
    return np.column_stack([np.concatenate([np.zeros(d), u[: len(u) - d, j]]) for j, d in enumerate(shifts)])


def delayed_record(plant: LinearModel, shifts: tuple[int, int], noise: float = 0.01, samples: int = 800) -> InputOutputRecord:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((samples, 2))
    y = simulate(plant, late(u, shifts), np.zeros(2))
    return InputOutputRecord(u=u, y=y + noise * y.std(axis=0) * rng.standard_normal(y.shape), dt_s=0.1)


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("shifts", [(0, 0), (0, 4), (6, 2)])
def test_dead_time_is_found_to_the_sample(plant: LinearModel, shifts: tuple[int, int], noise: float) -> None:
    report = fit(delayed_record(plant, shifts, noise), method="okid-era", order=2 + sum(shifts), lags=12).report
    # Without feedthrough an input acts one sample later even without dead time.
    assert report.delays == [d + 1 for d in shifts]


def test_feedthrough_is_a_delay_of_zero(plant: LinearModel) -> None:
    record = delayed_record(plant, (0, 0))
    direct = InputOutputRecord(u=record.u, y=record.y + record.u, dt_s=0.1)
    assert fit(direct, method="okid-era").report.delays == [0, 0]


@pytest.mark.parametrize("shifts", [(0, 0), (3, 0), (1, 5), (2, 2)])
def test_a_model_with_dead_time_responds_like_the_model_with_delayed_inputs(plant: LinearModel, shifts: tuple[int, int]) -> None:
    u = plant.input_offset + np.random.default_rng(1).standard_normal((60, 2))
    delayed = with_delays(plant, shifts)
    assert delayed.order == 2 + sum(shifts)
    shifted = plant.input_offset + late(u - plant.input_offset, shifts)
    expected = simulate(plant, shifted, np.zeros(2))
    np.testing.assert_allclose(simulate(delayed, u, np.zeros(delayed.order)), expected, atol=1e-13)


def test_dead_time_keeps_the_observer_stable(plant: LinearModel) -> None:
    delayed = with_delays(plant, (2, 3))
    assert delayed.observer_gain is not None
    assert plant.observer_gain is not None
    # A delay chain is nilpotent: its poles are at zero for any observer gain. A fivefold pole at zero is found to 1e-16^(1/3).
    expected = np.abs(np.linalg.eigvals(plant.A - plant.observer_gain @ plant.C))
    found = np.abs(np.linalg.eigvals(delayed.A - delayed.observer_gain @ delayed.C))
    np.testing.assert_allclose(np.sort(found)[-2:], np.sort(expected), atol=1e-9)
    assert np.sort(found)[:5].max() < 1e-4


def test_removing_and_restoring_dead_time_recovers_the_true_model(plant: LinearModel) -> None:
    record = delayed_record(plant, (4, 1), noise=0.0)
    found = fit(record, delays=[4, 1], order=2)
    expected = impulse_response(with_delays(plant, (4, 1)), 20)
    np.testing.assert_allclose(impulse_response(found.model, 20), expected, atol=1e-12 * np.abs(expected).max())
    assert found.report.order == 2 + 5
    assert found.report.delays == [5, 2]


@pytest.mark.parametrize("shifts", [(5, 0), (3, 4)])
def test_auto_finds_the_order_without_dead_time_and_adds_its_chains(plant: LinearModel, shifts: tuple[int, int]) -> None:
    found = fit(delayed_record(plant, shifts), delays="auto")
    assert found.report.delays == [d + 1 for d in shifts]
    assert found.model.order == 2 + sum(shifts)
    expected = impulse_response(with_delays(plant, shifts), 20)
    # 1 % noise on 800 samples.
    assert np.linalg.norm(impulse_response(found.model, 20) - expected) < 0.005 * np.linalg.norm(expected)


def test_dead_time_modelled_by_states_gives_a_warning(plant: LinearModel) -> None:
    warnings = fit(delayed_record(plant, (5, 0)), method="okid-era", order=7).report.warnings
    assert any("dead time: 'u1' acts after 6 samples" in warning for warning in warnings)


def test_removing_dead_time_delays_each_input_by_its_shift() -> None:
    t = np.arange(10.0)
    record = InputOutputRecord(u=np.column_stack([t, 100.0 + t]), y=t[:, None].copy(), dt_s=1.0)
    moved = without_delays([record], [3, 1])[0]
    np.testing.assert_array_equal(moved.y[:, 0], t[3:])
    np.testing.assert_array_equal(moved.u[:, 0], t[:7])
    np.testing.assert_array_equal(moved.u[:, 1], 100.0 + t[2:9])
