"""Ground along a straight drive: the polyline agrees with the solids on which the simulated chair stands."""

import numpy as np
import pytest

from treadline.scenario.scenario import Scenario
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.stair_solids import ground_m, stair_surfaces
from treadline.vehicle.staircase import as_designed

SCENES = {
    "a flight": {"stair": {"steps": 5, "rise_m": 0.17, "run_m": 0.28}},
    "a kerb": {"stair": {"steps": 1, "rise_m": 0.12}},
    "a stair with a landing": {"stair": {"steps": 3, "flights": 2}},
    "a missing step": {"stair": {"steps": 5, "missing_steps": [2]}},
    "sills on floor and landing": {
        "stair": {"steps": 3, "landing_m": 3.0},
        "sill": [
            {"distance_m": 0.3, "height_m": 0.03, "depth_m": 0.1, "ramp_m": 0.05},
            {"distance_m": 0.8, "height_m": -0.1, "ramp_m": 0.9},
            {"distance_m": 0.4, "height_m": 0.02, "step": -1},
        ],
    },
    "uneven steps": {"stair": {"steps": 4}, "step": [{"index": 1, "rise_m": 0.2, "run_m": 0.5}]},
}


@pytest.mark.parametrize("name", SCENES)
def test_polyline_is_as_high_as_the_solids(name: str) -> None:
    scenario = Scenario.model_validate(SCENES[name])
    staircase = as_designed(scenario.stair, scenario.step, scenario.sill)
    ground = ground_profile(staircase)
    # No place is within 1 mm of a riser. The hole of a missing step has no solid close below the tread before it.
    x_m = np.arange(-1.003, staircase.steps[-1].x_m + 1.0, 0.01)
    z_m = np.interp(x_m, ground[:, 0] + 1e-9 * np.arange(len(ground[:, 0])), ground[:, 1])
    points = np.column_stack([x_m, np.zeros_like(x_m), np.full_like(x_m, 9.0)])
    tops_m = ground_m(stair_surfaces(staircase), points)
    there = tops_m > z_m - 0.2
    np.testing.assert_allclose(z_m[there], tops_m[there], atol=1e-8)
    assert there.mean() > 0.9


def test_polyline_of_sloped_treads_rises_to_the_back_of_each() -> None:
    scenario = Scenario.model_validate({"stair": {"steps": 2, "run_m": 0.3}, "step": [{"index": 0, "tread_slope_deg": 5.0}]})
    ground = ground_profile(as_designed(scenario.stair, scenario.step))
    assert ground[:, 1][3] - ground[:, 1][2] == pytest.approx(0.3 * np.tan(np.radians(5.0)))


def test_floor_and_landing_are_as_long_as_the_simulated_floor() -> None:
    ground = ground_profile(as_designed(Scenario.model_validate({"stair": {"landing_m": 1.0}}).stair))
    assert (ground[:, 0][0], ground[:, 0][-1] - ground[:, 0][-2]) == pytest.approx((-6.0, 6.0))
