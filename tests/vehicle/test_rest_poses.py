"""Rest poses: against statics by hand, and invariance of what does not depend on the description."""

import math

import numpy as np
import pytest
from chairs import CHAIR, with_piece
from hypothesis import given, settings
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Stair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import RestChair, rest_chair
from treadline.vehicle.staircase import build_staircase

LEVEL = np.array([[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
HALF_M, RADIUS_M, FLIPPER_M = 0.475, 0.07, 0.45
"""Half of the flat run, radius of the pulleys and length of the flipper of the shipped wheelchair."""
RESOLVED_RAD = 0.005 * DEG
"""Twice the pitch to which a rest pose is found: 0.5° halved eight times."""


def flight(rise_m: float = 0.16, run_m: float = 0.30, steps: int = 8) -> np.ndarray:
    stair = Stair(rise_m=rise_m, run_m=run_m, steps=steps, nosing_radius_m=0.002)
    return ground_profile(build_staircase(stair, np.random.default_rng(0)))


def driven(chair: RestChair, ground: np.ndarray, start_m: float, end_m: float, angle_rad: float) -> list:
    """Return the poses of a chair that is moved over a ground in steps of a centimetre."""
    pose = chair.at(ground, start_m, (angle_rad,), 0.0)
    places = np.linspace(start_m, end_m, round(abs(end_m - start_m) / 0.01) + 1)
    return [pose := chair.moved(ground, pose, float(x), (angle_rad,))[0] for x in places]


@given(payload=st.floats(0.0, 120.0), angle=st.floats(2.0, 60.0), x=st.floats(-3.0, 3.0), ahead=st.floats(-0.2, 0.2))
@settings(max_examples=50)
def test_on_a_level_floor_the_shares_are_those_of_a_beam_on_two_supports(
    payload: float, angle: float, x: float, ahead: float
) -> None:
    chair = rest_chair(CHAIR, payload, offset_m=(ahead, 0.0, 0.0))
    pose = chair.at(LEVEL, x, (angle * DEG,), 0.1)
    com = centre_of_mass(CHAIR, Chair(payload_kg=payload, payload_offset_m=(ahead, 0.0, 0.0)), 0.0, angle * DEG)
    assert pose.pitch_rad == pytest.approx(0.0, abs=RESOLVED_RAD)
    assert (pose.front_m[0] - x, pose.rear_m[0] - x) == pytest.approx((HALF_M, -HALF_M), abs=1e-4)
    assert pose.front_share == pytest.approx((com[0] + HALF_M) / (2.0 * HALF_M), abs=1e-3)
    # Within 2° of turning the contact rolls on by 2.5 mm of the rear pulley, of 0.2 m height of an empty chair 0.7°.
    assert pose.rear_margin_rad == pytest.approx(math.atan2(com[0] + HALF_M, com[2]), abs=0.7 * DEG)
    assert pose.friction == 0.0
    assert pose.torques_n_m == (0.0,)


@pytest.mark.parametrize(("rise_m", "run_m"), [(0.12, 0.35), (0.16, 0.30), (0.19, 0.28)])
def test_on_a_flight_the_chair_lies_along_its_nosings_and_needs_the_friction_of_its_slope(rise_m: float, run_m: float) -> None:
    poses = driven(rest_chair(CHAIR, 60.0), flight(rise_m, run_m), -1.2, 1.5, 20.0 * DEG)
    assert poses[-1].pitch_rad == pytest.approx(math.atan2(rise_m, run_m), abs=0.1 * DEG)  # nosings rounded by 2 mm
    assert poses[-1].friction == pytest.approx(rise_m / run_m, rel=0.01)


def test_over_a_kerb_the_pitch_is_that_of_a_line_from_the_floor_over_its_nosing() -> None:
    """Test: a kerb of 0.15 m, the rear pulley on the floor. Expected result: its axis a radius above the floor, and the belts'
    lower line through the nosing: the circle of the pulley touches both, asin and atan of the triangle."""
    ground = np.array([[-9.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.15, 0.0], [9.0, 0.15, 0.0]])
    chair = rest_chair(CHAIR, 60.0)
    for pose in driven(chair, ground, -1.2, -0.08, 40.0 * DEG):
        if pose.rear_m[1] > 0.0 or pose.front_m != (0.0, 0.15) or pose.parts[0] != 0:
            continue
        axis_m = pose.x_m - HALF_M * math.cos(pose.pitch_rad) - RADIUS_M * math.sin(pose.pitch_rad)
        behind_m, above_m = -axis_m, 0.15 - RADIUS_M
        along_m = math.sqrt(behind_m**2 + above_m**2 - RADIUS_M**2)
        if along_m > 2.0 * HALF_M:  # the nosing is under the front pulley, beyond the flat run
            continue
        expected = math.atan2(above_m, behind_m) + math.atan2(RADIUS_M, along_m)
        assert pose.pitch_rad == pytest.approx(expected, abs=0.02 * DEG)


def test_a_tip_on_the_ground_bears_by_the_lever_rule_and_its_motor_the_moment() -> None:
    """Test: on a floor, the flipper 20° down: rear pulley and tip touch, 1.85 m of chair like a beam."""
    chair = rest_chair(CHAIR, 60.0)
    pose = chair.at(LEVEL, 0.0, (-20.0 * DEG,), 0.0)
    pitch = pose.pitch_rad
    tip_m = HALF_M * math.cos(pitch) - RADIUS_M * math.sin(pitch) + FLIPPER_M * math.cos(pitch - 20.0 * DEG)
    rear_m = -HALF_M * math.cos(pitch) - RADIUS_M * math.sin(pitch)
    # Both pulleys' axes are a radius above the floor.
    assert 2.0 * HALF_M * math.sin(pitch) == pytest.approx(FLIPPER_M * math.sin(20.0 * DEG - pitch), abs=1e-4)
    assert (pose.front_m[0], pose.rear_m[0]) == pytest.approx((tip_m, rear_m), abs=1e-3)
    share = (pose.com_m[0] - rear_m) / (tip_m - rear_m)
    assert pose.front_share == pytest.approx(share, abs=1e-3)
    lever_m = FLIPPER_M * math.cos(pitch - 20.0 * DEG)
    assert pose.torques_n_m[0] == pytest.approx(share * chair.weight_n * lever_m, rel=2e-3)  # no friction on the level


def test_a_place_has_two_rest_poses_and_a_move_keeps_to_its_own() -> None:
    """Test: the weight near the last nosing, the flipper down: the chair lies back on the flight, or forward on its tip."""
    chair, ground = rest_chair(CHAIR, 60.0), flight()
    found = {round(chair.at(ground, 2.05, (-20.0 * DEG,), pitch * DEG).pitch_rad / DEG, 1) for pitch in range(0, 40, 2)}
    assert len(found) >= 2
    for pitch in found:
        pose = chair.at(ground, 2.05, (-20.0 * DEG,), pitch * DEG)
        after, fall = chair.moved(ground, pose, 2.051, (-20.0 * DEG,))
        assert fall is None
        assert after.pitch_rad == pytest.approx(pose.pitch_rad, abs=0.3 * DEG)


def test_a_chair_without_its_flipper_falls_over_a_crest_by_the_slope() -> None:
    """Test: the flipper up. Expected result: one fall, of 28° or nearly; a point mass 0.5 m from the nosing that has sunk by h
    turns with √(2 g h) / 0.5 m."""
    chair, ground = rest_chair(CHAIR, 60.0), flight()
    pose = chair.at(ground, 1.2, (40.0 * DEG,), 28.0 * DEG)
    falls = []
    for x in np.arange(1.21, 2.6, 0.01):
        pose, fall = chair.moved(ground, pose, float(x), (40.0 * DEG,))
        falls += [] if fall is None else [fall]
    (fall,) = falls
    assert fall.angle_rad == pytest.approx(math.atan2(0.16, 0.30), abs=2.0 * DEG)
    assert fall.rate_rad_s == pytest.approx(math.sqrt(2.0 * 9.81 * fall.drop_m) / 0.5, rel=0.5)
    assert fall.rate_rad_s > 60.0 * DEG


def test_a_flipper_that_presses_the_front_up_is_no_fall() -> None:
    chair = rest_chair(CHAIR, 60.0)
    pose = chair.at(LEVEL, 0.0, (10.0 * DEG,), 0.0)
    for angle in range(10, -60, -1):
        pose, fall = chair.moved(LEVEL, pose, 0.0, (angle * DEG,))
        assert fall is None
    assert pose.pitch_rad > 10.0 * DEG


def test_belts_that_meet_a_wall_stop_before_it() -> None:
    """Test: a riser of 0.3 m, the flipper up beyond it by its range. Expected result: the front pulley's belt at the riser."""
    ground = np.array([[-9.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.6, 0.0], [9.0, 0.6, 0.0]])
    chair = rest_chair(CHAIR, 60.0)
    pose = chair.at(ground, -1.5, (60.0 * DEG,), 0.0)
    after, _ = chair.moved(ground, pose, -0.2, (60.0 * DEG,))
    assert after.x_m == pytest.approx(-HALF_M - RADIUS_M - FLIPPER_M * math.cos(60.0 * DEG), abs=0.1)
    assert after.pitch_rad == pytest.approx(0.0, abs=0.5 * DEG)


def test_a_profile_on_which_the_chair_cannot_stand_is_an_error_in_one_line() -> None:
    cliff = np.array([[-9.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0001, -9.0, 0.0], [9.0, -9.0, 0.0]])
    with pytest.raises(MechanicsError, match=r"cannot stand with its middle at 0\.10 m: it would turn over") as found:
        rest_chair(CHAIR, 60.0).at(cliff, 0.1, (0.0,), 0.0)
    assert "\n" not in str(found.value)


@given(shift=st.floats(-2.0, 2.0), x=st.floats(-1.0, 3.0), angle=st.floats(-60.0, 40.0))
@settings(max_examples=40)
def test_a_ground_that_is_moved_with_the_chair_changes_nothing(shift: float, x: float, angle: float) -> None:
    chair, ground = rest_chair(CHAIR, 60.0), flight()
    here = chair.at(ground, x, (angle * DEG,), 0.2)
    there = chair.at(ground + np.array([shift, shift, 0.0]), x + shift, (angle * DEG,), 0.2)
    assert there.pitch_rad == pytest.approx(here.pitch_rad, abs=RESOLVED_RAD)
    assert there.height_m - here.height_m == pytest.approx(shift, abs=1e-4)


def test_a_stronger_flipper_never_lowers_the_margin_and_a_fixed_nose_needs_none() -> None:
    found = [
        rest_chair(with_piece("flipper", torque_n_m=torque), 100.0).least_margins(0.16, 0.30, (0.0,))[0]
        for torque in (1.0, 50.0, 100.0, 200.0, 400.0)
    ]
    assert found == sorted(found)
    assert found[-1] > found[0] + 5.0 * DEG
    fixed = rest_chair(read_chair("wheelchair-fixed"), 100.0)
    assert fixed.least_margins(0.16, 0.30, (0.0,)) == fixed.least_margins(0.16, 0.30, (1.0,))


@pytest.mark.parametrize(("slope_deg", "least_deg"), [(25, 12.0), (28, 9.5), (30, 7.8)])
def test_downhill_a_long_flight_leaves_more_than_the_nosings_that_touch_at_every_phase(slope_deg: int, least_deg: float) -> None:
    """Test: the fixed chair with 50 kg. Expected result: at the worst phase the rear stands a pitch ahead of its end, by a plumb
    line on paper; ground within 2° of turning counts too, and adds at most what the rear pulley turns on a nosing by 2°."""
    chair = rest_chair(read_chair("wheelchair-fixed"), 50.0)
    found = chair.least_margins(0.30 * math.tan(slope_deg * DEG), 0.30, (0.0,))[1] / DEG
    assert least_deg - 0.05 <= found <= least_deg + 4.0
