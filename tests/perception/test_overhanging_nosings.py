"""Stairs that the simulator does not draw: planks that overhang their risers, of the solids of the benchmarks."""

from dataclasses import replace

import numpy as np
import pytest
from turned_stairs import Prism, box, render

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import rotation_y, rotation_z
from treadline.perception import StairDetector

RISE_M, RUN_M, WIDTH_M = 0.17, 0.28, 1.2
CAMERA = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)
C_OF_B = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Right, down and ahead of a camera that looks along x."""


def flight(overhang_m: float, steps: int = 12, thick_m: float = 0.04) -> list[Prism]:
    """Return a floor and a closed flight along x whose treads jut out over their risers."""
    solids, end_m = [box((-2.5, 0.0), (5.0, 10.0), -0.1, 0.0)], steps * RUN_M
    for k in range(steps):
        top_m = (k + 1) * RISE_M
        for out_m, low_m, high_m in ((0.0, 0.0, top_m - thick_m), (overhang_m, top_m - thick_m, top_m)):
            start_m = k * RUN_M - out_m
            solids.append(box((0.5 * (start_m + end_m), 0.0), (end_m - start_m, WIDTH_M), low_m, high_m))
    return solids


def depth_of(solids: list[Prism], place: tuple[float, float, float], heading_rad: float, down_rad: float) -> np.ndarray:
    """Return Z of each pixel, with a Kinect 1's noise and steps of disparity; NaN where nothing is hit."""
    z, *_ = render(solids, CAMERA, rotation_z(heading_rad) @ rotation_y(down_rad) @ C_OF_B.T, np.array(place))
    disparity = 575.0 * 0.075 / z + 0.08 * np.random.default_rng(1).standard_normal(z.shape)
    with np.errstate(divide="ignore"):
        z = 575.0 * 0.075 / (np.round(8.0 * disparity) / 8.0)
    z[(z < 0.4) | (z > 5.0)] = np.nan
    return z.astype(np.float32)


@pytest.mark.parametrize("heading_deg", [-20.0, 4.0])
@pytest.mark.parametrize("overhang_m", [0.0, 0.025, 0.04])
@pytest.mark.parametrize(("height_m", "down_deg"), [(0.45, 0.0), (0.55, 10.0), (0.7, 0.0), (0.9, 20.0)])
def test_treads_at_the_eyes_height_under_which_risers_end_leave_a_stair(
    heading_deg: float, overhang_m: float, height_m: float, down_deg: float
) -> None:
    """Test: from the floor, treads hardly in view, the risers' ends hidden by what juts out. Expected result: seen as it is."""
    depth = depth_of(flight(overhang_m), (-0.5, 0.0, height_m), heading_deg * DEG, down_deg * DEG)
    camera = replace(CAMERA, mount_pitch_rad=down_deg * DEG)
    frame = RgbdFrame(t_s=0.0, rgb=np.zeros((*depth.shape, 3), np.uint8), depth_m=depth, camera=camera)
    gravity = (rotation_y(down_deg * DEG) @ C_OF_B.T).T @ np.array([0.0, 0.0, -1.0])
    sight = StairDetector().look(frame, gravity)
    assert sight.accepted, sight.reason
    assert sight.heading_rad / DEG == pytest.approx(heading_deg, abs=0.2)
    assert sight.shape.run_m == pytest.approx(RUN_M, abs=0.01)
    # What a nosing hides of its riser is taken from one step; measured over 240 such views, 14 mm at most.
    assert sight.shape.rise_m == pytest.approx(RISE_M, abs=0.015)
