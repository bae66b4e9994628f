"""Records that begin at rest, are of many pieces, or have more coefficients than their samples determine."""

from dataclasses import replace

import numpy as np
import pytest
from systems import system

from treadline.core.linear_systems import fit_percent, initial_state, simulate
from treadline.core.model_scores import compare
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, identify


def two_lags() -> LinearModel:
    return system(np.diag([0.8, 0.7]), np.eye(2), np.eye(2))


def test_an_output_at_rest_leaves_the_initial_state_of_the_others() -> None:
    """Test: the first output rests for 60 of 200 rows, the second begins at 5. Expected result: the true start, and 100 %."""
    model, u = two_lags(), np.random.default_rng(1).standard_normal((200, 2))
    u[:60, 0] = 0.0
    record = InputOutputRecord(u=u, y=simulate(model, u, np.array([0.0, 5.0])), dt_s=model.dt_s)
    head = InputOutputRecord(u=u[:20], y=record.y[:20], dt_s=model.dt_s)
    assert initial_state(model, head) == pytest.approx([0.0, 5.0], abs=1e-9)
    assert fit_percent(model, record) == pytest.approx([100.0, 100.0], abs=1e-6)


@pytest.mark.parametrize(("samples", "order", "seed"), [(100, 15, 3), (150, 20, 4), (220, 30, 5)])
def test_many_coefficients_are_no_chance_where_the_inputs_explain_most(samples: int, order: int, seed: int) -> None:
    """Test: a lag with a tenth of noise, of a large order that is given. Expected result: the outputs' response stays."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 1))
    y = simulate(system([[0.8]], [[1.0]], [[1.0]]), u, np.zeros(1)) + 0.1 * rng.standard_normal((samples, 1))
    found = identify(InputOutputRecord(u=u, y=y, dt_s=1.0), IdentificationOptions(order=order, method="best", delays=0))
    assert not any("chance" in line for line in found.report.warnings)
    assert found.model.C.any()


def test_dead_time_of_several_records_is_found_as_of_one() -> None:
    """Test: three records of 2000 rows, dead time 30. Expected result: the same as for one; a last piece shortens no search."""
    rng = np.random.default_rng(6)
    records = []
    for _ in range(3):
        u = rng.standard_normal((2000, 1))
        late = np.vstack([np.zeros((30, 1)), u[:-30]])
        y = simulate(system([[0.8]], [[1.0]], [[1.0]]), late, np.zeros(1)) + 0.1 * rng.standard_normal((2000, 1))
        records.append(InputOutputRecord(u=u, y=y, dt_s=1.0))
    assert identify(records, IdentificationOptions(method="best")).model.input_delay == (30,)


def test_the_residual_test_sees_the_inputs_when_they_act() -> None:
    """Test: a lag as the model of two, both with a dead time of 20. Expected result: p below 1 %, as without dead time."""
    u = np.random.default_rng(7).standard_normal((2000, 1))
    late = np.vstack([np.zeros((20, 1)), u[:-20]])
    y = simulate(system(np.diag([0.8, -0.5]), np.ones((2, 1)), np.ones((1, 2))), late, np.zeros(2))
    noisy = y + 0.1 * np.random.default_rng(8).standard_normal(y.shape)
    model = replace(system([[0.8]], [[1.0]], [[1.0]]), input_delay=(20,))
    p = compare(model, InputOutputRecord(u=u, y=noisy, dt_s=model.dt_s)).crosscorrelation_p
    assert p is not None
    assert p < 0.01
