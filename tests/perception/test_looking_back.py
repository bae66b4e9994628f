"""A camera over the chair's back: the chair faces uphill and backs down what falls away behind it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from scenes import View, ViewRecipe, draw_view
from surfaces import frame_of

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import rotation_z
from treadline.perception import StairDetection, StairDetector
from treadline.perception.overlay import overlay
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair, StepOverride
from treadline.vehicle.staircase import build_staircase

DETECTOR = StairDetector()
REAR = read_chair("wheelchair").camera_at(240, rear=True)
AROUND = np.array([-1.0, -1.0, 1.0])
"""Half a turn about the chair's z."""


def turned_around(camera: PinholeCamera) -> PinholeCamera:
    """Return the calibration of the same camera on a chair that stands the other way round."""
    x, y, z = camera.mount_m
    return replace(camera, mount_yaw_rad=camera.mount_yaw_rad + math.pi, mount_m=(-x, -y, z))


def both_ways(view: View) -> tuple[StairDetection, StairDetection]:
    """Return what a camera in front of a chair facing down sees, and the same one at the back of a chair facing up."""
    back = replace(view.frame, camera=turned_around(view.frame.camera))
    return DETECTOR.look(view.frame, view.gravity_C), DETECTOR.look(back, view.gravity_C)


@pytest.mark.parametrize("scene", ["down", "edge", "bottom", "up"])
def test_a_chair_the_other_way_round_gets_the_same_stair(scene: str) -> None:
    recipe = ViewRecipe(scenes=(scene,), walls=("left", "right", "both"), clutter=("legs",), clutter_chance=0.5)
    obstacles = walls = 0
    for seed in range(42_000, 42_012):
        front, back = both_ways(draw_view(np.random.default_rng(seed), recipe))
        assert front.accepted == back.accepted
        if front.stair_map is None or back.stair_map is None or front.heading_rad is None:
            continue
        assert back.heading_rad == pytest.approx(front.heading_rad, abs=1e-9)
        assert back.sigma_rad == pytest.approx(front.sigma_rad, rel=1e-9)
        there, here = front.stair_map, back.stair_map
        np.testing.assert_allclose(here.nosings_B, np.array(there.nosings_B) * AROUND, atol=1e-9)
        assert (here.direction, here.ends) == (there.direction, there.ends)
        assert (here.left_wall_m, here.right_wall_m) == pytest.approx((there.right_wall_m, there.left_wall_m))
        assert here.obstacle_m == pytest.approx(there.obstacle_m)
        assert here.slope_rad == pytest.approx(there.slope_rad)
        assert back.edge_direction_C == pytest.approx(-front.edge_direction_C)  # right of the one is left of the other
        obstacles += here.obstacle_m is not None
        walls += here.left_wall_m is not None
    assert walls >= 3
    assert obstacles >= 1


def backing(
    seed: int, heading_rad: float, *, behind_m: float, first_m: float | None = None
) -> tuple[RgbdFrame, Float[np.ndarray, " 3"], np.ndarray]:
    """Return a frame of the rear camera, down in C, and the nosings behind the chair, in B, the nearest first.

    Args:
        behind_m: From the landing's edge down the flight to the chair's middle.
        first_m: Rise of the first step; that of the others by default.
    """
    rng = np.random.default_rng(seed)
    own = () if first_m is None else (StepOverride(index=0, rise_m=first_m),)
    staircase = build_staircase(Stair(slope_deg=28.0, steps=14, walls="right"), rng, own)
    last, R_WB = staircase.steps[-1], staircase.R_WS @ rotation_z(heading_rad)
    p_WB = np.array([last.x_m, 0.1, last.z_m]) - behind_m * staircase.R_WS[:, 0]
    frame, down = frame_of(staircase, REAR, R_WB, p_WB, rng)
    places = np.array([[step.x_m, 0.0, step.z_m] for step in staircase.steps]) - p_WB
    nosings, along = places @ R_WB, R_WB.T @ np.array([0.0, 1.0, 0.0])
    nosings = nosings - (nosings[:, 1] / along[1])[:, None] * along
    behind = nosings[nosings[:, 0] < 0.0]
    return frame, down, behind[np.argsort(-behind[:, 0])]


@pytest.mark.parametrize("first_m", [None, 0.11, 0.21], ids=["even", "-50 mm", "+50 mm"])
def test_the_floor_behind_the_last_nosing_ends_the_flight(first_m: float | None) -> None:
    """Test: four of fourteen nosings in view, and the floor. Expected result: the end, also where a covering has changed the first
    riser by 50 mm of 160."""
    reported = []
    for seed in range(44_000, 44_012):
        # Of fourteen nosings four are left behind the chair.
        frame, down, true = backing(seed, 0.1, behind_m=3.2, first_m=first_m)
        seen = DETECTOR.look(frame, down).stair_map
        if seen is not None:
            gaps = np.linalg.norm(np.array(seen.nosings_B)[-1] - true, axis=1)
            reported.append(seen.ends)
            assert not seen.ends or int(gaps.argmin()) == len(true) - 1
    assert sum(reported) >= 11


def test_the_picture_of_what_lies_behind_has_its_nosings_where_they_are() -> None:
    frame, down, _ = backing(45_000, 0.0, behind_m=1.5)
    picture = overlay(frame, DETECTOR.look(frame, down))
    drawn = (picture[: 3 * REAR.height_px] == (255, 235, 60)).all(axis=2)
    middle = drawn[:, 3 * REAR.width_px // 2 - 60 : 3 * REAR.width_px // 2 + 60]
    assert middle.any(axis=1).sum() >= 2
