"""Manoeuvres of a tracked chair on a stair: roll-back in turns on the spot, and pitch-over at the crest."""

import math

import numpy as np
import pytest
from oracles.plant_runs import TABLE_I, heading_and_place, plant_on, plant_run, theory_from

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import open_plant
from treadline.scenario.scenario import Chair, Control, Scenario, Stair, Start


def scenario(slope_deg: float, *, steps: int = 60, heading_deg: float = 0.0) -> Scenario:
    return Scenario(
        stair=Stair.model_validate(
            {"slope_deg": slope_deg, "run_m": 0.30, "steps": steps, "width_m": 20.0, "walls": "none", "landing_m": 3.0}
        ),
        chair=Chair(belt_mismatch=0.0),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        control=Control(vision="truth"),
    )


def drive(settings: Scenario, left_m_s: float, right_m_s: float, until_s: float) -> list[Truth]:
    plant = open_plant(settings, seed=0)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=left_m_s, right_m_s=right_m_s), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(until_s)
    return list(plant.truth())


def roll_back(samples: list[Truth]) -> float:
    x = np.array([sample.x_m for sample in samples])
    return float((np.maximum.accumulate(x) - x).max())


TURN_S, SETTLED_S = 3.0, 0.5


@pytest.mark.parametrize(
    ("belts", "final_deg"),
    # The heading as it nears the dead zone depends on which nosings carry when it does: 4° of the 24 that are turned.
    [((-0.3, 0.3), 4.0), ((0.1, 0.7), 4.0)],
    ids=["on the spot", "uphill"],
)
def test_a_turn_from_30_degrees_goes_and_rolls_back_as_coulomb_says(belts: tuple[float, float], final_deg: float) -> None:
    plant = plant_on(28.0, heading_deg=-30.0, steps=60)
    turn = plant_run(plant, belts, TURN_S - SETTLED_S, SETTLED_S)
    theory = theory_from(plant, turn.begin, 28.0, TABLE_I, belts, TURN_S - SETTLED_S)
    heading, place = heading_and_place(plant, turn.log[-1])
    start = heading_and_place(plant, turn.begin)[1]
    assert heading / DEG == pytest.approx(theory.heading_rad[-1] / DEG, abs=final_deg)
    # Measured: 5 mm of 0.70 m downhill, and 2 mm of 0.29 m uphill.
    assert place - start == pytest.approx(theory.climbed_m[-1], abs=0.03)


def test_turning_on_the_spot_slides_the_chair_downhill_and_turning_uphill_does_not() -> None:
    # The slow belt carries the chair: back at -0.3 m/s, up at 0.1 m/s, in both runs with 0.6 m/s between the belts.
    assert roll_back(drive(scenario(28.0, heading_deg=-30.0), -0.3, 0.3, 3.0)) > 0.3
    assert roll_back(drive(scenario(28.0, heading_deg=-30.0), 0.1, 0.7, 3.0)) < 0.02


@pytest.mark.parametrize("slope_deg", [25.0, 30.0])
def test_the_crest_is_a_free_pitch_over(slope_deg: float) -> None:
    samples = drive(scenario(slope_deg, steps=10), 0.2, 0.2, 11.0)
    fastest = max(abs(sample.pitch_rate_rad_s) for sample in samples) / DEG
    # A rigid body that tips over a nosing: about √(2 g Δh m / I), 119 to 134 °/s on other geometries, 109 and 114 here.
    assert 80.0 < fastest < 170.0
    assert abs(samples[-1].pitch_rad) < 1.0 * DEG  # it lands flat on the landing


def test_a_chair_facing_the_slope_at_an_angle_keeps_it_with_the_brake_on() -> None:
    plant = open_plant(scenario(28.0, heading_deg=20.0), seed=0)
    plant.start()
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(10.0)
    samples = list(plant.truth())
    assert abs(samples[-1].heading_rad - samples[0].heading_rad) < 0.5 * DEG
    assert math.hypot(samples[-1].x_m - samples[0].x_m, samples[-1].y_m - samples[0].y_m) < 0.02
