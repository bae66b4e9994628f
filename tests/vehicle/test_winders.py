"""Winders: wedge-shaped treads around a newel, in the plan, as solids, at the start, and under a chair in the simulator."""

import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.rotations import rotation_z
from treadline.plant.sensors.camera.solids import solids_of
from treadline.run.resolve import checked as check
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, Stair
from treadline.vehicle.bodies import flipper_turns, vehicle
from treadline.vehicle.stair_solids import stair_boxes, stair_solids, stair_surfaces
from treadline.vehicle.staircase import Staircase, Winders, as_designed
from treadline.vehicle.start_checks import deepest_overlap, placed_parts
from treadline.vehicle.start_pose import standing

KEYS: dict[str, Any] = {"rise_m": 0.16, "run_m": 0.30, "steps": 9, "width_m": 1.2, "landing_m": 3.0, "winders": 3}
PLACES = [{}, {"winder_first": 0}, {"winder_first": 3, "winder_turn_deg": 60.0}, {"winders": 4, "winder_turn_deg": 180.0}]
CHAIR = read_chair("wheelchair")


def build(**keys: Any) -> Staircase:
    return as_designed(Stair.model_validate(KEYS | keys))


def plan_of(staircase: Staircase) -> Winders:
    return staircase.winders


def ends_W(staircase: Staircase) -> np.ndarray:
    """Return the inner and outer ends of the nosings from the first winder to the step above the last one."""
    plan = plan_of(staircase)
    half = 0.5 * staircase.width_m
    ends = []
    for index in range(plan.first, plan.after + 1):
        flight = 0 if plan.holds(index) else 1
        R_WF, p_WF = staircase.flight_frame(flight)
        step = staircase.steps[index]
        along = rotation_z(step.yaw_rad) @ np.array([0.0, plan.side * half, 0.0])
        ends.append([p_WF + R_WF @ (step.nosing_F + end) for end in (along, -along)])
    return np.array(ends)


def heights_at(staircase: Staircase, places: np.ndarray) -> np.ndarray:
    """Return the height of the highest tread, landing or floor at each place."""
    heights = np.full(len(places), -math.inf)
    for cx, cy, c, s, half_length, half_width, height, _ in stair_surfaces(staircase):
        dx, dy = places[:, 0] - cx, places[:, 1] - cy
        inside = (np.abs(c * dx + s * dy) <= half_length + 1e-9) & (np.abs(c * dy - s * dx) <= half_width + 1e-9)
        heights = np.where(inside, np.maximum(heights, height), heights)
    return heights


def places_on(staircase: Staircase, radii: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return places on the winders: distance from the newel's axis, and turn in winders."""
    plan, ends = plan_of(staircase), ends_W(staircase)
    centre = ends[0, 0] + np.array([0.0, plan.side * plan.newel_m, 0.0])
    turned = plan.step_rad * shares
    return centre + plan.side * radii[:, None] * np.stack([np.sin(turned), -np.cos(turned), np.zeros_like(turned)], axis=1)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("keys", PLACES)
def test_nosings_meet_the_newel_and_turn_by_equal_angles(keys: dict[str, Any], side: str) -> None:
    staircase = build(winder_to=side, newel_m=0.12, **keys)
    plan, ends = plan_of(staircase), ends_W(staircase)
    centre = np.array([*(ends[0, 0] + np.array([0.0, plan.side * 0.12, 0.0]))[:2], 0.0])
    radii = np.linalg.norm((ends - centre)[..., :2], axis=-1)
    np.testing.assert_allclose(radii, [[0.12, 1.32]] * len(ends), atol=1e-12)
    courses = [math.atan2(*(outer - inner)[:2]) for inner, outer in ends]
    turns = [(b - a + math.pi) % (2.0 * math.pi) - math.pi for a, b in pairwise(courses)]
    np.testing.assert_allclose(turns, [-plan.step_rad] * plan.count, atol=1e-12)
    # The depth of a winder is its going at mid-width.
    going = np.linalg.norm(np.diff(ends.mean(axis=1), axis=0)[..., :2], axis=-1)
    np.testing.assert_allclose(going, [staircase.steps[i].depth_m for i in range(plan.first, plan.after)], atol=1e-12)


@pytest.mark.parametrize("keys", PLACES)
def test_each_winder_is_one_rise_higher_and_the_others_are_as_without_winders(keys: dict[str, Any]) -> None:
    staircase = build(**keys)
    np.testing.assert_allclose(np.diff(staircase.nosings_W[:, 2]), 0.16, atol=1e-12)
    plain = as_designed(Stair.model_validate(KEYS | {"winders": 0}))
    plan = plan_of(staircase)
    np.testing.assert_allclose(staircase.nosings_W[: plan.first + 1], plain.nosings_W[: plan.first + 1], atol=1e-12)
    # Above the winders the flight goes straight on in its new course.
    above = staircase.nosings_W[plan.after :]
    course = rotation_z(plan.turn_rad) @ np.array([0.30, 0.0, 0.0])
    np.testing.assert_allclose(
        above - above[0], [k * np.array([course[0], course[1], 0.16]) for k in range(len(above))], atol=1e-12
    )


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("keys", PLACES)
def test_between_two_nosings_one_stands_on_the_lower_tread_alone(keys: dict[str, Any], side: str) -> None:
    """Test: 2000 places between newel and outer ends. Expected: the height of the nosing before; no gap, and no tread above."""
    staircase = build(winder_to=side, **keys)
    plan, rng = plan_of(staircase), np.random.default_rng(5)
    radii = plan.newel_m + staircase.width_m * rng.uniform(0.001, 0.999, 2000)
    shares = rng.uniform(0.0, plan.count, 2000)
    expected = np.array([step.z_m for step in staircase.steps])[plan.first + shares.astype(int)]
    np.testing.assert_allclose(heights_at(staircase, places_on(staircase, radii, shares)), expected, atol=1e-9)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("keys", PLACES)
def test_newel_and_walls_stand_beside_the_treads_and_not_on_them(keys: dict[str, Any], side: str) -> None:
    staircase = build(winder_to=side, walls="both", **keys)
    plan, rng = plan_of(staircase), np.random.default_rng(6)
    walls = [box for box in stair_boxes(staircase) if box.kind == "wall"]
    assert len(walls) >= 2 * plan.count
    places = places_on(staircase, plan.newel_m + 1.2 * rng.uniform(1e-4, 0.9999, 2000), rng.uniform(0.0, plan.count, 2000))
    places[:, 2] = 0.5
    for wall in walls:
        in_wall = np.abs((places - np.array(wall.centre_W)) @ wall.R_WK)
        assert not (in_wall < np.array(wall.half_m)).all(axis=1).any()


def test_the_newel_fills_its_circle_to_within_a_winders_sagitta() -> None:
    staircase = build(walls="none")
    posts = [box for box in stair_boxes(staircase) if box.kind == "wall"]
    radii = np.full(360, 0.1 * math.cos(0.5 * plan_of(staircase).step_rad) - 1e-6)
    places = places_on(staircase, radii, np.linspace(0.0, 3.0, 360))
    places[:, 2] = 0.5
    filled = [(np.abs((places - np.array(post.centre_W)) @ post.R_WK) <= np.array(post.half_m)).all(axis=1) for post in posts]
    assert np.any(filled, axis=0).all()


def test_camera_and_plant_have_the_nosing_of_each_winder() -> None:
    staircase = build()
    plan = plan_of(staircase)
    bars = {solid.nosing.index: solid.nosing for solid in stair_solids(staircase) if solid.nosing is not None}
    drawn = {solid.index: solid for solid in solids_of(stair_boxes(staircase)) if solid.kind == "step"}
    housed_m = 0.1 * (1.0 - math.cos(plan.step_rad))
    for index, (inner, outer) in enumerate(ends_W(staircase)[:-1], start=plan.first):
        along = (inner - outer) / 1.2
        # The inner end of a nosing is housed in the newel.
        corners_K = drawn[index].half_m * np.array([[-1, 1, 1], [-1, -1, 1]])
        edge = drawn[index].centre_W + corners_K @ drawn[index].R_WK.T
        np.testing.assert_allclose(edge, [inner + housed_m * along, outer], atol=1e-12)
        # The plant's bar lies one radius of 10 mm behind and below that edge.
        bar = bars[index]
        inward = 0.01 * (drawn[index].R_WK[:, 0] - np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose([bar.left_W, bar.right_W], edge + inward, atol=1e-12)


def test_places_along_the_stair_are_the_same_in_both_frames_at_the_middle_of_the_winders() -> None:
    staircase = build(winder_first=2)
    plan, ends = plan_of(staircase), ends_W(staircase)
    centre = ends[0, 0] + np.array([0.0, plan.newel_m, 0.0])
    corner = centre + rotation_z(0.5 * plan.turn_rad) @ np.array([0.0, -plan.walking_radius_m, 0.1])
    along = [offset_m + R_WS[:, 0] @ (corner - p_WS) for R_WS, p_WS, offset_m in (staircase.stair_frame(k) for k in (0, 1))]
    # S is inclined: its x counts height by sin β, which the origin of the upper S has in full.
    assert along[0] == pytest.approx(along[1], abs=1e-12)


def test_check_refuses_winders_and_names_their_place_and_depths() -> None:
    report = check(Scenario.model_validate({"stair": KEYS | {"winder_to": "right"}}), CHAIR)
    (reason,) = report.reasons
    assert reason.startswith(
        "3 winders from step 5 on turn the flight by 90° to the right, 0.05 m deep at the newel and 0.67 m at the outer side: "
    )


@pytest.mark.parametrize(
    ("first", "step", "said"),
    [
        (8, 9, "the tracks would start on winders, steps 8 to 10; start at step 8 or below, or at 14 or above"),
        (0, 4, "the tracks would start on winders, steps 0 to 2; start at step 6 or above"),
        (8, 8, None),
        (0, 6, None),
    ],
)
def test_a_start_on_winders_is_refused_and_the_nearest_straight_start_is_not(first: int, step: int, said: str | None) -> None:
    tables = {"stair": KEYS | {"steps": 20, "winder_first": first}, "start": {"place": "flight", "step": step}}
    scenario = Scenario.model_validate(tables)
    with nullcontext() if said is None else pytest.raises(MechanicsError, match=said):
        assert [reason for reason in check(scenario, CHAIR).reasons if "winders from" not in reason] == []


def test_a_chair_that_is_put_down_above_the_winders_is_on_the_turned_flight() -> None:
    tables = {"stair": KEYS | {"steps": 20, "winder_first": 2}, "start": {"place": "flight", "step": 12, "heading_deg": 5.0}}
    scenario = Scenario.model_validate(tables)
    staircase = as_designed(scenario.stair)
    put = standing(staircase, CHAIR.tracks, scenario.start)
    assert staircase.flight_at(put.p_WB, put.R_WB) == 1
    R_WS, _, _ = staircase.stair_frame(1)
    np.testing.assert_allclose(R_WS.T @ put.R_WB, rotation_z(5.0 * DEG), atol=1e-12)


@pytest.mark.parametrize(
    ("place", "moved_m", "aside_m", "into"),
    [("flight", 0.68, 0.0, None), ("flight", 1.7, 0.0, "step"), ("floor", 0.635, 0.3, "wall"), ("floor", 0.635, 0.0, None)],
)
def test_a_chair_put_down_into_the_newel_or_into_a_winder_overlaps_it(
    place: str, moved_m: float, aside_m: float, into: str | None
) -> None:
    """Test: a chair on the plane of the nosings, or on the floor, moved forward. Expected: the flipper meets winder or newel."""
    tables = {
        "stair": KEYS | {"steps": 20, "winder_first": 12 if place == "flight" else 0, "walls": "none"},
        "start": {"place": place, "step": 8},
    }
    scenario = Scenario.model_validate(tables)
    staircase = as_designed(scenario.stair)
    put = standing(staircase, CHAIR.tracks, scenario.start)
    moved = replace(put, p_WB=put.p_WB + put.R_WB @ np.array([moved_m, aside_m, 0.0]))
    parts = placed_parts(vehicle(CHAIR, scenario.chair), moved, flipper_turns(CHAIR))
    found = deepest_overlap(parts, staircase)
    deep = found is not None and found.depth_m > 0.02
    assert deep == (into is not None)
    assert found is None or not deep or found.into == into
