"""Turn on a landing: the least landing against a sweep of the outline, and the ways against the landing's edges."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.errors import MechanicsError
from treadline.run.resolve import checked
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.landing_turn import least_landing_m, way_over
from treadline.vehicle.landing_turn_kernels import Outline
from treadline.vehicle.start_checks import outline_of

CHAIR = read_chair("wheelchair")
# Measured from outside on grids of 2 and 4 cm (docs of the turn, first table), with 5 cm around the chair.
SQUARES_M = {0.0: 1.90, 40.0: 1.80, 60.0: 1.70, 90.0: 1.50}


def landing(depth_m: float, width_m: float, flight_m: float, turn_deg: float) -> FlightPlan:
    sides = (-0.5 * flight_m, width_m - 0.5 * flight_m)
    right, left = sides if turn_deg > 0.0 else (-sides[1], -sides[0])
    turn_rad = math.radians(turn_deg)
    return FlightPlan(count=1, slope_rad=0.5, turn_rad=turn_rad, depth_m=depth_m, right_m=right, left_m=left)


def outline(flipper_deg: float, around_m: float) -> Outline:
    return outline_of(CHAIR, math.radians(flipper_deg)).wider(around_m)


def least_square_m(chair: Outline) -> float:
    """Return the least square landing with flights as wide as it is."""
    low, high = 1.0, 2.6
    while high - low > 0.004:
        side = 0.5 * (low + high)
        low, high = (low, side) if len(way_over(landing(side, side, side, 90.0), side, chair)) else (side, high)
    return high


def swept_m(chair: Outline) -> float:
    """Return the least square landing for a turn on the spot, by the extent of the corners over all headings."""
    angles = np.radians(np.arange(0.0, 90.1, 0.25))
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y = np.array([[-chair.rear_m, -chair.rear_m, chair.front_m, chair.front_m], [-chair.half_m, chair.half_m] * 2])
    belts_x = np.array([-chair.belts_rear_m, -chair.belts_rear_m]), np.array([-chair.half_belts_m, chair.half_belts_m])
    swept_x, swept_y = c * x - s * y, s * x + c * y
    before_m = -(c * belts_x[0] - s * belts_x[1]).min()
    return float(max(swept_x.max() + before_m, swept_y.max() - swept_y.min()))


@pytest.mark.parametrize(("flipper_deg", "table_m"), SQUARES_M.items())
def test_the_least_square_landing_is_that_of_the_sweep(flipper_deg: float, table_m: float) -> None:
    chair = outline(flipper_deg, 0.05)
    found = least_square_m(chair)
    assert table_m - 0.05 < found <= table_m
    # A drive back and forth saves up to a few centimetres where the chair is longer ahead of its middle than behind.
    assert swept_m(chair) - 0.03 < found < swept_m(chair) + 0.01


@pytest.mark.parametrize(("around_m", "expected_m"), [(0.05, 1.475), (0.09, 1.58)])
def test_with_its_flipper_folded_the_chair_needs_the_stated_square(around_m: float, expected_m: float) -> None:
    assert least_square_m(outline(90.0, around_m)) == pytest.approx(expected_m, abs=0.03)


def test_a_half_landing_is_as_deep_as_a_folded_chair_turns_on_the_spot() -> None:
    # Away from the flight below, the next flight's foot is a wall: the depth is twice the distance of the corners.
    chair = outline(90.0, 0.05)
    assert least_landing_m(landing(1.0, 2.6, 1.3, 180.0), 1.3, chair) == pytest.approx(2.0 * math.hypot(0.595, 0.425), abs=0.02)


@pytest.mark.parametrize("turn_deg", [-180.0, -90.0, 45.0, 90.0, 135.0, 180.0])
def test_a_way_stays_on_the_landing_and_is_made_of_drives_and_turns(turn_deg: float) -> None:
    plan, chair = landing(1.9, 3.0, 1.2, turn_deg), outline(90.0, 0.09)
    way = way_over(plan, 1.2, chair)
    assert way[0].tolist() == pytest.approx([chair.belts_rear_m, 0.0, 0.0])
    assert way[-1, 2] == pytest.approx(math.radians(turn_deg))
    moved, turned = np.diff(way[:, :2], axis=0), np.diff(way[:, 2])
    ahead = np.stack([np.cos(way[:-1, 2]), np.sin(way[:-1, 2])], axis=1)
    across = moved[:, 1] * ahead[:, 0] - moved[:, 0] * ahead[:, 1]
    np.testing.assert_allclose(across, 0.0, atol=1e-12)
    assert (np.hypot(*moved.T) * np.abs(turned) < 1e-12).all()
    for x, y, heading in way:
        c, s = math.cos(heading), math.sin(heading)
        corners = np.array([[a, b] for a in (-chair.rear_m, chair.front_m) for b in (-chair.half_m, chair.half_m)])
        belts = np.array(
            [[a, b] for a in (-chair.belts_rear_m, chair.belts_front_m) for b in (-chair.half_belts_m, chair.half_belts_m)]
        )
        R = np.array([[c, s], [-s, c]])
        corners, belts = corners @ R + [x, y], belts @ R + [x, y]
        assert belts[:, 0].min() > -1e-9
        assert corners[:, 0].max() < plan.depth_m + 1e-9
        assert plan.right_m - 1e-9 < corners[:, 1].min()
        assert corners[:, 1].max() < plan.left_m + 1e-9
        assert not ((corners[:, 0] < 0.0) & (np.abs(corners[:, 1]) > 0.6)).any()


def test_from_any_pose_the_way_begins_there() -> None:
    plan, chair = landing(2.2, 2.2, 1.2, 90.0), outline(90.0, 0.05)
    start = np.array([1.0, 0.3, math.radians(30.0)])
    way = way_over(plan, 1.2, chair, start)
    np.testing.assert_allclose(way[0], start, atol=1e-12)
    assert len(way_over(replace(plan, depth_m=1.3), 1.2, chair, start)) == 0


def check_of(*flights: dict[str, Any], camera: str = "statistical", **tables: Any) -> list[str]:
    return checked(Scenario.model_validate({"flight": list(flights), "sensors": {"model": camera}} | tables), CHAIR).reasons


def test_check_says_which_landing_the_chair_needs() -> None:
    (reason,) = check_of({"steps": 6}, {"steps": 6, "turn_deg": 90.0, "landing_depth_m": 1.2})
    assert reason.startswith("the landing at step 5 is 1.20 m, this chair needs 1.")
    large = {"landing_depth_m": 2.2, "landing_width_m": 2.6}
    assert check_of({"steps": 6}, {"steps": 6, "turn_deg": 180.0} | large) == []


def test_from_the_flight_above_a_way_leads_back_to_the_one_below() -> None:
    plan, chair = landing(2.0, 2.6, 1.2, 90.0), outline(60.0, 0.09)
    start = np.array([1.5, 0.5, math.radians(90.0)])
    way = way_over(plan, 1.2, chair, start, off_m=CHAIR.reach_m)
    assert way[-1, 2] == pytest.approx(0.0, abs=1e-9)
    assert abs(way[-1, 1]) <= 0.6 - chair.half_m + 0.02
    # The guard holds a chair that drives 0.34 m before an edge.
    assert way[-1, 0] - chair.belts_rear_m >= 0.34


def test_the_flight_after_a_turn_is_walked_as_well() -> None:
    turned = {"turn_deg": 90.0, "landing_depth_m": 2.2, "landing_width_m": 2.6}
    (reason,) = check_of({"steps": 5}, {"steps": 5} | turned, step=[{"index": 9, "rise_m": 0.26}])
    assert reason.startswith("at the last nosing")


def test_flights_that_cross_are_one_line() -> None:
    turn = {"steps": 4, "turn_deg": 150.0, "landing_depth_m": 1.8, "landing_width_m": 3.0}
    with pytest.raises(MechanicsError, match=r"flights 0 and 1 cross, less than 2 m above each other; turn one"):
        check_of({"steps": 6}, turn, turn)
