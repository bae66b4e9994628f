"""Quality of a frame; each scenario states *Test / Expected result*."""

from dataclasses import replace

import numpy as np
import pytest

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.perception.frame_quality import quality_of

CAMERA = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)


def frame(seed: int = 0, level: float = 120.0, spread: float = 40.0, holes: float = 0.1) -> RgbdFrame:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.5, 4.0, (240, 320)).astype(np.float32)
    depth_m[rng.random((240, 320)) < holes] = np.nan
    rgb = np.clip(rng.normal(level, spread, (240, 320, 3)), 0, 255).astype(np.uint8)
    return RgbdFrame(t_s=1.5, rgb=rgb, depth_m=depth_m, camera=CAMERA)


def test_an_ordinary_frame_has_its_true_statistics() -> None:
    """Test: mean 120 and deviation 40 of 255, two thirds of the depth lost. Expected result: those numbers, the frame's time."""
    quality = quality_of(frame(holes=2 / 3))
    assert quality.t_s == 1.5
    assert quality.brightness == pytest.approx(120 / 255, abs=0.01)
    assert quality.contrast == pytest.approx(40 / 255, abs=0.01)
    assert quality.valid_share == pytest.approx(1 / 3, abs=0.04)  # 1200 pixels of a binomial law: 3 sigma


def test_the_same_pixels_make_the_same_fingerprint_at_any_time_and_in_any_layout() -> None:
    """Test: one image again, later, and as a view that is not contiguous. Expected result: one fingerprint."""
    first = frame()
    wide = np.repeat(first.depth_m, 2, axis=1)[:, ::2]
    again = replace(first, t_s=9.0, depth_m=wide)
    assert quality_of(again).fingerprint == quality_of(first).fingerprint


def test_a_single_depth_or_colours_without_depth_make_another_fingerprint() -> None:
    """Test: one depth changes outside the pixels of the statistics; two frames of other colours and no depth at all. Expected
    result: other fingerprints."""
    first = frame()
    changed = first.depth_m.copy()
    changed[3, 5] = 1
    assert quality_of(replace(first, depth_m=changed)).fingerprint != quality_of(first).fingerprint
    assert quality_of(frame(seed=1, holes=1.1)).fingerprint != quality_of(frame(seed=2, holes=1.1)).fingerprint


def test_colours_are_not_looked_at_where_depth_is_enough() -> None:
    """Test: a black image with nearly all of its depth. Expected result: what stands for colours nobody asked for."""
    quality = quality_of(frame(level=0.0, spread=0.0))
    assert (quality.brightness, quality.contrast) == (0.5, 0.25)


@pytest.mark.parametrize(("level", "brightness"), [(0.0, 0.0), (255.0, 1.0)])
def test_dark_and_glare_show_in_brightness_and_contrast(level: float, brightness: float) -> None:
    """Test: all black, all white. Expected result: brightness 0 or 1, no contrast."""
    quality = quality_of(frame(level=level, spread=0.0, holes=0.8))
    assert (quality.brightness, quality.contrast) == (brightness, 0.0)


def test_zero_and_infinity_are_no_depth() -> None:
    """Test: a third of the rows holds zero, a third infinity. Expected result: a third is valid."""
    whole = frame(holes=0.0)
    depth_m = whole.depth_m.copy()
    depth_m[:80], depth_m[80:160] = 0.0, np.inf
    assert quality_of(replace(whole, depth_m=depth_m)).valid_share == pytest.approx(1 / 3, abs=0.02)


def test_an_empty_image_is_worth_nothing_and_raises_nothing() -> None:
    """Test: images without pixels. Expected result: zeros."""
    none = RgbdFrame(t_s=0.0, rgb=np.empty((0, 0, 3), np.uint8), depth_m=np.empty((0, 0), np.float32), camera=CAMERA)
    quality = quality_of(none)
    assert (quality.brightness, quality.contrast, quality.valid_share) == (0.0, 0.0, 0.0)
