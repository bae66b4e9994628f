"""MuJoCo plant: sensor errors against ground truth, and no result from a numerically invalid simulation."""

import math
from collections.abc import Callable
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
from oracles.plant_runs import plant_on

from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.core.signals import ImuSample, SeatCommand, TrackCommand
from treadline.plant.mujoco import MujocoPlant, open_plant


def started(imu: str = "mpu6050") -> MujocoPlant:
    """Return a plant at its start, on a flight of 28°."""
    return plant_on(heading_deg=5.0, seed=3, tables={"sensors": {"imu": imu}}, belt_mismatch=0.01)


def test_an_ideal_imu_reports_ground_truth() -> None:
    plant = started("ideal")
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.01))
    plant.advance(2.0)
    samples = [reading for reading in plant.read() if isinstance(reading, ImuSample)]
    truth = plant.truth()
    rate = [sample.angular_velocity_rad_s[1] for sample in samples]
    np.testing.assert_allclose(rate, [-sample.pitch_rate_rad_s for sample in truth], atol=1e-12)
    # At rest on 28° the specific force is gravity alone; half a percent is what settling leaves.
    assert float(np.linalg.norm(samples[0].linear_acceleration_m_s2)) == pytest.approx(9.81, rel=5e-3)


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
    plant = started()
    fault(plant)
    with pytest.raises(SimulationDiverged, match=message):
        plant.advance(0.1)
    # Left to itself, MuJoCo writes a log of its warnings where it stands.
    assert not list(tmp_path.iterdir())


def test_a_plant_is_not_opened_by_a_scenarios_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(SettingsError, match="open_plant is given 'paper-28'; wanted a Scenario: read_scenario returns one"):
        open_plant("paper-28")
