"""Point clouds as depth images: the heading stays that of the depth image; other units, axes and frames are named."""

from dataclasses import replace
from itertools import permutations, product
from typing import Any

import numpy as np
import pytest
from frame_files import points_of_frame

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.rotations import rotation_x, rotation_z
from treadline.io.frames import frame_of_points
from treadline.io.frames.point_cloud import AXES, FrameOptions, PointCloud, cloud_image
from treadline.perception import StairDetector
from treadline.scenario.camera_file import CameraFile

SAME_DEG = 0.1
"""Largest difference between the headings of a cloud and of its depth image [deg]: intrinsics fitted to single precision may change
which surface counts as an outlier."""


def heading_deg(frame: RgbdFrame) -> float:
    heading = StairDetector().look(frame).heading_rad
    assert heading is not None
    return heading / DEG


def bare(frame: RgbdFrame) -> RgbdFrame:
    return replace(frame, camera=replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0)))


def seen_points(frame: RgbdFrame) -> np.ndarray:
    """Return the points with a return."""
    points = points_of_frame(frame)
    return points[np.isfinite(points).all(axis=1)]


def image_of(points: np.ndarray, camera: Any = None, size_px: Any = None, rgb: Any = None, **options: Any) -> Any:
    cloud = PointCloud(points=points.astype(np.float32), size_px=size_px, rgb=rgb)
    given = None if camera is None else CameraFile.of(camera, "camera")
    return cloud_image("cloud", cloud, FrameOptions(camera=given, **options))


@pytest.mark.parametrize(("seed", "heading", "kind"), [(1, -20.0, "kinect1"), (3, 12.0, "kinect2"), (3, -20.0, "kinect2")])
def test_the_heading_of_a_cloud_is_that_of_its_depth_image(rendered, seed: int, heading: float, kind: str) -> None:
    frame = rendered(seed, heading, kind=kind)
    camera, expected = frame.camera, heading_deg(bare(frame))
    organised, _ = flat = image_of(points_of_frame(frame), size_px=(camera.width_px, camera.height_px))
    assert organised.frame.camera.fx_px == pytest.approx(camera.fx_px, rel=1e-5)
    assert organised.frame.camera.cy_px == pytest.approx(camera.cy_px, abs=1e-2)
    shuffled = np.random.default_rng(seed).permutation(seen_points(frame))
    for image, warning in (flat, image_of(shuffled)):
        assert warning is None
        assert heading_deg(image.frame) == pytest.approx(expected, abs=SAME_DEG)


@pytest.mark.parametrize("heading", [-20.0, 12.0])
def test_points_off_the_pixel_grid_are_seen_through_a_virtual_camera(rendered, heading: float) -> None:
    frame = rendered(1, heading)
    image, warning = image_of(np.round(seen_points(frame), 3))
    assert "unorganised cloud" in str(warning)
    # A third of the resolution, and coordinates rounded to a millimetre: 0.09° at most on 36 frames.
    assert heading_deg(image.frame) == pytest.approx(heading_deg(bare(frame)), abs=0.2)


def test_half_of_the_points_of_a_turned_sensor_give_the_edge_direction(rendered) -> None:
    frame = rendered(2, -20.0)
    R, known = rotation_x(0.1) @ rotation_z(0.15), seen_points(frame)
    half = known[np.random.default_rng(2).random(len(known)) < 0.5]
    image, _ = image_of(half @ R.T)
    expected = R @ StairDetector().look(frame).edge_direction_C
    cosine = float(expected @ StairDetector().look(image.frame).edge_direction_C)
    # 0.012° at most on 24 frames of 640×480; here the virtual camera has about 80×90 pixels.
    assert np.arccos(min(1.0, cosine)) / DEG < 0.1


def test_with_a_calibration_each_point_finds_its_pixel_and_the_nearest_counts(rendered) -> None:
    frame = rendered()
    image, warning = image_of(np.round(seen_points(frame), 3), frame.camera)
    assert warning is None
    # Coordinates rounded to a millimetre stay within half a pixel.
    np.testing.assert_allclose(image.frame.depth_m, frame.depth_m, atol=6e-4)
    both = np.concatenate([points_of_frame(frame), 1.5 * points_of_frame(frame)])
    order = np.random.default_rng(1).permutation(len(both))
    rgb = np.concatenate([frame.rgb.reshape(-1, 3), 0 * frame.rgb.reshape(-1, 3)])
    image, warning = image_of(both[order], frame.camera, rgb=rgb[order])
    np.testing.assert_allclose(image.frame.depth_m, frame.depth_m, rtol=1e-6)
    known = np.isfinite(frame.depth_m)
    np.testing.assert_array_equal(image.frame.rgb[known], frame.rgb[known])


@pytest.mark.parametrize(
    ("option", "given", "turn"),
    [
        ("unit", "mm", 1000.0 * np.eye(3)),
        ("unit", "cm", 100.0 * np.eye(3)),
        *(("axes", axes, AXES[axes][1]) for axes in ("ros", "opengl")),
    ],
)
def test_another_unit_and_other_axes_are_named_with_their_remedy(rendered, option: str, given: str, turn: np.ndarray) -> None:
    frame = rendered()
    cloud = seen_points(frame) @ turn
    with pytest.raises(ImageError, match=f"--{option} {given}"):
        image_of(cloud)
    np.testing.assert_allclose(image_of(cloud, **{option: given})[0].frame.depth_m, frame.depth_m, rtol=1e-5)
    with pytest.raises(ImageError, match="--unit m"):
        image_of(points_of_frame(frame), unit="mm")


def random_view(seed: int) -> tuple[RgbdFrame, np.ndarray]:
    """Return a depth image of two surfaces with holes, of random intrinsics, and a random rotation."""
    rng = np.random.default_rng(seed)
    width, height = int(rng.integers(60, 200)), int(rng.integers(60, 200))
    fx = float(rng.uniform(0.6, 2.0) * width)
    lens = {"fx_px": fx, "fy_px": fx * rng.uniform(0.85, 1.15), "cx_px": rng.uniform(0.3, 0.7) * width}
    camera = PinholeCamera(width_px=width, height_px=height, cy_px=rng.uniform(0.3, 0.7) * height, **lens)
    v, u = np.indices((height, width))
    depth = np.where(u > 0.4 * width, 1.0 + 0.3 * u / width, 1.9 - 0.5 * v / height)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    R, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    frame = RgbdFrame(t_s=0.0, rgb=np.zeros((height, width, 3), np.uint8), depth_m=depth.astype(np.float32), camera=camera)
    return frame, R * np.linalg.det(R)


def organised_image(frame: RgbdFrame, points: np.ndarray, **options: Any) -> Any:
    return frame_of_points(points.reshape(*frame.depth_m.shape, 3), **options)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("far_m", [0.0, 1.0, 1e5])
def test_an_organised_cloud_in_any_axes_is_its_depth_image(seed: int, far_m: float) -> None:
    frame, R_FC = random_view(seed)
    shift = far_m * np.random.default_rng(seed).standard_normal(3)
    named = organised_image(frame, points_of_frame(frame) @ R_FC.T + shift, gravity=R_FC @ [0.0, 1.0, 0.0])
    np.testing.assert_allclose(named.frame.depth_m, frame.depth_m, rtol=1e-6)
    np.testing.assert_allclose(named.frame.camera.pinhole, frame.camera.pinhole, atol=1e-3)
    np.testing.assert_allclose(named.gravity_C, [0.0, 1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("order", list(permutations(range(3))))
@pytest.mark.parametrize("signs", list(product((1.0, -1.0), repeat=3)))
def test_permuted_axes_are_read_and_mirrored_ones_refused(order: tuple[int, ...], signs: tuple[float, ...]) -> None:
    frame, _ = random_view(1)
    turn = np.eye(3)[list(order)] * np.array(signs)
    if np.linalg.det(turn) < 0.0:
        with pytest.raises(ImageError, match="mirrored"):
            organised_image(frame, points_of_frame(frame) @ turn)
    else:
        named = organised_image(frame, points_of_frame(frame) @ turn)
        np.testing.assert_allclose(named.frame.depth_m, frame.depth_m, rtol=1e-6)


def test_points_that_left_their_pixels_are_left_out(rendered) -> None:
    frame, R_FC = rendered(), random_view(1)[1]
    points = points_of_frame(frame)
    moved = np.random.default_rng(1).random(len(points)) < 0.1
    points[moved] += [0.0, 0.1, 0.0]
    image, warning = image_of(points @ R_FC.T, size_px=(320, 240))
    assert "the camera was found in the cloud" in str(warning)
    kept = np.isfinite(frame.depth_m) & ~moved.reshape(240, 320)
    np.testing.assert_allclose(image.frame.depth_m[kept], frame.depth_m[kept], rtol=1e-5)
    assert np.isnan(image.frame.depth_m[~kept]).all()


def test_a_turned_cloud_has_the_heading_of_its_depth_image(rendered) -> None:
    frame, R_FC = rendered(1, -20.0), random_view(3)[1]
    image, _ = image_of(points_of_frame(frame) @ R_FC.T, size_px=(320, 240))
    assert heading_deg(image.frame) == pytest.approx(heading_deg(bare(frame)), abs=SAME_DEG)


def test_clouds_that_are_no_pinhole_image_or_none_at_all_are_named(rendered) -> None:
    frame = rendered()
    points = points_of_frame(frame)
    shuffled = np.random.default_rng(1).permutation(points)
    for other in (shuffled, points * [1.0, 2.0, 1.0], np.hypot(points, 0.5)):
        with pytest.raises(ImageError, match=r"not a pinhole image: residual [0-9.e+-]+ px, at most 0.5, fx / fy = "):
            image_of(other, size_px=(320, 240))
    wall = points_of_frame(replace(frame, depth_m=np.full_like(frame.depth_m, 1.5)))
    line = np.linspace(0.5, 3.0, len(points))[:, None] * [1.0, 0.5, 0.2]
    for flat in (wall @ random_view(1)[1].T + 1e4, line):
        with pytest.raises(ImageError, match="lie on a plane or on a line"):
            organised_image(frame, flat)
    around = np.concatenate([points, -points])
    with pytest.raises(ImageError, match=r"50% of the points lie in front of the camera.*clouds are of one view"):
        image_of(around)
    with pytest.raises(ImageError, match="320×240 points, the calibration is for 640×240"):
        image_of(points, replace(frame.camera, width_px=640), size_px=(320, 240))
    with pytest.raises(ImageError, match="subtract the place of the sensor from coordinates of a map"):
        image_of(np.add(seen_points(frame), [0.0, 0.0, 5e5]))
    for few in (points[:0], points[:100], np.full_like(points, np.nan), np.zeros_like(points)):
        with pytest.raises(ImageError, match="points with a return; at least 1000"):
            image_of(few)
