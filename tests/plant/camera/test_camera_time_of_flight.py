"""Time of flight: noise against the specification, flying pixels, and multipath against an integral over the corner."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float, Int
from scenes import ViewRecipe
from scenes.views import calibration_of

from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.camera.depth_sensor import multipath_bias
from treadline.plant.sensors.camera.solids import upright
from treadline.scenario.chair import read_chair

CALIBRATION = calibration_of(ViewRecipe(sensor="tof"), read_chair("wheelchair"))
ALBEDO = 0.6


def camera(seed: int, colour: float) -> Camera:
    solids = [upright("floor", (-1.0, -1.0, -1.0), (1.0, 1.0, 0.0), colour=(colour,) * 3)] * 2
    return Camera(solids, CALIBRATION, kind="tof", rng=np.random.default_rng(seed))


def wall(distance_m: float) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    size = (CALIBRATION.height_px, CALIBRATION.width_px)
    return np.full(size, distance_m), np.zeros(size, dtype=np.int64)


def random_sigma_m(depth_m: Float[np.ndarray, "h w"]) -> float:
    """Return the standard deviation of the noise of the middle of the image, without the fixed pattern."""
    middle = depth_m[200:376, 220:420].astype(float)
    blocks = middle[:176, :200].reshape(22, 8, 25, 8).transpose(0, 2, 1, 3).reshape(-1, 64)
    return float(np.sqrt(np.nanmean(np.nanvar(blocks, axis=1))))


def test_noise_grows_with_range_and_keeps_the_specification() -> None:
    sigmas = [random_sigma_m(camera(1, 60.0).measured(*wall(distance_m), np.arange(2))) for distance_m in (0.6, 1.5, 2.5, 3.8)]
    assert sigmas == sorted(sigmas)
    # Tölgyessy et al., Sensors 21, 2021: standard deviation of at most 17 mm, as the manufacturer states.
    assert sigmas[-1] < 0.017
    # The camera's albedo is never below 0.35 in the infrared, so that the wall is lighter than the assumed 15 %.
    assert sigmas[-1] > 0.003


def test_pixels_lie_between_an_object_and_its_background() -> None:
    depth, face = wall(2.5)
    depth[:, 320:], face[:, 320:] = 1.5, 6
    seen = camera(2, 200.0).measured(depth, face, np.arange(2))
    between = (seen > 1.6) & (seen < 2.4)
    # At the edge, on both sides of it, and nowhere else (Wasenmüller and Stricker 2016).
    assert between[:, 319:321].mean() > 0.3
    assert between.sum() == between[:, 319:321].sum()
    assert np.isfinite(seen[:, 319:321]).mean() > 0.9


def corner(
    depth_m: float, floor_m: float, *, right: bool = True
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Float[np.ndarray, " 2"]]:
    """Return a wall ahead that meets a floor below at a right angle."""
    v = (np.arange(CALIBRATION.height_px)[:, None] - CALIBRATION.cy_px) / CALIBRATION.fy_px
    floor = np.where(v > 0.0, floor_m / np.maximum(v, 1e-9), np.inf)
    on_floor = np.broadcast_to(floor < depth_m, (CALIBRATION.height_px, CALIBRATION.width_px)) & right
    depth = np.where(on_floor, np.broadcast_to(floor, on_floor.shape), depth_m)
    return depth, np.where(on_floor, 6, 0).astype(np.int64), np.array([ALBEDO, ALBEDO])


def test_a_single_surface_has_no_multipath() -> None:
    depth, face, albedos = corner(1.5, 0.5, right=False)
    np.testing.assert_allclose(multipath_bias(CALIBRATION, depth, face, albedos), 0.0, atol=1e-12)


def integral_m(point: Float[np.ndarray, " 3"], normal: Float[np.ndarray, " 3"], depth_m: float, floor_m: float) -> float:
    """Return the range bias of a point on the wall by a fine sum over the part of the floor in the image."""
    step = 0.004
    z, x = np.meshgrid(np.arange(0.5 * step, depth_m, step), np.arange(-2.0, 2.0, step), indexing="ij")
    v, u = floor_m / z * CALIBRATION.fy_px + CALIBRATION.cy_px, x / z * CALIBRATION.fx_px + CALIBRATION.cx_px
    inside = (v < CALIBRATION.height_px) & (u >= 0) & (u < CALIBRATION.width_px)
    floor = np.stack([x[inside], np.full(inside.sum(), floor_m), z[inside]], axis=1)
    ranges, own = np.linalg.norm(floor, axis=1), float(np.linalg.norm(point))
    light, own_light = floor_m / ranges**3, float(normal @ point) / own**3
    leg = point - floor
    square = np.sum(leg**2, axis=1)
    form = (-leg[:, 1]) * (leg @ normal) / (np.pi * square**2) * step**2
    share = ALBEDO * light / own_light * form
    detour = 0.5 * (ranges + np.sqrt(square) - own)
    wave = 4.0 * np.pi * 80e6 / 299_792_458.0
    return float(np.angle(1.0 + np.sum(share * np.exp(1j * wave * detour))) / wave)


@pytest.mark.parametrize("above_m", [0.10, 0.20, 0.35])
def test_multipath_of_a_corner_is_the_integral_over_its_other_surface(above_m: float) -> None:
    """Test: Lambertian single bounce (Jiménez et al. 2014). Expected: within 20 %, because patches are 8 cm wide at 1.6 m."""
    depth_m, floor_m = 1.6, 0.6
    depth, face, albedos = corner(depth_m, floor_m)
    bias = multipath_bias(CALIBRATION, depth, face, albedos)
    point = np.array([0.0, floor_m - above_m, depth_m])
    v = round(point[1] / depth_m * CALIBRATION.fy_px + CALIBRATION.cy_px)
    expected = integral_m(point, np.array([0.0, 0.0, 1.0]), depth_m, floor_m) * depth_m / float(np.linalg.norm(point))
    assert bias[v, round(CALIBRATION.cx_px)] == pytest.approx(expected, rel=0.2)
    # A few centimetres at most, and always too deep.
    assert 0.002 < expected < 0.05


def test_dark_surfaces_have_less_multipath() -> None:
    depth, face, albedos = corner(1.6, 0.6)
    light, dark = (multipath_bias(CALIBRATION, depth, face, share * albedos) for share in (1.0, 0.3))
    assert dark.max() < 0.4 * light.max()


def test_the_bias_of_a_smaller_image_is_the_same() -> None:
    depth, face, albedos = corner(1.6, 0.6)
    half = replace(
        CALIBRATION,
        width_px=320,
        height_px=288,
        fx_px=0.5 * CALIBRATION.fx_px,
        fy_px=0.5 * CALIBRATION.fy_px,
        cx_px=0.5 * CALIBRATION.cx_px,
        cy_px=0.5 * CALIBRATION.cy_px,
    )
    large = multipath_bias(CALIBRATION, depth, face, albedos)[::2, ::2]
    small = multipath_bias(half, np.ascontiguousarray(depth[::2, ::2]), np.ascontiguousarray(face[::2, ::2]), albedos)
    # Patches are the same; their middles differ by half a pixel.
    assert np.abs(small - large).max() < 0.15 * large.max()
