"""Active stereo and the Kinect 1's correlation window: noise, occlusion and edges against published characteristics."""

import numpy as np
import pytest
from jaxtyping import Float, Float32, Int
from scenes import SceneCamera, ViewRecipe
from scenes.views import calibration_of

from treadline.plant.sensors.camera.solids import upright
from treadline.scenario.chair import read_chair

CHAIR = read_chair("wheelchair")
FOCAL_PX = 387.0
"""Focal length of a D435 or D455 at 640×480 [px] (field of view of 79.2°)."""
BASELINES_M = {"d435": 0.050, "d455": 0.095}


def camera(seed: int, kind: str, *, height_px: int = 480, sigma_px: float | None = None, edge_holes: bool = False) -> SceneCamera:
    calibration = calibration_of(ViewRecipe(sensor=kind, height_px=height_px), CHAIR)
    solids = [upright("floor", (-1.0, -1.0, -1.0), (1.0, 1.0, 0.0), colour=(255.0, 255.0, 255.0))] * 2
    rng = np.random.default_rng(seed)
    return SceneCamera(solids, calibration, kind=kind, sigma_px=sigma_px, edge_holes=edge_holes, rng=rng)


def measured(seen: SceneCamera, depth: Float[np.ndarray, "h w"], face: Int[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    return seen.measured(depth, face, np.arange(2))


def wall(seen: SceneCamera, distance_m: float) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    size = (seen.calibration.height_px, seen.calibration.width_px)
    return np.full(size, distance_m), np.zeros(size, dtype=np.int64)


def post(
    seen: SceneCamera, near_m: float, far_m: float, left: int, right: int
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    depth, face = wall(seen, far_m)
    depth[:, left:right], face[:, left:right] = near_m, 6
    return depth, face


@pytest.mark.parametrize("kind", ["d435", "d455"])
@pytest.mark.parametrize("sigma_px", [0.05, 0.12])
@pytest.mark.parametrize("distance_m", [0.7, 3.0])
def test_depth_noise_grows_with_the_square_of_distance(kind: str, sigma_px: float, distance_m: float) -> None:
    """Expected: Z²·σ/(f·B) (Keselman et al. 2017, eq. 2), and the steps of 1/32 px add their own."""
    seen = camera(1, kind, sigma_px=sigma_px)
    errors = measured(seen, *wall(seen, distance_m)) - distance_m
    sigma_m = distance_m**2 * np.hypot(sigma_px, 1.0 / 32.0 / np.sqrt(12.0)) / (FOCAL_PX * BASELINES_M[kind])
    # Windows of 7×7 leave 6,000 independent values, whose spread is known to 1 %; a step is not small next to 0.05 px.
    assert np.nanstd(errors) == pytest.approx(sigma_m, rel=0.05)
    assert abs(np.nanmean(errors)) < 0.3 * sigma_m


def test_the_default_noise_keeps_the_accuracy_of_the_data_sheet() -> None:
    # D435: less than 2 % at 2 m; D455: less than 2 % at 4 m.
    for kind, distance_m in (("d435", 2.0), ("d455", 4.0)):
        seen = camera(2, kind)
        errors = measured(seen, *wall(seen, distance_m)) - distance_m
        assert np.sqrt(np.nanmean(errors**2)) < 0.02 * distance_m


def test_noise_is_alike_over_the_matching_window_and_not_beyond() -> None:
    seen = camera(3, "d435")
    errors = measured(seen, *wall(seen, 1.0))[:, 60:] - 1.0
    errors = np.where(np.isfinite(errors), errors, 0.0)

    def likeness(lag: int) -> float:
        return float(np.corrcoef(errors[:, :-lag].ravel(), errors[:, lag:].ravel())[0, 1])

    # Matches of windows of 7 px share (7 - lag)/7 of their pixels; the steps of 1/32 px are white.
    assert likeness(3) == pytest.approx(4.0 / 7.0, abs=0.06)
    assert abs(likeness(8)) < 0.05


@pytest.mark.parametrize("kind", ["d435", "d455"])
def test_a_band_at_the_left_border_has_no_depth(kind: str) -> None:
    seen = camera(4, kind)
    lost = np.isnan(measured(seen, *wall(seen, 1.0))).mean(axis=0)
    # D400 data sheet, section 4.5: the band is f·B/Z pixels wide.
    band = FOCAL_PX * BASELINES_M[kind] / 1.0
    assert lost[: int(band) - 1].min() == 1.0
    assert lost[int(band) + 2 :].max() < 0.05


@pytest.mark.parametrize(("kind", "height_px"), [("d435", 480), ("d455", 480), ("d455", 240)])
def test_background_left_of_an_object_is_hidden_from_the_right_imager(kind: str, height_px: int) -> None:
    seen = camera(5, kind, height_px=height_px)
    columns = seen.calibration.width_px
    left, right = columns // 2, columns // 2 + columns // 8
    depth = measured(seen, *post(seen, 1.0, 2.0, left, right))
    scale = columns / 640.0
    hidden_px = FOCAL_PX * BASELINES_M[kind] * (1.0 / 1.0 - 1.0 / 2.0) * scale
    fat_px = 3.0 * scale  # half of the window of 7
    holes = np.isnan(depth).mean(axis=0)
    # The object grows over a part of the hidden strip. One pixel is left for rounding at each end.
    assert np.count_nonzero(holes[left - int(hidden_px) - 10 : left] > 0.5) == pytest.approx(hidden_px - fat_px, abs=2.0)
    assert holes[right : right + 30].max() < 0.1


def test_objects_grow_by_half_of_the_window_on_each_side() -> None:
    seen = camera(6, "d435")
    depth, face = post(seen, 1.0, 2.0, 300, 380)
    depth[:200], face[:200] = 2.0, 0
    found = measured(seen, depth, face) < 1.3
    assert np.count_nonzero(found[300]) == 80 + 2 * 3
    # The same above the object.
    assert np.flatnonzero(found[:, 340]).min() == 200 - 3


def test_most_of_a_white_wall_has_depth_at_2_m_and_half_at_twice_the_ideal_range() -> None:
    seen = camera(7, "d435")
    share = [np.isfinite(measured(seen, *wall(seen, distance_m))[160:320, 213:427]).mean() for distance_m in (2.0, 6.0)]
    # 99 % of an ideal white wall at 2 m. White paint has an albedo of 0.85, which costs 0.17 standard deviations; 700
    # independent windows leave 0.5 % and 2 %.
    assert share[0] > 0.975
    assert share[1] == pytest.approx(0.43, abs=0.06)


def test_a_kinect_loses_the_pixels_whose_window_holds_an_edge() -> None:
    seen = camera(8, "kinect1", edge_holes=True)
    depth, face = wall(seen, 2.0)
    depth[200:280], face[200:280] = 1.2, 6
    holes = np.isnan(measured(seen, depth, face)).mean(axis=1)
    # Windows of 9 px straddle an edge at 8 places. In two recorded frames the holes along columns have a median of 9 px.
    for edge in (200, 280):
        assert np.count_nonzero(holes[edge - 12 : edge + 12] > 0.9) == 8
    plain = camera(8, "kinect1")
    assert np.isnan(measured(plain, depth, face)).mean(axis=1).max() < 0.6
