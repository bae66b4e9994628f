"""The Coulomb model with inertia: against free sliding, the quasi-static balance, Drake, and the plant per nosing pitch.

A chair with friction 0.62 both ways on 25° turns while two nosings carry it, 43 mm of each pitch of 331 mm.
"""

import math
from functools import partial

import numpy as np
import pytest
from oracles.dynamic_coulomb import dynamic_run
from oracles.plant_runs import heading_and_place, plant_on, plant_run, theory_from

from treadline.core.angles import DEG
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import QuasiStaticRun, quasi_static_run

SLOPE_RAD = 25.0 * DEG
PITCH_M = 0.30 / math.cos(SLOPE_RAD)
ISOTROPIC = (0.62, 0.62)
FULL = (0.15, 0.25)


def gained_deg(run: QuasiStaticRun) -> float:
    return float(run.heading_rad[-1] - run.heading_rad[0]) / DEG


def over_a_pitch(share: float, step_s: float = 0.005) -> QuasiStaticRun:
    """Return the run over the first nosing pitch of the plant's start, with belts at a share of the full speed."""
    belts = (share * FULL[0], share * FULL[1])
    flight = (read_chair("wheelchair"), Chair(), SLOPE_RAD, PITCH_M, ISOTROPIC)
    return dynamic_run(*flight, belts, PITCH_M / belts[0], nosing_ahead_m=0.1, step_s=step_s / share)


def test_a_chair_on_too_steep_a_flight_slides_with_gravity_less_friction() -> None:
    slope = 35.0 * DEG
    flight = (read_chair("wheelchair"), Chair(), slope, 0.30 / math.cos(slope))
    run = dynamic_run(*flight, (0.62, 0.5), (0.0, 0.0), 0.5, step_s=0.0025)
    expected = 9.81 * (math.sin(slope) - 0.62 * math.cos(slope))
    speed = float(run.climbed_m[-2] - run.climbed_m[-1]) / 0.0025
    start = float(run.climbed_m[0] - run.climbed_m[1]) / 0.0025
    assert speed - start == pytest.approx(expected * (0.5 - 0.0025), rel=1e-3)


def test_on_slow_belts_inertia_no_longer_counts() -> None:
    chair = read_chair("wheelchair")
    slow = quasi_static_run(
        chair,
        partial(centre_of_mass, chair, Chair()),
        SLOPE_RAD,
        PITCH_M,
        ISOTROPIC,
        *FULL,
        PITCH_M / FULL[0],
        nosing_ahead_m=0.1,
        step_s=0.005,
    )
    gained = [gained_deg(over_a_pitch(share)) for share in (1.0, 0.5, 0.25, 0.125)]
    assert (np.diff(gained) > 0.0).all()
    assert gained[0] < 0.85 * gained_deg(slow)
    assert gained[-1] == pytest.approx(gained_deg(slow), rel=0.01)


def test_half_the_step_changes_the_gain_of_a_pitch_by_less_than_a_hundredth() -> None:
    assert gained_deg(over_a_pitch(1.0, 0.0025)) == pytest.approx(gained_deg(over_a_pitch(1.0)), rel=0.01)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.25])
def test_the_plant_gains_per_nosing_pitch_what_coulomb_friction_and_inertia_give(share: float) -> None:
    belts = (share * FULL[0], share * FULL[1])
    duration_s = math.floor(100.0 * PITCH_M / belts[0]) / 100.0
    run = plant_run(plant_on(25.0, ISOTROPIC), belts, duration_s)
    heading = np.array([heading_and_place(run.plant, row)[0] for row in (run.begin, *run.settled)]) / DEG
    # The chair sticks in seven eighths of a pitch: the median rate is the creep of regularised friction.
    gained = heading[-1] - heading[0] - np.median(np.diff(heading)) * (len(heading) - 1)
    theory = gained_deg(theory_from(run.plant, run.begin, 25.0, ISOTROPIC, belts, duration_s))
    assert gained == pytest.approx(theory, rel=0.07)
