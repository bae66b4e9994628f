"""The camera's noise: what a Kinect 1 makes of exact depth, and what light and texture do to colour."""

import numpy as np
import pytest
from jaxtyping import Float, Float32
from scenes import ViewRecipe, draw_view
from surfaces import frame_of

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import rotation_z
from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.camera.solids import Shadow, upright
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

CALIBRATION = read_chair("wheelchair").camera_at(240)
DISPARITY_PX_M = 575.0 * 0.075


def camera(seed: int, *, kind: str = "kinect1", height_px: int = 240) -> Camera:
    staircase = build_staircase(Stair(slope_deg=28.0), np.random.default_rng(0))
    return Camera(staircase, read_chair("wheelchair").camera_at(height_px), kind=kind, rng=np.random.default_rng(seed))


def frame(seed: int, *, texture: str = "wood", light: float = 1.0, kind: str = "kinect1", height_px: int = 240) -> RgbdFrame:
    staircase = build_staircase(Stair(slope_deg=28.0), np.random.default_rng(0))
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([1.5, 0.0, 0.0])
    looks = {"kind": kind, "texture": texture, "light": light}
    calibration = read_chair("wheelchair").camera_at(height_px)
    return frame_of(staircase, calibration, staircase.R_WS @ rotation_z(10.0 * DEG), p_WB, seed, **looks)[0]


def measured(depth_m: Float[np.ndarray, "h w"], seed: int, kind: str = "kinect1") -> Float32[np.ndarray, "h w"]:
    return camera(seed, kind=kind).measured(depth_m, np.zeros(depth_m.shape, dtype=np.int64), np.arange(1))


def wall(distance_m: float) -> Float[np.ndarray, "h w"]:
    return np.full((CALIBRATION.height_px, CALIBRATION.width_px), distance_m)


@pytest.mark.parametrize(("distance_m", "sigma_mm"), [(1.0, 1.4), (2.0, 5.7), (3.0, 12.8), (4.0, 22.8)])
def test_a_wall_is_as_noisy_as_a_kinect_shows_it(distance_m: float, sigma_mm: float) -> None:
    """Khoshelham and Elberink 2012: σ_Z = 1.425e-5 Z² cm (about 1.4 mm at 1 m, 4 cm at 5 m)."""
    # Steps of 1/8 px are coarser than the noise, so the spread depends on where between two steps the wall falls:
    # averaged over a step it is the sum of both, within the tolerance of 20 %.
    step_m = 0.125 * distance_m**2 / DISPARITY_PX_M
    errors = [
        measured(wall(near), seed) - near
        for seed, near in enumerate(distance_m + step_m * np.linspace(-0.5, 0.5, 6, endpoint=False))
    ]
    assert np.nanstd(np.stack(errors)) * 1e3 == pytest.approx(sigma_mm, rel=0.2)


def test_disparity_comes_in_steps_of_an_eighth_of_a_pixel() -> None:
    steps = 8.0 * DISPARITY_PX_M / frame(1).depth_m.astype(float)
    # Single precision holds depth to 6e-8, and there are some 800 steps.
    assert np.nanmax(np.abs(steps - np.round(steps))) < 1e-3


def test_a_wall_seen_out_of_range_gives_no_depth() -> None:
    for distance_m, inside in ((0.40, False), (0.50, True), (5.8, True), (6.1, False)):
        assert np.isfinite(measured(wall(distance_m), 2)).any() == inside


def test_a_flat_wall_loses_a_few_pixels_in_a_thousand() -> None:
    # 0.2 % of 76 800 pixels: four standard deviations of a count of 154 are 50.
    assert np.mean(np.isnan(measured(wall(2.0), 3))) == pytest.approx(0.002, abs=0.0007)


def test_a_surface_at_a_grazing_angle_loses_many_pixels() -> None:
    grazing = wall(1.0) * 1.06 ** np.arange(CALIBRATION.height_px)[:, None] / 1.0
    inside = (grazing > 1.0) & (grazing < 4.5)
    assert np.mean(np.isnan(measured(grazing, 4))[inside]) > 0.15


def test_edges_waver_but_flat_surfaces_do_not() -> None:
    depth, face = wall(2.0), np.zeros(wall(2.0).shape, dtype=np.int64)
    depth[:, 160:], face[:, 160:] = 2.4, 1
    near = camera(14).measured(depth, face, np.arange(2)) < 2.2
    # Half a pixel of jitter (0.8 at 640 columns, 0.4 here, in whole pixels) trades places at the edge only.
    assert 0.01 < near[:, 160].mean() < 0.5
    assert near[:, 165:].sum() == 0


def test_the_shadow_of_an_edge_lies_on_its_left_as_in_recorded_frames() -> None:
    depth = wall(2.0)
    depth[:, 140:180] = 1.0
    holes = np.isnan(measured(depth, 5)).mean(axis=0)
    # f·B (1/1 m - 1/2 m) of this image is 10.8 columns of wall that the projector does not reach.
    assert holes[130:138].min() > 0.9
    assert holes[:125].max() < 0.1
    assert holes[184:].max() < 0.1
    assert holes[145:175].max() < 0.1


def block_residuals(seen: RgbdFrame) -> Float[np.ndarray, "b 2"]:
    """Return the RMS residual [1/m] of a plane and the distance, for each whole block of 16×16 pixels without a hole."""
    c = seen.camera
    v, u = np.mgrid[: c.height_px, : c.width_px]
    rays = np.stack([(u - c.cx_px) / c.fx_px, (v - c.cy_px) / c.fy_px, np.ones(u.shape)], axis=-1)
    rows, columns = c.height_px // 16 * 16, c.width_px // 16 * 16
    found = []
    for top in range(0, rows, 16):
        for left in range(0, columns, 16):
            depth = seen.depth_m[top : top + 16, left : left + 16].astype(float).ravel()
            if np.isfinite(depth).all():
                A = rays[top : top + 16, left : left + 16].reshape(-1, 3)
                plane = np.linalg.lstsq(A, 1.0 / depth, rcond=None)[0]
                found.append((float(np.sqrt(np.mean((A @ plane - 1.0 / depth) ** 2))), float(depth.mean())))
    return np.array(found)


def test_planes_fit_a_large_frame_as_tightly_as_recorded_ones() -> None:
    residuals = block_residuals(frame(6, height_px=480))[:, 0] * DISPARITY_PX_M
    # Blocks on one face; blocks across an edge have far more. Recorded Kinect frames have 0.055 to 0.075 px.
    assert 0.055 < float(np.median(residuals[residuals < 0.16])) < 0.075


@pytest.mark.parametrize(("near_m", "far_m", "recorded_mm"), [(0.5, 0.9, (1.39, 1.66)), (0.9, 1.2, (1.60, 2.01))])
def test_planes_fit_a_kinect_2_frame_as_tightly_as_recorded_ones(
    near_m: float, far_m: float, recorded_mm: tuple[float, float]
) -> None:
    recipe = ViewRecipe(sensor="kinect2", scenes=("up", "foot"), heading_deg=(-15.0, 15.0), textures=("carpet",))
    found = np.vstack([block_residuals(draw_view(np.random.default_rng(seed), recipe).frame) for seed in range(3)])
    inside = (found[:, 0] * DISPARITY_PX_M < 0.16) & (found[:, 1] > near_m) & (found[:, 1] < far_m)
    # Lower quartile to median of two recorded frames of a carpeted stair, by distance.
    assert recorded_mm[0] < float(np.median(found[inside, 0] * found[inside, 1] ** 2)) * 1e3 < recorded_mm[1]


def test_consecutive_frames_have_fresh_noise() -> None:
    seen, face = camera(9), np.zeros(wall(2.0).shape, dtype=np.int64)
    first, second = (seen.measured(wall(2.0), face, np.arange(1)) for _ in range(2))
    assert np.nanmean(first == second) < 0.9


def test_light_scales_colour_but_not_depth() -> None:
    bright, dim = frame(11), frame(11, light=0.5)
    assert bright.depth_m.tobytes() == dim.depth_m.tobytes()
    # 3 %: values are whole numbers and the noise has a part that does not scale.
    assert dim.rgb.mean() / bright.rgb.mean() == pytest.approx(0.5, rel=0.03)


def test_a_kinect_2_is_finer_and_has_no_steps() -> None:
    errors = measured(wall(2.0), 13, kind="kinect2") - 2.0
    # Recorded frames of 1.2 to 2 m have residuals of 1.8 mm in their better blocks; a surface 2 m away gives back a quarter
    # of the light of one at 1 m.
    assert 1.8 < np.nanstd(errors) * 1e3 < 4.0
    # Not in steps: as many depths as pixels, but for the precision of a float at 2 m.
    assert len(np.unique(errors)) > 0.3 * errors.size


def test_a_kinect_2_sees_less_of_what_is_dark_grazing_or_far() -> None:
    spreads = [np.nanstd(measured(wall(distance_m), 14, kind="kinect2")) for distance_m in (1.0, 2.0, 4.0)]
    assert spreads[0] < spreads[1] < spreads[2]


def test_pixels_of_a_kinect_2_mix_at_an_edge_and_only_there() -> None:
    depth, face = wall(1.5), np.zeros(wall(1.5).shape, dtype=np.int64)
    depth[:, :160], face[:, :160] = 2.5, 1
    seen = camera(15, kind="kinect2").measured(depth, face, np.arange(2))
    mixed = (seen > 1.6) & (seen < 2.4)
    assert mixed[:, 158:162].mean() > 0.05
    assert mixed.sum() == mixed[:, 158:162].sum()
    assert np.isnan(seen[:, 158:162]).mean() > 0.2


def test_a_shadow_darkens_colour_and_leaves_depth() -> None:
    solids = [upright("step", (0.0, -2.0, -0.2), (4.0, 2.0, 0.0))]
    shadow = Shadow(normal_W=(1.0, 0.0, 0.0), level_m=1.3, half_m=0.1)
    plain, shaded = (
        Camera(solids, CALIBRATION, rng=np.random.default_rng(1))
        .facing((), shadows)
        .frame(0.0, CALIBRATION.R_BC, np.array([0.4, 0.0, 0.8]))
        for shadows in ((), (shadow,))
    )
    np.testing.assert_array_equal(plain.depth_m, shaded.depth_m)
    darker = shaded.rgb.mean(axis=2) < 0.7 * plain.rgb.mean(axis=2)
    rows = np.flatnonzero(darker.mean(axis=1) > 0.9)
    # 1.3 m ahead on the floor, 0.9 m from the camera and 0.8 m below it, seen with the camera 40° down.
    angle = np.arctan2(0.8, 0.9) - 40.0 * DEG
    assert 119.5 + 287.5 * np.tan(angle) == pytest.approx(rows.mean(), abs=3.0)
    assert darker.mean() < 0.2
