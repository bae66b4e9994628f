"""Frames seen otherwise and worthless ones: no exception, no heading far off, and a scene of another size has that size."""

import os
from dataclasses import replace

import numpy as np
import pytest
from robustness import tallies
from variations import KINDS, drawn_frame, recorded_frames, seen_otherwise

import treadline as tl
from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import SettingsError, TreadlineError
from treadline.perception._gravity_direction import gravity_variance
from treadline.scenario.camera_file import CameraFile

LOOKS = int(os.environ.get("TREADLINE_FUZZ", "48"))
"""Number of varied frames; ``TREADLINE_FUZZ=4000`` takes minutes."""
OUTSIDE_IN_2000 = 28
"""Number of acceptances of 2,000 outside their 99 % interval that 5 % of the runs reach: a binomial of mean 20."""
CAMERA = PinholeCamera(width_px=64, height_px=48, fx_px=57.0, fy_px=57.0, cx_px=31.5, cy_px=23.5)


def test_frames_seen_otherwise_end_in_no_exception_and_are_not_far_off() -> None:
    bases = [*recorded_frames(), *(drawn_frame(seed) for seed in range(5_310_000, 5_310_000 + max(8, LOOKS // 20)))]
    found = tallies(bases, LOOKS, np.random.default_rng(5_310_000))
    assert [failure for tally in found.values() for failure in tally.failures] == []
    notes = [note for tally in found.values() for note in tally.notes]
    accepted, outside = (sum(getattr(tally, name) for tally in found.values()) for name in ("accepted", "outside"))
    assert accepted > 0.3 * LOOKS
    assert outside <= max(2, OUTSIDE_IN_2000 * accepted / 2000), notes
    assert max(tally.worst_deg for tally in found.values()) < 3.0, notes
    assert found["scaled"].other_size == 0, notes


@pytest.mark.parametrize("kind", KINDS)
def test_what_varies_keeps_its_truth(kind: str) -> None:
    known = drawn_frame(5_320_001)
    seen = seen_otherwise(known, kind, np.random.default_rng(1))
    assert np.linalg.norm(seen.edge_C) == pytest.approx(1.0)
    assert seen.frame.depth_m.shape == (seen.frame.camera.height_px, seen.frame.camera.width_px)
    if kind != "gravity wrong":
        assert seen.edge_C @ seen.gravity_C == pytest.approx(known.edge_C @ known.gravity_C)


@pytest.mark.parametrize("gravity", [None, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]])
@pytest.mark.parametrize("size", [(1, 1), (1, 640), (48, 1), (7, 5), (15, 16), (48, 64)])
def test_worthless_depth_gives_a_reason_in_one_line(size: tuple[int, int], gravity: list[float] | None) -> None:
    camera = replace(CAMERA, height_px=size[0], width_px=size[1])
    noise = 1.0 + np.random.default_rng(1).random(size)
    for depth in (np.full(size, 1.5), np.full(size, np.nan), np.zeros(size), -noise, noise, 1e30 * noise, np.full(size, np.inf)):
        sight = tl.detect_stair(depth, camera, gravity)
        assert not sight.accepted
        assert sight.reason
        assert ("18×18 are needed" in sight.reason) == (min(size) < 18)
        assert "\n" not in sight.reason


@pytest.mark.parametrize("camera", [{"fx": 3}, 3, "nowhere.toml", replace(CAMERA, fx_px=float("nan")), replace(CAMERA, width_px=1)])
def test_what_is_no_calibration_is_named_in_one_line(camera: object, tmp_path) -> None:
    with pytest.raises(SettingsError) as raised:
        tl.read_frames(tmp_path / "depth.png", camera=camera)
    assert "\n" not in str(raised.value)


def test_a_pinhole_camera_and_a_calibration_serve_alike(tmp_path) -> None:
    cv2 = pytest.importorskip("cv2")
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((48, 64), 1500, dtype=np.uint16))
    mounted = replace(CAMERA, mount_pitch_rad=40.0 * DEG, mount_m=(0.4, 0.0, 0.8))
    (named,) = tl.read_frames(tmp_path / "depth.png", camera=mounted)
    assert named.mount_known
    assert named.frame.camera == mounted
    assert not next(iter(tl.read_frames(tmp_path / "depth.png", camera=CAMERA))).mount_known
    file = CameraFile(width=64, height=48, fx_px=57.0, fy_px=57.0, cx_px=31.5, cy_px=23.5)
    assert tl.detect_stair(np.full((48, 64), 1.5), file).reason == tl.detect_stair(named, mounted).reason
    with pytest.raises(TreadlineError, match="is the camera file of another resolution"):
        list(tl.read_frames(tmp_path / "depth.png", camera=replace(CAMERA, width_px=128, height_px=96, cx_px=63.5, cy_px=47.5)))


@pytest.mark.parametrize(
    ("gap_deg", "spread_deg", "count", "is_rejected"), [(7.0, 2.0, 8, True), (7.0, 5.0, 2, False), (0.5, 0.2, 8, False)]
)
def test_gravity_far_from_scattered_treads_is_no_reference(gap_deg, spread_deg, count, is_rejected) -> None:
    tilts = (gap_deg + spread_deg * np.linspace(-1.0, 1.0, count)) * DEG
    variance = gravity_variance(tilts, 0.5 * DEG)
    assert variance == pytest.approx((gap_deg * DEG) ** 2 if is_rejected else (0.5 * DEG) ** 2)
