"""Point clouds as depth images: the heading stays that of the depth image; other units, axes and frames are named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from frame_files import points_of_frame
from lidars import LIDARS, draw_lidar
from surfaces import on_a_flight

from treadline.core.angles import DEG
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.rotations import rotation_x, rotation_z
from treadline.io.frames import frame_of_points
from treadline.io.frames.point_cloud import AXES, FrameOptions, PointCloud, SensorPose, cloud_image
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
    cloud, size_px = points_of_frame(frame) @ turn, (320, 240)
    with pytest.raises(ImageError, match=f"--{option} {given}"):
        image_of(cloud, size_px=size_px)
    np.testing.assert_allclose(image_of(cloud, size_px=size_px, **{option: given})[0].frame.depth_m, frame.depth_m, rtol=1e-5)
    with pytest.raises(ImageError, match="--unit m"):
        image_of(points_of_frame(frame), unit="mm")


def test_clouds_that_are_no_pinhole_image_or_none_at_all_are_named(rendered) -> None:
    frame = rendered()
    points = points_of_frame(frame)
    _, warning = image_of(points @ rotation_x(10.0 * DEG).T, size_px=(320, 240))
    assert "not a pinhole image" in str(warning)
    with pytest.raises(ImageError, match="320×240 points, the calibration is for 640×240"):
        image_of(points, replace(frame.camera, width_px=640), size_px=(320, 240))
    for few in (points[:0], points[:100], np.full_like(points, np.nan), np.zeros_like(points)):
        with pytest.raises(ImageError, match="points with a return; at least 1000"):
            image_of(few)


@pytest.mark.parametrize("heading", [-20.0, 12.0])
def test_a_level_cloud_gives_the_heading_of_its_depth_image_also_in_map_coordinates(heading: float) -> None:
    frame, down = on_a_flight(1, heading)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    M = np.stack([ahead, np.cross(-down, ahead), -down]) @ CAMERA_AXES_IN_CHAIR.T
    roll, pitch, yaw = np.arctan2(M[2, 1], M[2, 2]), -np.arcsin(M[2, 0]), np.arctan2(M[1, 0], M[0, 0])
    level = replace(frame, camera=replace(frame.camera, mount_roll_rad=roll, mount_pitch_rad=pitch, mount_yaw_rad=yaw))
    expected = StairDetector().look(level, down).heading_rad
    at_m, angles_deg = np.array([0.3, -0.1, 0.8]), np.array([roll, pitch, yaw]) / DEG
    cloud = seen_points(frame) @ level.camera.R_BC.T + at_m
    here = frame_of_points(cloud.astype(np.float32), pose=[*at_m, *angles_deg])
    # A sensor's angles keep its pixels.
    for named, within in ((here, 0.02), (frame_of_points(cloud.astype(np.float32), pose=at_m), 0.1)):
        assert named.mount_known
        assert StairDetector().look(named.frame, named.gravity_C).heading_rad / DEG == pytest.approx(expected / DEG, abs=within)
    map_m = np.array([5.1e5, 5.4e6, 120.0])
    with pytest.raises(ImageError, match="probably those of a map; give the place of the sensor in it: --pose x,y,z"):
        frame_of_points(cloud + map_m, axes="ros")
    placed = frame_of_points(cloud + map_m, pose=[*(at_m + map_m), *angles_deg])
    np.testing.assert_allclose(placed.frame.depth_m, here.frame.depth_m, atol=1e-4)


def test_points_all_around_are_cropped_to_the_sector_ahead(rendered) -> None:
    ahead = seen_points(rendered(1, 12.0)) @ AXES["ros"][1]
    around = np.concatenate([ahead @ rotation_z(angle).T for angle in (0.0, 2.0, -2.0, np.pi)])
    image, warning = image_of(around)
    assert "of the points lie in its sector (x forward, y left, z up)" in str(warning)
    only, _ = image_of(ahead, axes="ros")
    assert heading_deg(image.frame) == pytest.approx(heading_deg(only.frame), abs=0.3)


def test_scans_of_a_lidar_give_a_heading_before_the_flight() -> None:
    view = draw_lidar(100, LIDARS["VLP-16, 20 scans"])
    named = frame_of_points(view.clouds, poses=view.poses, axes="ros", gravity=[0.0, 1.0, 0.0])
    sight = StairDetector().look(named.frame, named.gravity_C)
    assert sight.accepted, sight.reason
    assert abs(sight.heading_rad - view.heading_rad) < 2.576 * sight.sigma_rad
    assert sight.shape.rise_m == pytest.approx(view.rise_m, rel=0.1)


def test_scans_add_up_in_the_frame_of_the_last() -> None:
    wall = np.stack(np.meshgrid([3.0], np.linspace(-1, 1, 60), np.linspace(0, 2, 60)), axis=-1).reshape(-1, 3)
    poses = [[0.0, 0.0, 0.5, 0.0, 0.0, 0.0], [0.5, 0.2, 0.5, 0.0, 10.0, 25.0]]
    scans = [(wall - pose[:3]) @ SensorPose.of("pose", pose).R for pose in poses]
    named, one = frame_of_points(scans, poses=poses), frame_of_points(scans[1], axes="ros")
    assert np.nanmedian(named.frame.depth_m) == pytest.approx(np.nanmedian(one.frame.depth_m), abs=0.01)
    down = np.array([0.0, np.cos(10.0 * DEG), np.sin(10.0 * DEG)])
    R_FC = CAMERA_AXES_IN_CHAIR.T @ named.frame.camera.R_BC
    np.testing.assert_allclose(R_FC @ named.gravity_C, down, atol=1e-9)
    with pytest.raises(ImageError, match="1 poses of 2 clouds; give one pose a cloud"):
        frame_of_points(scans, poses=poses[:1])
