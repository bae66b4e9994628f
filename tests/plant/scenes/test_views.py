"""Random views and their ground truth: reproducible by seed, and consistent with the image, whatever the shape of the steps."""

import numpy as np
import pytest
from jaxtyping import Bool, Float
from scenes import CLUTTER, STAIR_SCENES, STAIRLESS_SCENES, RecordedDrive, View, ViewRecipe, draw_view

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_z
from treadline.plant.sensors.camera import Camera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

IDEAL: dict[str, object] = {"sensor": "ideal", "gravity_error_deg": 0.0}


def view(seed: int, **recipe: object) -> View:
    return draw_view(np.random.default_rng(seed), ViewRecipe(**recipe))


def points_B(seen: View) -> Float[np.ndarray, "h w 3"]:
    """Return the point of each pixel in the chair's frame, by the true calibration."""
    camera = seen.true_camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(u.shape)], axis=-1)
    return (rays * seen.exact.depth_m[:, :, None]) @ camera.R_BC.T + np.array(camera.mount_m)


@pytest.mark.parametrize("sensor", ["kinect1", "kinect2", "tof", "d435", "d455", "ideal"])
def test_the_same_seed_gives_the_same_bytes(sensor: str) -> None:
    recipe = {"sensor": sensor, "clutter": CLUTTER, "worn_m": 0.01, "blur_px": (3.0, 6.0), "warp_px": 0.05, "grain_px": 1.0}
    first, second, other = (view(seed, **recipe) for seed in (1, 1, 2))
    assert first.frame.depth_m.tobytes() == second.frame.depth_m.tobytes()
    assert first.frame.rgb.tobytes() == second.frame.rgb.tobytes()
    assert first.gravity_C.tolist() == second.gravity_C.tolist()
    assert first.frame.depth_m.tobytes() != other.frame.depth_m.tobytes()


@pytest.mark.parametrize("scene", STAIR_SCENES)
def test_the_heading_is_the_angle_between_nosings_and_chair(scene: str) -> None:
    for seed in range(4):
        seen = view(seed, scenes=(scene,), rock_deg=1.0, **IDEAL)
        truth = seen.stair
        e_B = seen.true_camera.R_BC @ truth.edge_C
        # ψ = atan2(-e·forward, e·right); the chair's right is -y.
        assert truth.heading_rad == pytest.approx(np.arctan2(-e_B[0], -e_B[1]), abs=1e-12)
        assert abs(truth.heading_rad) < 40.0 * DEG
        # Level, and pointing to the image's right.
        assert truth.edge_C @ seen.true_gravity_C == pytest.approx(0.0, abs=1e-12)
        assert truth.edge_C[0] > 0.0
        assert truth.slope_rad == pytest.approx(np.arctan2(truth.rise_m, truth.run_m))
        # The normal is square to the nosings, and by the slope from upright.
        assert truth.normal_C @ truth.edge_C == pytest.approx(0.0, abs=1e-12)
        assert -truth.normal_C @ seen.true_gravity_C == pytest.approx(np.cos(truth.slope_rad))
        gaps = np.diff(truth.nosings_B, axis=0) @ seen.true_camera.R_BC
        np.testing.assert_allclose(gaps @ truth.normal_C, 0.0, atol=1e-9)


@pytest.mark.parametrize("scene", STAIR_SCENES)
def test_nosings_in_view_stand_where_the_picture_shows_an_edge(scene: str) -> None:
    checked = 0
    for seed in range(6):
        seen = view(seed, scenes=(scene,), heading_deg=(-15.0, 15.0), **IDEAL)
        truth = seen.stair
        points = points_B(seen).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        for nosing in truth.nosings_B[truth.nosing_in_view]:
            if nosing[0] < 2.5:
                gaps = np.linalg.norm(points - nosing, axis=1)
                # Some pixel shows that point: pixels are 4 mm apart at 1 m, and far more on surfaces seen at a grazing angle.
                assert gaps.min() < 0.02
                checked += 1
    assert checked >= 4


@pytest.mark.parametrize("scene", ["up", "down", "foot", "edge"])
def test_walls_are_as_far_as_the_picture_shows(scene: str) -> None:
    checked = 0
    for seed in range(10):
        seen = view(seed, scenes=(scene,), walls=("both",), **IDEAL)
        truth = seen.stair
        # Along the nosings, which run square to the walls.
        aside = points_B(seen).reshape(-1, 3) @ (seen.true_camera.R_BC @ truth.edge_C)
        aside = aside[np.isfinite(aside)]
        for width_m, sign in ((truth.left_wall_m, -1.0), (truth.right_wall_m, 1.0)):
            if width_m is not None:
                # Beyond the wall's end the picture shows what lies further aside.
                assert np.abs(sign * aside - width_m).min() < 1e-6
                checked += 1
    assert checked >= 5


def shows(seen: View, kind: str) -> Bool[np.ndarray, "h w"]:
    """Return which pixels show a kind of thing."""
    is_kind = np.array([*(name == kind for name in seen.kinds), False])
    return is_kind[np.where(seen.exact.face >= 0, seen.exact.face // 6, len(seen.kinds))]


def test_an_obstacle_is_as_far_as_the_picture_shows() -> None:
    half = 0.375  # gauge 0.65 m and belts of 0.10 m
    checked = 0
    for seed in range(12):
        seen = view(seed, clutter=("bag",), heading_deg=(-10.0, 10.0), walls=("none",), **IDEAL)
        truth = seen.stair
        assert truth is not None
        points = points_B(seen)[shows(seen, "bag")]
        points = points[(np.abs(points[:, 1]) < half) & (points[:, 2] > 0.06)]
        if len(points) > 200:
            # The ground truth has a resolution of a centimetre, and includes sides out of view.
            assert truth.obstacle_m <= points[:, 0].min() + 0.01
            checked += truth.obstacle_m == pytest.approx(points[:, 0].min(), abs=0.02)
    assert checked >= 4


def test_gravity_has_the_requested_error() -> None:
    for seed in range(5):
        seen = view(seed, gravity_error_deg=0.5)
        off = np.arccos(np.clip(seen.gravity_C @ seen.true_gravity_C, -1.0, 1.0))
        assert off == pytest.approx(0.5 * DEG, rel=1e-4)


def test_a_mount_that_is_off_shows_in_the_picture_and_not_in_the_calibration() -> None:
    seen = view(1, mount_pitch_error_deg=(1.0, 1.0), mount_roll_error_deg=(-0.5, -0.5), gravity_error_deg=0.0, sensor="ideal")
    declared, true = seen.frame.camera, seen.true_camera
    assert (true.mount_pitch_rad - declared.mount_pitch_rad) / DEG == pytest.approx(1.0)
    assert (true.mount_roll_rad - declared.mount_roll_rad) / DEG == pytest.approx(-0.5)
    # The IMU is right about the chair, and the calibration wrong about the camera.
    np.testing.assert_allclose(declared.R_BC @ seen.gravity_C, true.R_BC @ seen.true_gravity_C, atol=1e-12)


def test_a_plain_view_is_what_the_plants_camera_sees() -> None:
    seen = view(4, walls=("none",), heading_deg=(0.0, 0.0), lateral_m=(0.0, 0.0), place_m=(1.0, 1.0), rise_m=(0.16, 0.16),
                slope_deg=(28.0, 28.0), width_m=(1.2, 1.2), **IDEAL)  # fmt: skip
    stair = Stair(rise_m=0.16, run_m=0.16 / np.tan(28.0 * DEG), steps=22, walls="none")
    staircase = build_staircase(stair, np.random.default_rng(0))
    calibration = read_chair("wheelchair").camera_at(240)
    R_WB = staircase.R_WS @ rotation_z(0.0)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([1.0, 0.0, 0.0])
    camera = Camera(staircase, calibration, kind="ideal", rng=np.random.default_rng(0))
    plant = camera.exact(R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m)).depth_m
    both = np.isfinite(plant) & np.isfinite(seen.exact.depth_m) & (plant < 2.5)
    assert both.mean() > 0.3
    np.testing.assert_allclose(seen.exact.depth_m[both], plant[both], atol=1e-9)


@pytest.mark.parametrize("scene", STAIRLESS_SCENES)
def test_a_place_without_a_stair_has_no_truth_of_one_but_depth(scene: str) -> None:
    seen = view(0, scenes=(scene,))
    assert seen.stair is None
    assert np.isfinite(seen.frame.depth_m).mean() > 0.25
    assert seen.frame.rgb.std() > 1.0


def test_grain_makes_neighbours_alike_and_no_noisier() -> None:
    white, grainy = (view(8, scenes=("floor",), grain_px=grain) for grain in (0.0, 2.0))
    errors = [(seen.frame.depth_m - seen.exact.depth_m) / seen.exact.depth_m**2 for seen in (white, grainy)]
    spread = [float(np.nanstd(error)) for error in errors]
    assert spread[1] == pytest.approx(spread[0], rel=0.1)
    alike = [float(np.nanmean(error[:, 1:] * error[:, :-1])) / size**2 for error, size in zip(errors, spread, strict=True)]
    assert abs(alike[0]) < 0.05
    assert alike[1] > 0.3


def test_warp_is_smooth_and_of_the_requested_size() -> None:
    seen = view(9, scenes=("floor",), warp_px=0.2)
    disparity = 575.0 * 0.075 * (1.0 / seen.frame.depth_m - 1.0 / seen.exact.depth_m)
    blocks = disparity[:240, :320].reshape(15, 16, 20, 16).swapaxes(1, 2).reshape(15, 20, 256)
    means = np.nanmean(blocks, axis=2)
    assert float(means.std()) == pytest.approx(0.2, rel=0.15)
    assert np.abs(np.diff(means, axis=1)).max() < 0.3


def test_holes_cover_the_requested_fraction() -> None:
    lost = np.isnan(view(3, scenes=("floor",), holes=0.4).frame.depth_m).mean()
    # Drop-outs of single pixels come on top.
    assert lost == pytest.approx(0.4, abs=0.02)


def test_a_drive_shows_one_flight_from_one_camera() -> None:
    drive = RecordedDrive(np.random.default_rng(2), ViewRecipe(mount_pitch_error_deg=(1.0, 1.0), walls=("both",), steps=(30, 30)))
    views = [drive.view(0.1 * i, drive.pose(along_m=0.1 * i, heading_rad=0.05 * i)) for i in range(4)]
    truths = [seen.stair for seen in views]
    assert len({truth.slope_rad for truth in truths if truth is not None}) == 1
    assert len({seen.true_camera for seen in views}) == 1
    for i, (seen, truth) in enumerate(zip(views, truths, strict=True)):
        assert seen.frame.t_s == pytest.approx(0.1 * i)
        assert truth.heading_rad == pytest.approx(0.05 * i)
        # The IMU's error stays as it is in the chair, to first order in half a degree.
        measured, true = seen.frame.camera.R_BC @ seen.gravity_C, seen.true_camera.R_BC @ seen.true_gravity_C
        assert np.arccos(np.clip(measured @ true, -1.0, 1.0)) < 0.51 * DEG
    # The stair comes nearer by as much as the chair goes, along the flight.
    at_start, later = (drive.view(0.0, drive.pose(along_m=distance_m, heading_rad=0.0)).stair for distance_m in (0.0, 0.1))
    assert at_start.nosings_B[-1, 0] - later.nosings_B[-1, 0] == pytest.approx(0.1)


# Shapes of steps and flights


SQUARE = IDEAL | {"heading_deg": (0.0, 0.0), "back_wall_deg": (0.0, 0.0)}


def square_view(seed: int, **recipe: object) -> View:
    return draw_view(np.random.default_rng(seed), ViewRecipe(**(SQUARE | recipe)))


def tread_front(seen: View, index: int, y_m: float) -> float:
    """Return where a visible nosing begins at a distance to the left of the chair, in the chair's level frame [m]."""
    truth = seen.stair
    up = -seen.true_camera.R_BC @ seen.true_gravity_C
    forward = np.cross(np.array([0.0, 1.0, 0.0]), up)
    points = points_B(seen).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    height = truth.nosings_B[index] @ up
    there = (np.abs(points @ up - height) < 1e-4) & (np.abs(points[:, 1] - y_m) < 0.01)
    return float((points[there] @ forward).min() - truth.nosings_B[index] @ forward)


@pytest.mark.parametrize("bow_m", [0.05, 0.15, -0.05])
def test_a_bowed_nosing_is_a_parabola_with_its_middle_in_place(bow_m: float) -> None:
    seen = square_view(1, bow_m=(bow_m, bow_m), lateral_m=(0.0, 0.0), width_m=(1.2, 1.2), walls=("none",), height_px=1080)
    assert seen.stair.bow_m == bow_m
    index = int(np.flatnonzero(seen.stair.nosing_in_view)[1])
    for y_m in (0.0, 0.2, -0.2, 0.35):
        # Rows are up to 5 mm apart on the tread, and the strip of 2 cm adds the slope of the parabola.
        expected = bow_m * (y_m / 0.6) ** 2
        assert tread_front(seen, index, y_m) == pytest.approx(expected, abs=0.008)


def test_a_narrow_flight_ends_with_a_drop_at_each_side() -> None:
    seen = square_view(3, width_m=(0.45, 0.45), walls=("none",), lateral_m=(0.05, 0.05))
    truth = seen.stair
    assert (truth.left_side, truth.right_side) == ("open", "open")
    assert truth.width_m == pytest.approx(0.45)
    assert truth.left_edge_m + 0.05 == pytest.approx(0.225)
    step = np.array([*(kind == "step" for kind in seen.kinds), False])[np.where(seen.exact.face >= 0, seen.exact.face // 6, -1)]
    across = points_B(seen)[step][:, 1]
    assert across.max() == pytest.approx(truth.left_edge_m, abs=0.01)
    assert across.min() == pytest.approx(-truth.right_edge_m, abs=0.01)


@pytest.mark.parametrize("band_m", [0.015, 0.03])
def test_bands_along_the_edges_have_no_depth(band_m: float) -> None:
    plain, holed = (square_view(5, sensor="kinect1", open_risers=True, edge_holes_m=m, height_px=480) for m in (0.0, band_m))
    truth = plain.stair
    assert truth.share == pytest.approx(holed.stair.share if holed.stair else 0.0, abs=0.002)
    points = points_B(plain)
    nosing = truth.nosings_B[truth.nosing_in_view][1]
    up = -plain.true_camera.R_BC @ plain.true_gravity_C
    forward = np.cross(np.array([0.0, 1.0, 0.0]), up)
    behind = (points - nosing) @ forward
    tread = (np.abs((points - nosing) @ up) < 1e-4) & (behind > 0.0)
    in_band, beyond = tread & (behind < band_m - 0.002), tread & (behind > band_m + 0.002) & (behind < 0.1)
    assert in_band.sum() > 100
    assert np.isfinite(holed.frame.depth_m[in_band]).mean() < 0.05
    assert np.isfinite(holed.frame.depth_m[beyond]).mean() > 0.9


@pytest.mark.parametrize("treads", ["grating", "glass", "glass_strips"])
def test_the_truth_of_a_stair_does_not_depend_on_what_its_treads_are_made_of(treads: str) -> None:
    solid, through = (square_view(6, open_risers=True, treads=word, walls=("none",)) for word in ("solid", treads))
    assert through.stair.share == solid.stair.share
    assert through.stair.treads_in_view == solid.stair.treads_in_view
    np.testing.assert_array_equal(through.stair.nosing_in_view, solid.stair.nosing_in_view)
    # The sensor sees through them.
    deeper = np.nan_to_num(through.exact.depth_m, nan=99.0) - np.nan_to_num(solid.exact.depth_m, nan=99.0)
    assert deeper.min() > -1e-9
    assert np.mean(deeper > 0.05) > 0.05
