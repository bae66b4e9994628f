"""MuJoCo plant: no result from a numerically invalid simulation."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from oracles.plant_runs import plant_on

from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.plant.mujoco import MujocoPlant, open_plant


def lost_number(plant: MujocoPlant) -> None:
    plant._data.qvel[0] = math.nan


def out_of_the_world(plant: MujocoPlant) -> None:
    plant._data.qpos[2] = math.inf


def other_clock(plant: MujocoPlant) -> None:
    plant._model.opt.timestep = 0.004


def too_fast(plant: MujocoPlant) -> None:
    plant._data.qvel[0] = 1e12


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (lost_number, r"not finite at 0\.00…0\.10 s"),
        (out_of_the_world, r"not finite at 0\.00…0\.10 s"),
        (other_clock, r"time went from 0\.000 s to 0\.200 s"),
        (too_fast, r"MuJoCo warned of mjWARN_\w+(, mjWARN_\w+)* at 0\.00…0\.10 s"),
    ],
    ids=["a NaN", "an infinite height", "time at double pace", "light speed"],
)
def test_a_simulator_that_left_physics_gives_no_result(
    fault: Callable[[MujocoPlant], None], message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    plant = plant_on()
    fault(plant)
    with pytest.raises(SimulationDiverged, match=message):
        plant.advance(0.1)
    # Left to itself, MuJoCo writes a log of its warnings where it stands.
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("without_shape_checks")
def test_a_plant_is_not_opened_by_a_scenarios_name() -> None:
    with pytest.raises(SettingsError, match="open_plant is given 'paper-28'; wanted a Scenario: read_scenario returns one"):
        open_plant("paper-28")
