"""A model's dead time: its simulation is the simulation with inputs that come later; files keep it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from systems import system

from treadline.core.linear_systems import (
    fit_percent,
    h_step_rmse,
    predictions,
    simulate,
)
from treadline.core.models import InputOutputRecord, LinearModel

SHIFTS = [(0, 0), (3, 0), (1, 5), (30, 30), (70, 2)]


@pytest.fixture(scope="module")
def plant() -> LinearModel:
    """Two states with feedthrough, operating point and observer gain."""
    return system(
        A=[[0.8, 0.2], [-0.1, 0.5]],
        B=[[1.0, 0.5], [0.3, -1.0]],
        C=[[1.0, 0.0], [0.5, 1.0]],
        D=[[0.1, 0.0], [0.0, 0.2]],
        dt_s=0.1,
        input_offset=np.array([0.2, -0.1]),
        output_offset=np.array([1.0, 2.0]),
        observer_gain=np.array([[0.2, 0.0], [0.0, 0.1]]),
    )


def late(u: np.ndarray, shifts: tuple[int, int], rest: np.ndarray) -> np.ndarray:
    """Return inputs that come later; before they do they are at rest."""
    return np.column_stack([np.concatenate([np.full(d, rest[j]), u[:, j]])[: len(u)] for j, d in enumerate(shifts)])


@pytest.mark.parametrize("shifts", SHIFTS)
def test_predictions_begin_with_the_first_input_that_acts(plant: LinearModel, shifts: tuple[int, int]) -> None:
    u = np.random.default_rng(2).standard_normal((300, 2))
    y = simulate(plant, late(u, shifts, np.array([5.0, -5.0])), np.zeros(2))  # another rest than the model's
    record, delayed = InputOutputRecord(u=u, y=y, dt_s=0.1), replace(plant, input_delay=shifts)
    predicted, first = predictions(delayed, record), max(shifts)
    assert np.isnan(predicted[:first]).all(axis=1).all()
    np.testing.assert_allclose(predicted[first:], y[first:], atol=1e-8)
    np.testing.assert_allclose(fit_percent(delayed, record), 100.0, atol=1e-6)
    np.testing.assert_allclose(h_step_rmse(delayed, record, 7), 0.0, atol=1e-8)


def test_files_keep_the_dead_time_and_older_files_have_none(plant: LinearModel, tmp_path: Path) -> None:
    path, delayed = tmp_path / "model.json", replace(plant, input_delay=(30, 2))
    delayed.save(path)
    assert LinearModel.load(path).input_delay == (30, 2)
    older = json.loads(path.read_text())
    del older["input_delay"]
    path.write_text(json.dumps(older))
    assert LinearModel.load(path).input_delay == (0, 0)
    delayed.save(tmp_path / "model.mat")
    np.testing.assert_array_equal(loadmat(tmp_path / "model.mat")["input_delay"], [[30.0], [2.0]])
