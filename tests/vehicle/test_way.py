"""The way: quiet where a quiet way is, alike both ways, and hardly dependent on its grid."""

import math
from typing import Any

import numpy as np
import pytest
from chairs import CHAIR

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.scenario import Scenario
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import rest_chair
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.way import PlannedWay, find_way

RANGE_RAD = (-75.0 * DEG, 60.0 * DEG)
HALF_M, REST_RAD = 0.475, 40.0 * DEG
"""Half of the flat run, and rest angle of the flipper of the shipped wheelchair."""

GROUNDS: dict[str, dict[str, Any]] = {
    "flight": {"stair": {"slope_deg": 28, "steps": 5}},
    "low last riser": {"stair": {"slope_deg": 28, "steps": 5}, "step": [{"index": 4, "rise_m": 0.11}]},
    "high last riser": {"stair": {"slope_deg": 28, "steps": 5}, "step": [{"index": 4, "rise_m": 0.207}]},
    "kerb": {"stair": {"rise_m": 0.15, "steps": 1}},
    "high kerb": {"stair": {"rise_m": 0.20, "steps": 1}},
    "two low steps": {"stair": {"rise_m": 0.06, "run_m": 0.30, "steps": 2}},
    "two long steps": {"stair": {"rise_m": 0.15, "run_m": 0.50, "steps": 2}},
}


def ground_of(tables: dict[str, Any]) -> np.ndarray:
    scenario = Scenario.model_validate(tables)
    return ground_profile(as_designed(scenario.stair, scenario.step))


def way_over(tables: dict[str, Any], *, down: bool, begin_m: float = 0.6, payload_kg: float = 60.0, **options: Any) -> PlannedWay:
    chair, ground = rest_chair(CHAIR, payload_kg), ground_of(tables)
    top_m = float(ground[-2, 0])
    ends = (-HALF_M - begin_m, top_m + HALF_M + begin_m)
    start_m, end_m = reversed(ends) if down else ends
    way = find_way(chair, ground, chair.at(ground, start_m, (REST_RAD,), 0.0), end_m, RANGE_RAD, **options)
    assert way is not None
    return way


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("name", GROUNDS)
def test_over_every_ground_a_way_without_a_fall_is_found_that_ten_centimetres_of_weight_do_not_upset(name: str, down: bool) -> None:
    way = way_over(GROUNDS[name], down=down)
    assert way.fall_m_s < 0.02  # the quiet speed: a tenth of a millimetre
    assert math.sqrt(2.0 * 9.81 * way.unknown_m.max()) < 0.2  # two millimetres
    assert way.margin_rad > 5.0 * DEG
    assert way.torque_n_m <= 0.8 * 200.0  # 70 % are free, what is above has a price


@pytest.mark.parametrize("name", ["flight", "kerb", "two low steps"])
def test_up_and_down_are_the_same_poses_where_nothing_falls(name: str) -> None:
    """Test: the same ground both ways. Expected result: a way that is followed along its branches can be gone back: costs within
    the weights' own asymmetry of a grid step."""
    up, down = (way_over(GROUNDS[name], down=down) for down in (False, True))
    assert up.cost_s == pytest.approx(down.cost_s, rel=0.05)
    assert max(pose.pitch_rad for pose in up.poses) == pytest.approx(max(pose.pitch_rad for pose in down.poses), abs=0.5 * DEG)


@pytest.mark.parametrize("options", [{"place_m": 0.0125, "angle_rad": 1.25 * DEG}, {"begin_m": 0.607}])
@pytest.mark.parametrize("name", ["flight", "kerb", "high last riser"])
def test_a_grid_that_is_halved_or_shifted_leaves_pitch_and_fall(name: str, options: dict[str, Any]) -> None:
    coarse, other = way_over(GROUNDS[name], down=False), way_over(GROUNDS[name], down=False, **options)
    highest = [max(pose.pitch_rad for pose in way.poses) for way in (coarse, other)]
    # A step of the flipper, 2.5° at 0.45 m, turns a chair that stands 0.95 m further back by 1.2°.
    assert highest[1] == pytest.approx(highest[0], abs=1.2 * DEG)
    assert other.fall_m_s == pytest.approx(coarse.fall_m_s, rel=0.2, abs=0.005)


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("off_m", [(0.0, 0.006), (0.0, -0.006), (0.006, 0.0), (-0.006, 0.0)])
def test_a_way_followed_blindly_keeps_its_margin_where_the_edge_is_off_by_two_deviations(
    off_m: tuple[float, float], down: bool
) -> None:
    """Test: the last nosing 6 mm up, down or along: twice the deviation of a nosing in view; the follower plans anew from 8 mm.
    Expected result: no fall of more than a tenth of a millimetre, and half a degree of margin lost at most."""
    way = way_over(GROUNDS["flight"], down=down)
    chair, ground = rest_chair(CHAIR, 60.0), ground_of(GROUNDS["flight"])
    last = np.arange(len(ground)) >= len(ground) - 3
    ground = ground + last[:, None] * np.array([*off_m, 0.0])
    pose, margins = way.poses[0], []
    for planned in way.poses[1:]:
        pose, fall = chair.moved(ground, pose, planned.x_m, planned.angles_rad)
        assert fall is None or fall.drop_m < 0.0001
        margins.append(min(pose.front_margin_rad, pose.rear_margin_rad))
    assert min(margins) > way.margin_rad - 0.5 * DEG


def test_only_a_load_that_needs_it_uses_more_than_four_fifths_of_the_torque() -> None:
    light, heavy = (way_over(GROUNDS["high kerb"], down=False, payload_kg=kg) for kg in (60.0, 130.0))
    assert light.torque_n_m <= 160.0
    assert 160.0 < heavy.torque_n_m <= 190.0


def test_a_way_needs_no_more_friction_than_there_is_and_there_is_none_on_ice() -> None:
    ground = ground_of(GROUNDS["flight"])
    chair = rest_chair(CHAIR, 60.0)
    start = chair.at(ground, -1.0, (REST_RAD,), 0.0)
    way = find_way(chair, ground, start, 2.2, RANGE_RAD, friction=0.62)
    assert way is not None
    assert max(pose.friction for pose in way.poses) <= 0.62
    assert find_way(chair, ground, start, 2.2, RANGE_RAD, friction=0.3) is None


def test_without_a_flipper_no_way_leads_quietly_over_a_crest() -> None:
    ground = ground_of(GROUNDS["flight"])
    chair = rest_chair(CHAIR, 60.0)
    way = find_way(chair, ground, chair.at(ground, -1.0, (REST_RAD,), 0.0), 2.2, (REST_RAD, REST_RAD))
    assert way is None or way.fall_m_s > 0.3


def test_a_ground_that_is_not_a_number_is_an_error_in_one_line() -> None:
    ground = ground_of(GROUNDS["kerb"])
    chair = rest_chair(CHAIR, 60.0)
    start = chair.at(ground, -1.0, (REST_RAD,), 0.0)
    uncertain = ground + np.array([0.0, math.nan, 0.0])
    with pytest.raises(MechanicsError, match="not a number; give metres"):
        find_way(chair, uncertain, start, 1.0, RANGE_RAD)
