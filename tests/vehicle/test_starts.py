"""A start inside something, or half over an edge, is refused with how deep and what to do; ``climb`` asks the same."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.errors import MechanicsError
from treadline.core.rotations import rotation_z
from treadline.run.resolve import checked as check
from treadline.run.resolve import ready
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box
from treadline.vehicle.start_checks import PlacedPart, depth_of_overlap

CHAIR = read_chair("wheelchair")


def reasons(**tables: Any) -> list[str]:
    scenario = Scenario.model_validate(tables)
    report = check(scenario, CHAIR)
    # What check refuses is not run: both go by one verdict.
    assert (ready(scenario, report)[1] is None) == (report.verdict == "go")
    return report.reasons


def test_a_section_of_the_tracks_inside_a_wall_is_refused() -> None:
    """Test: heading 30° on a flight of 1.4 m, where the flat run just fits; with walls and without."""
    start = {"place": "flight", "step": 6, "heading_deg": 22}
    stair = {"slope_deg": 25, "width_m": 1.25, "steps": 14}
    assert reasons(stair=stair | {"walls": "none"}, start=start) == []
    with pytest.raises(
        MechanicsError, match=r"the (tip of the )?flipper on the left would start 0\.\d\d m inside a wall; start squarer, "
    ):
        reasons(stair=stair | {"walls": "both"}, start=start)


def test_a_start_just_beside_a_wall_may_be() -> None:
    # 0.8 m between walls, a chair 0.75 m wide: 25 mm free on either side, or 22 and 28.
    stair = {"slope_deg": 25, "width_m": 0.8, "walls": "both"}
    for lateral_m in (0.0, 0.003, -0.003):
        assert reasons(stair=stair, start={"place": "flight", "step": 6, "lateral_m": lateral_m}) == []


def test_a_start_over_the_edge_of_a_landing_is_refused() -> None:
    tables: dict[str, Any] = {"stair": {"slope_deg": 25, "width_m": 3.0, "landing_m": 1.16}, "drive": {"direction": "down"}}
    assert not any("a track would start" in said for said in reasons(**tables, start={"place": "landing", "heading_deg": 0}))
    # The landing leaves 0.2 m before the rear pulley; turned by 80° a belt's end is 0.325·sin 80° = 0.32 m nearer the edge.
    over_m = 0.325 * math.sin(math.radians(80.0)) - 0.2
    with pytest.raises(MechanicsError, match=f"a track would start {over_m:.2f} m over an edge of the landing; start squarer"):
        reasons(**tables, start={"place": "landing", "heading_deg": 80})


def test_a_high_step_ahead_of_the_start_is_met_by_the_flipper_planner() -> None:
    """Test: the next riser 0.35 m high, the front pulley 0.12 m before it. Expected: refused, the step is named."""
    tables: dict[str, Any] = {"stair": {"slope_deg": 25, "steps": 14}, "start": {"place": "flight", "step": 7}}
    assert reasons(**tables) == []
    with pytest.raises(MechanicsError, match="inside the step 8"):
        reasons(**tables, step=[{"index": 7, "run_m": 0.12}, {"index": 8, "rise_m": 0.35}])


def test_a_step_so_long_that_the_chair_would_drop_is_refused() -> None:
    """Test: one tread of 1.2 m in a flight. Expected: the track of 0.95 m cannot touch two nosings there; 0.33 m may be."""
    tables: dict[str, Any] = {"stair": {"slope_deg": 20, "steps": 14}}
    assert reasons(**tables, step=[{"index": 6, "run_m": 0.33}]) == []
    (found,) = reasons(**tables, step=[{"index": 6, "run_m": 1.2}])
    assert re.search(r"at nosing \d, .*; ", found)


BOX = Box(kind="wall", index=-1, centre_W=(1.0, 0.0, 0.0), half_m=(0.5, 0.2, 0.3), yaw_rad=0.0)
PART = PlacedPart(name="hull", centre_W=np.zeros(3), half_m=np.array([0.4, 0.1, 0.1]), R_WK=np.eye(3))


@pytest.mark.parametrize("x_m", [0.0, 0.09, 0.3])
def test_the_depth_of_an_overlap_is_the_way_out(x_m: float) -> None:
    moved = replace(PART, centre_W=np.array([x_m, 0.0, 0.0]))
    # 0.1 m apart at x = 0; across, the way out is 0.2 + 0.1 m.
    assert depth_of_overlap(moved, BOX) == pytest.approx(min(x_m - 0.1, 0.3), abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_depth_of_an_overlap_is_independent_of_world_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw = float(rng.uniform(-3.0, 3.0))
    R = rotation_z(yaw)
    turned = replace(PART, R_WK=R @ rotation_z(0.4), centre_W=R @ np.array([0.3, 0.1, 0.0]))
    x, y, z = R @ np.array(BOX.centre_W)
    box = replace(BOX, centre_W=(float(x), float(y), float(z)), yaw_rad=yaw)
    still = replace(PART, R_WK=rotation_z(0.4), centre_W=np.array([0.3, 0.1, 0.0]))
    assert depth_of_overlap(turned, box) == pytest.approx(depth_of_overlap(still, BOX), abs=1e-12)
