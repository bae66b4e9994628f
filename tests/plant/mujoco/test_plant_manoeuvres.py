"""Manoeuvres of a tracked chair on a stair: roll-back in turns on the spot, and pitch-over at the crest."""

import pytest
from oracles.plant_runs import TABLE_I, heading_and_place, held, plant_on, plant_run, theory_from

from treadline.core.angles import DEG

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


@pytest.mark.parametrize("slope_deg", [25.0, 30.0])
def test_the_crest_is_a_free_pitch_over(slope_deg: float) -> None:
    samples = held(plant_on(slope_deg, steps=10, stair={"landing_m": 3.0}), 0.2, 0.2, 11.0)
    fastest = max(abs(sample.pitch_rate_rad_s) for sample in samples) / DEG
    # A rigid body that tips over a nosing: about √(2 g Δh m / I), 119 to 134 °/s on other geometries, 109 and 114 here.
    assert 80.0 < fastest < 170.0
    assert abs(samples[-1].pitch_rad) < 1.0 * DEG  # it lands flat on the landing
