"""Point clouds as depth images: the heading stays that of the depth image; other units, axes and frames are named."""

from dataclasses import replace

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.errors import ImageError
from treadline.core.rotations import rotation_x, rotation_z
from treadline.io.frames.point_cloud import AXES, PointCloud, cloud_image
from treadline.perception import StairDetector

SAME_DEG = 0.05
"""Largest difference between the headings of a cloud and of its depth image [deg]: a tenth of the usual 95 % interval."""


def heading_deg(frame) -> float:
    heading = StairDetector().look(frame).heading_rad
    assert heading is not None
    return heading / DEG


@pytest.mark.parametrize("kind", ["kinect1", "kinect2"])
@pytest.mark.parametrize("heading", [-20.0, 12.0])
@pytest.mark.parametrize("seed", [1, 3])
def test_the_heading_of_a_cloud_is_that_of_its_depth_image(rendered, points, seed: int, heading: float, kind: str) -> None:
    frame = rendered(seed, heading, kind=kind)
    bare = replace(frame, camera=replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0)))
    cloud = points(frame).astype(np.float32)
    known = np.isfinite(cloud).all(axis=1)
    shuffled = np.random.default_rng(seed).permutation(cloud[known])
    expected = heading_deg(bare)
    camera = frame.camera
    organised = cloud_image("cloud", PointCloud(points=cloud, size_px=(camera.width_px, camera.height_px)))
    assert organised.frame.camera.fx_px == pytest.approx(camera.fx_px, rel=1e-5)
    assert organised.frame.camera.cy_px == pytest.approx(camera.cy_px, abs=1e-2)
    for image in (organised, cloud_image("cloud", PointCloud(points=shuffled))):
        assert image.warning is None
        assert heading_deg(image.frame) == pytest.approx(expected, abs=SAME_DEG)


@pytest.mark.parametrize("heading", [-20.0, 12.0])
def test_points_off_the_pixel_grid_are_seen_through_a_virtual_camera(rendered, points, heading: float) -> None:
    frame = rendered(1, heading)
    cloud = points(frame)
    known = cloud[np.isfinite(cloud).all(axis=1)]
    image = cloud_image("cloud", PointCloud(points=np.round(known, 3).astype(np.float32)))
    assert image.warning is not None
    assert "unorganised cloud" in image.warning
    bare = replace(frame, camera=replace(frame.camera, mount_pitch_rad=0.0))
    # A third of the resolution, and coordinates rounded to a millimetre: 0.09° at most on 36 frames.
    assert heading_deg(image.frame) == pytest.approx(heading_deg(bare), abs=0.2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_half_of_the_points_of_a_turned_sensor_give_the_edge_direction(rendered, points, seed: int) -> None:
    frame = rendered(seed, -20.0)
    R = rotation_x(0.1) @ rotation_z(0.15)
    cloud = points(frame)
    known = cloud[np.isfinite(cloud).all(axis=1)]
    half = known[np.random.default_rng(seed).random(len(known)) < 0.5]
    image = cloud_image("cloud", PointCloud(points=(half @ R.T).astype(np.float32)))
    expected = R @ StairDetector().look(frame).edge_direction_C
    cosine = float(expected @ StairDetector().look(image.frame).edge_direction_C)
    # 0.012° at most on 24 frames of 640×480; here the virtual camera has about 80×90 pixels.
    assert np.arccos(min(1.0, cosine)) / DEG < 0.1


def test_a_calibration_gives_an_unorganised_cloud_its_pixels(rendered, points) -> None:
    frame = rendered()
    cloud = points(frame)
    known = cloud[np.isfinite(cloud).all(axis=1)]
    image = cloud_image("cloud", PointCloud(points=np.round(known, 3).astype(np.float32)), frame.camera)
    assert image.warning is None
    assert image.frame.depth_m.shape == frame.depth_m.shape
    # Coordinates rounded to a millimetre stay within half a pixel, so that each point finds its own pixel.
    np.testing.assert_allclose(image.frame.depth_m, frame.depth_m, atol=6e-4)


def test_the_nearest_point_of_a_pixel_counts(rendered, points) -> None:
    frame = rendered()
    cloud = points(frame)
    behind = cloud * 1.5
    both = np.concatenate([cloud, behind])[np.random.default_rng(1).permutation(2 * len(cloud))]
    image = cloud_image("cloud", PointCloud(points=both.astype(np.float32)), frame.camera)
    np.testing.assert_allclose(image.frame.depth_m, frame.depth_m, rtol=1e-6)


def test_colours_follow_their_points(rendered, points) -> None:
    frame = rendered()
    rgb = frame.rgb.reshape(-1, 3)
    cloud = points(frame).astype(np.float32)
    image = cloud_image("cloud", PointCloud(points=cloud, rgb=rgb), frame.camera)
    known = np.isfinite(frame.depth_m)
    np.testing.assert_array_equal(image.frame.rgb[known], frame.rgb[known])


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000.0), ("cm", 100.0)])
def test_another_unit_is_named_with_its_remedy(rendered, points, unit: str, scale: float) -> None:
    frame = rendered()
    cloud = PointCloud(points=(scale * points(frame)).astype(np.float32), size_px=(320, 240))
    with pytest.raises(ImageError, match=f"--unit {unit}"):
        cloud_image("cloud", cloud)
    np.testing.assert_allclose(cloud_image("cloud", cloud, unit=unit).frame.depth_m, frame.depth_m, rtol=1e-5)
    with pytest.raises(ImageError, match="--unit m"):
        cloud_image("cloud", replace(cloud, points=points(frame).astype(np.float32)), unit="mm")


@pytest.mark.parametrize("axes", ["ros", "opengl"])
def test_other_axes_are_named_with_their_remedy(rendered, points, axes) -> None:
    frame = rendered()
    turned = (points(frame) @ AXES[axes][1]).astype(np.float32)
    cloud = PointCloud(points=turned, size_px=(320, 240))
    with pytest.raises(ImageError, match=f"--axes {axes}"):
        cloud_image("cloud", cloud)
    np.testing.assert_allclose(cloud_image("cloud", cloud, axes=axes).frame.depth_m, frame.depth_m, rtol=1e-6)


def test_an_organised_cloud_in_another_frame_is_projected_with_a_warning(rendered, points) -> None:
    frame = rendered()
    turned = points(frame) @ rotation_x(10.0 * DEG).T
    image = cloud_image("cloud", PointCloud(points=turned.astype(np.float32), size_px=(320, 240)))
    assert image.warning is not None
    assert "not a pinhole image" in image.warning


def test_sizes_and_empty_clouds_are_refused(rendered, points) -> None:
    frame = rendered()
    cloud = points(frame).astype(np.float32)
    with pytest.raises(ImageError, match="320×240 points, the calibration is for 640×240"):
        cloud_image("cloud", PointCloud(points=cloud, size_px=(320, 240)), replace(frame.camera, width_px=640))
    for few in (cloud[:0], cloud[:100], np.full_like(cloud, np.nan), np.zeros_like(cloud)):
        with pytest.raises(ImageError, match="points with a return; at least 1000"):
            cloud_image("cloud", PointCloud(points=few))
