"""Steps of any size: each is found with its own rise and run, or refused by its size, never as steps of a fraction of it."""

import numpy as np
import pytest
from scenes import ViewRecipe, draw_view
from scenes.views import View

from treadline.core.camera_images import RgbdFrame
from treadline.perception import StairDetection, StairDetector


def scaled(view: View, factor: float) -> RgbdFrame:
    """Return the frame of a scene that is larger by a factor, seen from a camera as much further away."""
    frame = view.frame
    return RgbdFrame(t_s=frame.t_s, rgb=frame.rgb, depth_m=(frame.depth_m * np.float32(factor)), camera=frame.camera)


def looks(recipe: ViewRecipe, seeds: range, factors: tuple[float, ...]) -> list[tuple[StairDetection, float, float]]:
    """Return what the detector makes of scaled scenes, with the true rise and run."""
    found = []
    for seed in seeds:
        view = draw_view(np.random.default_rng(seed), recipe)
        assert view.stair is not None
        for factor in factors:
            sight = StairDetector().look(scaled(view, factor), view.gravity_C)
            found.append((sight, factor * view.stair.rise_m, factor * view.stair.run_m))
    return found


@pytest.mark.parametrize("scene", ["up", "down", "edge"])
def test_no_size_is_taken_for_another(scene: str) -> None:
    """Test: stairs scaled by 0.5 to 3. Expected result: no answer with a rise or run off by more than a tenth, steps higher than
    0.25 m refused, and those between 0.12 and 0.22 m found."""
    seen = looks(ViewRecipe(scenes=(scene,)), range(410_000, 410_005), (0.5, 0.6, 1.0, 1.3, 1.7, 2.0, 2.5, 3.0))
    for sight, rise_m, run_m in seen:
        if sight.accepted and sight.shape is not None:
            assert sight.shape.rise_m == pytest.approx(rise_m, rel=0.1)
            assert sight.shape.run_m == pytest.approx(run_m, rel=0.1)
    assert not any(sight.accepted for sight, rise_m, _ in seen if rise_m > 0.27)
    usual = [sight.accepted for sight, rise_m, run_m in seen if 0.12 < rise_m < 0.22 and 0.2 < run_m < 0.45]
    assert np.mean(usual) > 0.8
