"""``[[step]]`` tables: what is written stands in the world, and what cannot be built is refused in one line."""

import math
from typing import Any

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.plant.sensors.camera.solids import solids_of
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box, stair_boxes, stair_solids
from treadline.vehicle.staircase import Staircase, build_staircase

# Literals, so that a changed value in the code is detected here.
TREAD_THICKNESS_M = 0.04


def build(*steps: dict[str, Any], seed: int = 1, **stair: Any) -> Staircase:
    scenario = Scenario.model_validate({"stair": {"rise_m": 0.16, "steps": 8, "width_m": 1.2} | stair, "step": list(steps)})
    return build_staircase(scenario.stair, np.random.default_rng(seed), scenario.step)


def boxes_of(staircase: Staircase, index: int) -> list[Box]:
    return [box for box in stair_boxes(staircase) if box.index == index]


def corner_W(box: Box, x: float, z: float) -> np.ndarray:
    """Return a corner at mid-width: x, z are signs."""
    return np.array(box.centre_W) + box.R_WK @ (np.array(box.half_m) * (x, 0.0, z))


def test_a_first_and_a_last_riser_move_all_that_is_above_them() -> None:
    plain, odd = build(), build({"index": 0, "rise_m": 0.21}, {"index": -1, "rise_m": 0.11})
    moved = [after.z_m - before.z_m for before, after in zip(plain.steps, odd.steps, strict=True)]
    np.testing.assert_allclose(moved, [0.05] * 7 + [0.0], atol=1e-12)
    assert [step.x_m for step in odd.steps] == [step.x_m for step in plain.steps]


def test_a_run_moves_all_that_follows_and_the_landing_between_flights_stays_as_deep() -> None:
    plain, odd = build(flights=2), build({"index": 2, "run_m": 0.35}, flights=2)
    moved = [after.x_m - before.x_m for before, after in zip(plain.steps, odd.steps, strict=True)]
    np.testing.assert_allclose(moved, [0.0] * 3 + [0.05] * 13, atol=1e-12)
    assert odd.steps[7].depth_m == plain.steps[7].depth_m == 2.5


def test_an_override_replaces_jitter_and_leaves_the_other_steps_draws() -> None:
    jitter = {"rise_jitter_m": 0.005, "nosing_yaw_jitter_deg": 1.0}
    plain, odd = build(**jitter), build({"index": 3, "rise_m": 0.2, "yaw_deg": 4.0}, **jitter)
    assert odd.steps[3].rise_m == 0.2
    assert odd.steps[3].yaw_rad == pytest.approx(4.0 * DEG)
    for i in (0, 1, 2, 4, 5, 6, 7):
        assert (odd.steps[i].rise_m, odd.steps[i].yaw_rad) == (plain.steps[i].rise_m, plain.steps[i].yaw_rad)


def test_run_jitter_has_the_requested_standard_deviation_and_draws_nothing_without() -> None:
    staircase = build(steps=2000, run_jitter_m=0.015)
    # 2000 draws know a standard deviation to 1.6 %; 8 % is five sigma.
    assert np.std(np.diff([step.x_m for step in staircase.steps])) == pytest.approx(0.015, rel=0.08)
    rng = np.random.default_rng(3)
    build_staircase(Scenario().stair, rng)
    untouched = np.random.default_rng(3)
    untouched.standard_normal(2 * 20)
    assert rng.random() == untouched.random()


def test_an_overhanging_tread_is_a_slab_before_its_riser() -> None:
    slab, riser = boxes_of(build({"index": 3, "overhang_m": 0.035}), 3)
    assert (slab.kind, riser.kind) == ("step", "riser")
    assert corner_W(slab, -1, 1)[0] == pytest.approx(0.9)
    assert corner_W(riser, -1, 1)[0] == pytest.approx(0.935)
    assert 2.0 * slab.half_m[2] == pytest.approx(TREAD_THICKNESS_M)
    # The riser goes on where the slab ends, and down to below the tread before.
    assert corner_W(riser, -1, 1)[2] == pytest.approx(corner_W(slab, -1, -1)[2])
    assert corner_W(riser, -1, -1)[2] < 3 * 0.16


@pytest.mark.parametrize("slope_deg", [-2.0, 2.0, 5.0])
def test_a_sloping_tread_turns_about_its_nosing(slope_deg: float) -> None:
    (box,) = boxes_of(build({"index": 3, "tread_slope_deg": slope_deg}), 3)
    np.testing.assert_allclose(corner_W(box, -1, 1), [0.9, 0.0, 0.64], atol=1e-12)
    along = corner_W(box, 1, 1) - corner_W(box, -1, 1)
    assert math.degrees(math.atan2(along[2], along[0])) == pytest.approx(slope_deg)


def test_a_worn_nosing_is_rounder_than_the_others() -> None:
    found = {
        solid.nosing.index: solid.nosing.radius_m
        for solid in stair_solids(build({"index": 2, "nosing_radius_m": 0.03}))
        if solid.nosing
    }
    assert found == {i: 0.03 if i == 2 else 0.01 for i in range(8)}


def test_winders_leave_no_gap_between_their_treads() -> None:
    staircase = build({"index": -3, "yaw_deg": 4}, {"index": -2, "yaw_deg": 8}, {"index": -1, "yaw_deg": 20})
    by_index = {box.index: box for box in stair_boxes(staircase) if box.kind in ("step", "landing")}
    for index in (4, 5, 6):
        ahead = staircase.steps[index + 1]
        for aside in (-0.6, 0.0, 0.6):
            nosing_W = np.array([ahead.x_m, 0.0, 0.0]) + aside * np.array([-math.sin(ahead.yaw_rad), math.cos(ahead.yaw_rad), 0.0])
            box = by_index[index]
            along = (box.R_WK.T @ (nosing_W - np.array(box.centre_W)))[0]
            assert along <= box.half_m[0] + 1e-9


def test_camera_and_plant_stand_on_the_same_boxes() -> None:
    """Test: sloping, overhanging, turned. Expected: the camera's solids are the staircase's boxes, the plant's begin one nosing
    radius behind the same front edge."""
    staircase = build({"index": 3, "tread_slope_deg": 2.0, "yaw_deg": 5.0}, {"index": 4, "overhang_m": 0.03})
    boxes = stair_boxes(staircase)
    for box, drawn, stood in zip(boxes, solids_of(boxes), stair_solids(staircase), strict=True):
        np.testing.assert_array_equal(drawn.centre_W, box.centre_W)
        np.testing.assert_array_equal(drawn.R_WK, box.R_WK)
        radius = 0.01 if stood.nosing else 0.0
        np.testing.assert_allclose(corner_W(stood.box, -1, 1) - box.R_WK @ [radius, 0, 0], corner_W(box, -1, 1), atol=1e-12)


def test_a_wall_at_the_end_stands_on_the_landing_and_closes_it() -> None:
    staircase = build(end_wall=True, landing_m=2.0, walls="none")
    (wall,) = (box for box in stair_boxes(staircase) if box.kind == "wall")
    assert wall.centre_W[0] - wall.half_m[0] == pytest.approx(staircase.steps[-1].x_m + 2.0)
    assert wall.centre_W[2] - wall.half_m[2] == pytest.approx(staircase.steps[-1].z_m)
    assert 2.0 * wall.half_m[1] == pytest.approx(1.2)


def test_frictions_go_to_the_halves_they_name() -> None:
    staircase = build(
        {"index": 1, "friction": [0.36, 0.3]},
        {"index": 2, "friction_left": [0.4, 0.3]},
        friction=[0.8, 0.5],
        friction_right=[0.6, 0.5],
    )
    assert [step.friction for step in staircase.steps[:3]] == [
        ((0.8, 0.5), (0.6, 0.5)),
        ((0.36, 0.3), (0.36, 0.3)),
        ((0.4, 0.3), (0.6, 0.5)),
    ]
