"""Obstacles on the flight, for the width of the observing chair."""

import math

import numpy as np
import pytest
from surfaces import LEG_HALF_M, frame_of

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import rotation_y
from treadline.perception import _stair_map as stair_map
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import Axes
from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.plant.sensors.camera.solids import SceneBox, solids_of
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import build_staircase


@pytest.mark.parametrize("model", ["wheelchair", "rescue"])
@pytest.mark.parametrize(("aside_m", "met"), [(-0.03, True), (0.03, False)])
def test_a_leg_on_a_step_is_in_the_way_of_a_chair_that_is_wide_enough(model: str, aside_m: float, met: bool) -> None:
    """Test: either vehicle on a flight; a leg 3 cm inside the swept width, and 3 cm outside. Expected result: a distance; None."""
    chair = read_chair(model)
    staircase = build_staircase(Stair(slope_deg=28.0, steps=12, width_m=2.4), np.random.default_rng(1))
    slope, here, there = staircase.slope_rad, staircase.steps[3], staircase.steps[7]
    centre = np.array([there.x_m + 0.15, chair.swept_half_m + aside_m + LEG_HALF_M[1], there.z_m + LEG_HALF_M[2]])
    leg = SceneBox(kind="bag", centre_W=centre, half_m=LEG_HALF_M, R_WK=np.eye(3), colour=(150.0, 40.0, 38.0), texture="dark")
    scene, p_WB = [*solids_of(stair_boxes(staircase)), leg], np.array([here.x_m, 0.0, here.z_m])
    frame, down_C = frame_of(scene, chair.camera_at(240), rotation_y(-slope), p_WB, 2)
    stair_map = StairDetector(DetectorConfig(swept_half_m=chair.swept_half_m)).see(frame, down_C).stair_map
    if not met:
        assert stair_map.obstacle_m is None
        return
    reach_m = (centre[0] - LEG_HALF_M[0] - here.x_m) / math.cos(slope)
    assert stair_map.obstacle_m == pytest.approx(reach_m, abs=0.2)  # its foot is near, its top leans towards the chair


@pytest.mark.parametrize(("depth_m", "height_m", "met"), [(1.5, 0.07, True), (2.6, 0.07, False), (2.6, 0.12, True)])
def test_what_is_no_higher_than_an_edge_spreads_is_nothing(depth_m: float, height_m: float, met: bool) -> None:
    """Test: a strip some height above the nosing plane, near and far. Expected result: far away, a low one is an edge's blur."""
    camera = PinholeCamera(width_px=40, height_px=240, fx_px=285.0, fy_px=285.0, cx_px=20.0, cy_px=120.0)
    # The camera looks level along a plane 0.5 m below it; a strip stands upright on it.
    above = 0.5 - (np.arange(240) - 120.0) / 285.0 * depth_m
    strip = np.where((above > height_m - 0.01) & (above < height_m), depth_m, np.nan)
    depth = np.repeat(strip[:, None], 40, axis=1).astype(np.float32)
    frame = RgbdFrame(t_s=0.0, rgb=np.zeros((240, 40, 3), np.uint8), depth_m=depth, camera=camera)
    sizes = dict.fromkeys(("rise_sigma_m", "run_sigma_m", "slope_sigma_rad", "distance_m", "blind_m"), 0.0)
    shape = StairShape(rise_m=0.0, run_m=0.3, slope_rad=0.0, direction="up", **sizes)
    axes = Axes(ahead=np.array([0.0, 0.0, 1.0]), up=np.array([0.0, -1.0, 0.0]), right=np.array([1.0, 0.0, 0.0]))
    points = [np.array([0.0, 0.5, ahead]) for ahead in (1.0, 9.0)]
    assert bool(len(stair_map.standing_points(frame, points, axes, shape, ends=False))) is met
