"""Width, sides and bow of a flight, as the detector reports them."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scenes import ViewRecipe
from sights import sights
from surfaces import CAMERA, ends_at, surface

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_z
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception._form import sides_of
from treadline.perception._plane_segmentation import surface_blocks
from treadline.perception._step_parts import Axes


def test_sides_are_where_the_flight_ends() -> None:
    """Test: 24 flights 1.0 to 1.6 m wide, open at both sides. Expected result: sides within 2 cm, most of them seen, all open;
    nosings in view no further than that.

    2 cm: a column of the image 2.5 m away is 9 mm wide, and depth is lost next to an edge.
    """
    errors, kinds, beyond, possible = [], [], [], 0
    for _, truth, sight in sights(ViewRecipe(walls=("none",)), range(46_000, 46_024)):
        declared = sight.stair_map
        if declared is None:
            continue
        possible += 2
        for found, true, kind, seen_m in (
            (declared.left_edge_m, truth.left_edge_m, declared.left_side, declared.left_seen_m),
            (declared.right_edge_m, truth.right_edge_m, declared.right_side, declared.right_seen_m),
        ):
            beyond.append(seen_m - true)
            if found is not None and true is not None:
                errors.append(found - true)
                kinds.append(kind)
    assert len(errors) > 0.5 * possible
    assert np.abs(errors).max() < 0.02
    assert np.mean([kind == "open" for kind in kinds]) > 0.8
    # Nosings are in view up to their end at most.
    assert np.max(beyond) < 0.02


def test_a_flight_narrower_than_the_chair_is_rejected_with_its_width() -> None:
    """Test: flights 45 cm wide, for a chair of 80 cm, a robot of 36 cm and without a chair. Expected result: where both sides are
    seen the chair's frames are rejected with the width, those of the robot and without a chair are not."""
    recipe = ViewRecipe(width_m=(0.45, 0.45), walls=("none",))
    robot, views = [], []
    for view, _, sight in sights(recipe, range(47_000, 47_020), swept_half_m=0.18):
        robot.append(sight)
        views.append(view)
    chair, alone = (
        [StairDetector(DetectorConfig(swept_half_m=half_m)).look(view.frame, view.gravity_C) for view in views]
        for half_m in (0.40, None)
    )
    assert [sight.reason for sight in alone] == [sight.reason for sight in robot]
    narrow = [sight for sight in chair if sight.reason is not None and "m wide" in sight.reason]
    assert len(narrow) >= 0.5 * len(chair)
    assert all("0.4" in str(sight.reason) and "0.80 m" in str(sight.reason) for sight in narrow)
    widths = [sight.stair_map.width_m for sight in robot if sight.stair_map is not None and sight.stair_map.width_m is not None]
    assert len(widths) >= len(narrow)
    assert np.abs(np.array(widths) - 0.45).max() < 0.02


@pytest.mark.parametrize("sensor", ["d435", "d455"])
def test_the_band_that_one_imager_does_not_see_is_no_open_side(sensor: Literal["d435", "d455"]) -> None:
    """Test: stereo frames, without depth in a band at the left border as wide as the disparity. Expected result: flights are not
    called narrow, and a side is reported where the flight ends, or not at all.

    5 cm: half of a matching window of 7 px, 2 m away, next to the 2 cm of other frames.
    """
    sides = []
    for _, truth, sight in sights(ViewRecipe(sensor=sensor, sigma_px=0.12, height_px=480), range(3_000, 3_022)):
        assert "m wide" not in str(sight.reason)
        if (declared := sight.stair_map) is not None:
            sides += [(declared.left_edge_m, truth.left_edge_m), (declared.right_edge_m, truth.right_edge_m)]
    errors = [found - true for found, true in sides if found is not None]
    assert len(errors) > 0.5 * len(sides)
    assert np.abs(errors).max() < 0.05


def test_a_side_that_is_not_seen_is_unknown() -> None:
    """Test: a flight far wider than the view. Expected result: no side, no width."""
    for _, _, sight in sights(ViewRecipe(width_m=(6.0, 6.0), walls=("none",), lateral_m=(-0.1, 0.1)), range(48_000, 48_006)):
        assert sight.stair_map.width_m is None


@pytest.mark.parametrize("bow_m", [0.05, 0.15])
def test_bowed_edges_are_rejected(bow_m: float) -> None:
    """Test: edges bowed by 5 and 15 cm over the flight's width. Expected result: rejected, or a heading inside its interval."""
    frames = [*sights(ViewRecipe(bow_m=(bow_m, bow_m)), range(49_000, 49_024))]
    accepted = [(truth, sight) for _, truth, sight in frames if sight.accepted]
    assert len(accepted) <= (0.25 if bow_m < 0.1 else 0.0) * len(frames)
    for truth, sight in accepted:
        assert abs(sight.heading_rad - truth.heading_rad) < 3.0 * sight.sigma_rad


@pytest.mark.parametrize("roll_deg", [0.0, 60.0, 90.0, 180.0, 300.0])
def test_no_flight_has_a_negative_width_under_a_rolled_camera(roll_deg: float) -> None:
    """Test: a frame of a flight open at both sides, its image turned about the optical axis.

    Expected result: left of right where both sides are seen, as in the upright and the reversed image.
    """
    turn = rotation_z(roll_deg * DEG)
    facing = rotation_x(-30.0 * DEG)
    axes = Axes(ahead=turn @ facing[2], up=turn @ -facing[1], right=turn @ facing[0])
    camera = replace(CAMERA, cx_px=160.0, cy_px=120.0)
    upper, lower = (ends_at(np.arange(60, 260), np.full(200, row)) for row in (90.0, 110.0))
    treads = [surface(-axes.up, distance_m=1.0 + 0.1 * k, upper=upper, lower=lower) for k in range(3)]
    blocks = replace(surface_blocks(np.full((240, 320), 9.0, dtype=np.float32), camera), nearness=np.full((320, 240), np.nan))
    left, right = sides_of(treads, blocks, camera, axes)
    assert left is None or right is None or left.aside_m < right.aside_m
