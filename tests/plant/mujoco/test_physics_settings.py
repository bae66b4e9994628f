"""Step size, contact stiffness and accuracy of a plant: each reaches the model, and what cannot be integrated is refused."""

import mujoco
import numpy as np
import pytest
from oracles.plant_runs import plant_on

from treadline.core.errors import SettingsError
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import NOMINAL, MujocoPlant, Physics

SLOPE_DEG = 28.0


def plant(physics: Physics) -> MujocoPlant:
    return plant_on(SLOPE_DEG, seed=0, physics=physics)


def climbed_m(made: MujocoPlant, left_m_s: float, right_m_s: float, seconds: float) -> float:
    """Return the climb over some seconds."""
    start_m = made.truth()[-1].x_m
    made.write(TrackCommand(t_s=0.0, left_m_s=left_m_s, right_m_s=right_m_s), SeatCommand(t_s=0.0, rate_m_s=0.0))
    made.advance(seconds)
    return float(made.truth()[-1].x_m - start_m)


@pytest.mark.parametrize("timestep_s", [0.001, 0.0025])
def test_another_step_takes_as_many_more_steps_and_climbs_as_far(timestep_s: float) -> None:
    made, nominal = plant(Physics(timestep_s=timestep_s)), plant(NOMINAL)
    assert made._model.opt.timestep == timestep_s
    distance_m = climbed_m(made, 0.2, 0.2, 2.0)
    assert made._data.time == pytest.approx(2.0, abs=1e-9)
    # A climb without slip: the step changes the drive's run-up by nothing and the wrap over a nosing by micrometres.
    assert distance_m == pytest.approx(climbed_m(nominal, 0.2, 0.2, 2.0), abs=1e-3)


def test_a_softer_contact_sinks_in_further() -> None:
    depth_m = {}
    for time_constant_s in (0.005, 0.01, 0.02):
        made = plant(Physics(contact_time_constant_s=time_constant_s))
        np.testing.assert_allclose(made._model.geom_solref[:, 0], time_constant_s)
        mujoco.mj_forward(made._model, made._data)
        depth_m[time_constant_s] = -float(made._data.contact.dist.min())
    # A spring's sag under the same load goes with the square of its time constant: fourfold each, less where the impedance rises.
    assert depth_m[0.01] > 2.0 * depth_m[0.005]
    assert depth_m[0.02] > 2.0 * depth_m[0.01]


def mean_residual(physics: Physics) -> float:
    """Return the mean over two seconds of a turn, in which contacts slide, of the largest residual in each tick [m/s²]."""
    made = plant(physics)
    made.write(TrackCommand(t_s=0.0, left_m_s=0.05, right_m_s=0.35), SeatCommand(t_s=0.0, rate_m_s=0.0))
    made.advance(2.0)
    return float(np.mean([sample.contact_residual_m_s2 for sample in made.truth()]))


def test_fewer_solves_leave_a_larger_residual() -> None:
    assert mean_residual(Physics(max_solves=10)) < 0.5 * mean_residual(Physics(max_solves=1))


def test_a_tighter_tolerance_leaves_a_smaller_residual() -> None:
    # With solves enough the residual is what is accepted: a hundredth of it accepted, less than a tenth left.
    tight, loose = (mean_residual(Physics(tolerance_m_s2=tolerance, max_solves=50)) for tolerance in (0.001, 0.1))
    assert tight < 0.1 * loose


def test_the_nominal_physics_change_nothing() -> None:
    assert (NOMINAL.timestep_s, NOMINAL.contact_time_constant_s, NOMINAL.substeps) == (0.002, 0.01, 5)
    assert Physics(timestep_s=0.005).substeps == 2  # the bound itself: 2 × 0.005 s is the nominal time constant


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"timestep_s": 0.004}, r"timestep_s is 0.004 s; a tick of 0.01 s is a whole number of steps: 0.005, 0.0025, 0.002, 0.001"),
        (
            {"contact_time_constant_s": 0.003},
            r"contact_time_constant_s is 0.003 s; a step of 0.002 s integrates at least 2 × timestep_s = 0.004 s: a stiffer spring",
        ),
        ({"timestep_s": 0.01}, "contact_time_constant_s is 0.01 s; a step of 0.01 s integrates at least 2 × timestep_s = 0.02 s"),
        ({"contact_time_constant_s": float("nan")}, "contact_time_constant_s is nan s"),
        ({"tolerance_m_s2": 0.0}, "tolerance_m_s2 is 0 m/s²; it must be above 0"),
        ({"max_solves": 0}, "max_solves is 0; a step needs at least 1"),
    ],
)
def test_what_cannot_be_integrated_is_refused_in_one_line(settings: dict[str, float], says: str) -> None:
    with pytest.raises(SettingsError, match=says) as caught:
        Physics(**settings)
    assert "\n" not in str(caught.value)
