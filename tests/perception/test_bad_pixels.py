"""Depth images with missing, copied and mixed pixels, and recorded frames in other pixel phases."""

from itertools import islice

import numpy as np
import pytest
from real_frames import mirrored, phases_of, real_frames
from scenes import ViewRecipe, draw_view

from treadline.core.angles import DEG
from treadline.perception import StairDetector
from treadline.perception._plane_segmentation_kernels import pooled

KNOWN = [real for real in real_frames() if real.gravity_C is not None]


@pytest.mark.parametrize(
    "bad",
    [{"missing": 0.6}, {"missing": 0.8}, {"missing": 0.6, "scenes": ("down",)}, {"missing": 0.6, "sensor": "d435"}]
    + [{"holes": 0.2, "hole_filling": filling} for filling in ("left", "nearest", "furthest")]
    + [{"sensor": "tof", "height_px": 288, "flying": 0.5}],
    ids=str,
)
def test_bad_pixels_cost_no_frame(bad: dict[str, object]) -> None:
    """Test: six flights each. Expected result: at least five accepted, all within three declared deviations and 1°."""
    accepted = 0
    for seed in range(41_500_000, 41_500_006):
        view = draw_view(np.random.default_rng(seed), ViewRecipe(**bad))  # type: ignore[arg-type]
        sight = StairDetector().look(view.frame, view.gravity_C)
        accepted += sight.accepted
        if sight.accepted:
            error = abs(sight.heading_rad - view.stair.heading_rad)
            assert error < min(3.0 * sight.sigma_rad, 1.0 * DEG)
    assert accepted >= 5


def test_the_median_of_a_square_lies_on_one_surface() -> None:
    """Test: squares with two pixels at 1 and 2 m; at 1 and 1.002 m; with none. Expected result: the nearer one, the mean, NaN."""
    depth_m = np.full((2, 6), np.nan, dtype=np.float32)
    depth_m[0, [0, 1, 2, 3]] = 2.0, 1.0, 1.0, 1.002
    assert pooled(depth_m, 2, 0.01)[0] == pytest.approx([1.0, 1.001, np.nan], nan_ok=True)


@pytest.mark.skipif(not KNOWN, reason="no recorded frames next to the project")
@pytest.mark.parametrize("step", [1, 2])
def test_recorded_frames_are_accepted_in_all_pixel_phases(step: int) -> None:
    """Test: every sixth phase of frames of a Kinect 1, whole and halved, and their mirror images. Expected result: within 1.5°."""
    for real in KNOWN:
        for variant in (real, mirrored(real)):
            for moved in islice(phases_of(variant, step), 0, None, 6):
                sight = StairDetector().look(moved.frame, moved.gravity_C)
                assert sight.accepted
                assert moved.error_deg(sight.edge_direction_C) < 1.5
