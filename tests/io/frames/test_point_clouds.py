"""Point clouds as depth images: the heading stays that of the depth image; other units, axes and frames are named."""

from dataclasses import replace

import numpy as np
import pytest
from lidars import LIDARS, draw_lidar
from surfaces import on_a_flight

from treadline.core.angles import DEG
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.rotations import rotation_x, rotation_z
from treadline.io.frames import frame_of_points
from treadline.io.frames._poses import SensorPose
from treadline.io.frames.point_cloud import AXES, PointCloud, cloud_image
from treadline.perception import StairDetector

SAME_DEG = 0.1
"""Largest difference between the headings of a cloud and of its depth image [deg]: intrinsics fitted to single precision may change
which surface counts as an outlier."""


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


def levelled(frame: RgbdFrame, down: np.ndarray, points) -> tuple[RgbdFrame, np.ndarray, np.ndarray]:
    """Return a frame whose mount is that of a level chair, its points there, and the pose of its sensor."""
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    M = np.stack([ahead, np.cross(-down, ahead), -down]) @ CAMERA_AXES_IN_CHAIR.T
    roll, pitch, yaw = np.arctan2(M[2, 1], M[2, 2]), -np.arcsin(M[2, 0]), np.arctan2(M[1, 0], M[0, 0])
    camera = replace(frame.camera, mount_roll_rad=roll, mount_pitch_rad=pitch, mount_yaw_rad=yaw)
    at_m = np.array([0.3, -0.1, 0.8])
    cloud = points(frame) @ camera.R_BC.T + at_m
    return (
        replace(frame, camera=camera),
        cloud[np.isfinite(cloud).all(axis=1)],
        np.array([*at_m, *np.array([roll, pitch, yaw]) / DEG]),
    )


@pytest.mark.parametrize("heading", [-20.0, 12.0])
def test_a_level_cloud_gives_the_heading_of_its_depth_image(points, heading: float) -> None:
    frame, down = on_a_flight(1, heading)
    level, cloud, pose = levelled(frame, down, points)
    expected = StairDetector().look(level, down).heading_rad
    for given, within in ((pose, 0.02), (pose[:3], 0.1)):  # a sensor's angles keep its pixels
        named = frame_of_points(cloud.astype(np.float32), pose=given)
        found = StairDetector().look(named.frame, named.gravity_C).heading_rad
        assert named.mount_known
        assert found / DEG == pytest.approx(expected / DEG, abs=within)


def test_map_coordinates_are_named_and_a_pose_places_the_sensor(points) -> None:
    _, cloud, pose = levelled(*on_a_flight(1, 12.0), points)
    at_m = np.array([5.1e5, 5.4e6, 120.0])
    with pytest.raises(ImageError, match="probably those of a map; give the place of the sensor in it: --pose x,y,z"):
        frame_of_points(cloud + at_m, axes="ros")
    placed = frame_of_points(cloud + at_m, pose=[*(pose[:3] + at_m), *pose[3:]])
    here = frame_of_points(cloud, pose=pose)
    np.testing.assert_allclose(placed.frame.depth_m, here.frame.depth_m, atol=1e-4)


def test_points_all_around_are_cropped_to_the_sector_ahead(rendered, points) -> None:
    frame = rendered(1, 12.0)
    ahead = points(frame) @ AXES["ros"][1]
    ahead = ahead[np.isfinite(ahead).all(axis=1)]
    around = np.concatenate([ahead @ rotation_z(angle).T for angle in (0.0, 2.0, -2.0, np.pi)])
    image = cloud_image("cloud", PointCloud(points=around.astype(np.float32)))
    assert "of the points lie in its sector (x forward, y left, z up)" in str(image.warning)
    only = cloud_image("cloud", PointCloud(points=ahead.astype(np.float32)), axes="ros")
    found = StairDetector().look(image.frame).heading_rad
    assert found / DEG == pytest.approx(heading_deg(only.frame), abs=0.3)


@pytest.mark.parametrize("name", sorted(LIDARS))
def test_lidars_give_a_heading_before_the_flight(name: str) -> None:
    view = draw_lidar(100, LIDARS[name])
    several = len(view.clouds) > 1
    named = frame_of_points(
        view.clouds if several else view.clouds[0], poses=view.poses if several else None, axes="ros", gravity=[0.0, 1.0, 0.0]
    )
    sight = StairDetector().look(named.frame, named.gravity_C)
    assert sight.accepted, sight.reason
    assert abs(sight.heading_rad - view.heading_rad) < 2.576 * sight.sigma_rad
    assert sight.shape.rise_m == pytest.approx(view.rise_m, rel=0.1)


def test_scans_add_up_in_the_frame_of_the_last() -> None:
    wall = np.stack(np.meshgrid([3.0], np.linspace(-1, 1, 60), np.linspace(0, 2, 60)), axis=-1).reshape(-1, 3)
    poses = [[0.0, 0.0, 0.5, 0.0, 0.0, 0.0], [0.5, 0.2, 0.5, 0.0, 10.0, 25.0]]
    scans = [(wall - pose[:3]) @ SensorPose.of("pose", pose).R for pose in poses]
    named = frame_of_points(scans, poses=poses)
    one = frame_of_points(scans[1], axes="ros")
    assert np.nanmedian(named.frame.depth_m) == pytest.approx(np.nanmedian(one.frame.depth_m), abs=0.01)
    down = np.array([0.0, np.cos(10.0 * DEG), np.sin(10.0 * DEG)])
    R_FC = CAMERA_AXES_IN_CHAIR.T @ named.frame.camera.R_BC
    np.testing.assert_allclose(R_FC @ named.gravity_C, down, atol=1e-9)
    with pytest.raises(ImageError, match="1 poses of 2 clouds; give one pose a cloud"):
        frame_of_points(scans, poses=poses[:1])
