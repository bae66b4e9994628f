"""Views drawn from recipes: up, down, open, worn, cluttered, near the top and the foot; and places without a stair."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scenes.recipe import ROOM_SCENES, ViewRecipe
from scenes.views import StairTruth, draw_view
from sights import sights

from treadline.core.angles import DEG
from treadline.core.arrays import rms
from treadline.core.signals import StairMap
from treadline.perception import StairDetector

DETECTOR = StairDetector()


class Look(NamedTuple):
    """Values of a detection that outlive its frame; a detection itself holds 13 MB of images."""

    heading_rad: float | None
    sigma_rad: float | None
    accepted: bool
    stair_map: StairMap | None


@cache
def looked(recipe: ViewRecipe, seeds: range) -> list[tuple[StairTruth, Look]]:
    """Return truth and detection of each frame; frames of one recipe are drawn once for all tests."""
    return [
        (truth, Look(sight.heading_rad, sight.sigma_rad, sight.accepted, sight.stair_map))
        for _, truth, sight in sights(recipe, seeds)
    ]


def errors_and_strains(recipe: ViewRecipe, seeds: range) -> tuple[np.ndarray, np.ndarray, int]:
    """Return heading errors, the same over their declared deviation, and how many frames there were."""
    errors, strains = [], []
    for truth, sight in looked(recipe, seeds):
        if sight.heading_rad is not None and sight.sigma_rad is not None:
            errors.append(sight.heading_rad - truth.heading_rad)
            strains.append(errors[-1] / sight.sigma_rad)
    return np.array(errors), np.array(strains), len(looked(recipe, seeds))


FRAMES = range(31_000, 31_014)
KINDS = {
    "up": ViewRecipe(scenes=("up",)),
    "open": ViewRecipe(scenes=("up",), open_risers=True),
    "worn": ViewRecipe(scenes=("up",), worn_m=0.02),
    "rail": ViewRecipe(scenes=("up",), clutter=("rail_left", "rail_right"), walls=("none",)),
    "legs": ViewRecipe(scenes=("up",), clutter=("legs",)),
    "mat and bag": ViewRecipe(scenes=("up",), clutter=("mat", "bag")),
    "wet": ViewRecipe(scenes=("up",), clutter=("wet",)),
    "kinect2": ViewRecipe(scenes=("up",), sensor="kinect2"),
    "d435": ViewRecipe(scenes=("up",), sensor="d435", sigma_px=0.12, height_px=480),
    "top": ViewRecipe(scenes=("top",)),
    "down": ViewRecipe(scenes=("down",)),
    "down, open": ViewRecipe(scenes=("down",), open_risers=True),
    "edge": ViewRecipe(scenes=("edge",)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_heading_of_stairs_of_all_kinds(kind: str) -> None:
    errors, _, count = errors_and_strains(KINDS[kind], FRAMES)
    # The design asks for 0.20° RMSE up, 0.3° down, 95 % accepted and none beyond 3°; one of two dozen may be refused.
    assert len(errors) >= count - 1 >= 7
    assert rms(errors) < 0.15 * DEG
    assert np.abs(errors).max() < 0.6 * DEG


def test_what_lies_on_the_treads_costs_nothing() -> None:
    errors, _, count = errors_and_strains(ViewRecipe(scenes=("up",), clutter=("mat",)), range(71_000, 71_010))
    assert len(errors) >= count - 1
    # Seed 71002 was 3.7° off as long as a mat's edge counted as a nosing.
    assert np.abs(errors).max() < 0.3 * DEG


IRREGULAR = {"nosing_yaw_jitter_deg": 0.3, "tread_tilt_deg": 0.3}
# On perfect stairs motion and warp, which the camera may have, leave deviations of 0.05 to 0.06°, below the 0.2° of one as built;
# facing down they are half of the declared variance.
# Before the warp of a poorly calibrated camera was one of the unknowns, 0.05 px gave 0.28° and an interval that held 80 %.
INTERVALS = {
    "irregular, up": (ViewRecipe(scenes=("up",), **IRREGULAR), range(32_000, 32_060), 0.5, 0.35),
    "irregular, down": (ViewRecipe(scenes=("down",), **IRREGULAR), range(32_000, 32_060), 0.35, 0.35),
    "perfect, up": (KINDS["up"], range(32_100, 32_150), 0.0, 0.1),
    "perfect, top": (KINDS["top"], range(32_100, 32_150), 0.0, 0.1),
    "warped": (ViewRecipe(grain_px=1.2, warp_px=0.1), range(32_200, 32_250), 0.3, 0.35),
}


@pytest.mark.parametrize("kind", INTERVALS)
def test_intervals_are_true(kind: str) -> None:
    recipe, seeds, least, most_deg = INTERVALS[kind]
    errors, strains, count = errors_and_strains(recipe, seeds)
    assert len(errors) >= 0.93 * count
    assert np.median(errors / strains) < most_deg * DEG
    assert rms(errors) < 0.35 * DEG
    # Of 60 frames a mean square of 1 scatters by 0.18 (its tails are heavier than a normal's), 95 % by 2.8 %.
    assert least < np.mean(strains**2) < (1.5 if "perfect" in kind else 1.6)
    assert np.mean(np.abs(strains) < 1.96) > (0.9 if "perfect" in kind else 0.88)


@pytest.mark.parametrize(
    ("far_m", "height_px", "seeds", "least", "most"),
    [(4.0, 480, range(41_000, 41_008), 6, 4.0), (5.0, None, range(54_000, 54_014), 7, 3.0)],
)
def test_a_stereo_camera_sees_a_flight_from_far_away(
    far_m: float, height_px: int | None, seeds: range, least: int, most: float
) -> None:
    """Test: a D455 4 and 5 m before a flight, where noise turns the normals of blocks by 18°. Expected result: 6 of 8 and 7 of 14
    accepted, within 4 and 3 of their deviations of at most 1.5°; a mean squared strain below the 99.9 % quantile of that of 7."""
    far = ViewRecipe(sensor="d455", scenes=("foot",), place_m=(far_m, far_m), pitch_deg=(10.0, 10.0), height_px=height_px)
    views = [draw_view(np.random.default_rng(seed), far) for seed in seeds]
    looks = [(view.stair, DETECTOR.look(view.frame, view.gravity_C)) for view in views]
    seen = [(truth, sight) for truth, sight in looks if sight.accepted]
    strains = [(sight.heading_rad - truth.heading_rad) / sight.sigma_rad for truth, sight in seen]
    assert len(strains) >= least
    assert np.abs(strains).max() < most
    assert np.mean(np.square(strains)) < 3.5
    assert max(sight.sigma_rad for _, sight in seen) <= 1.5 * DEG


def test_a_side_wall_does_not_turn_the_heading() -> None:
    """Test: flights with a wall at the left. Expected result: an RMSE below 0.003°; pixels of the wall gave 0.005°."""
    errors, _, _ = errors_and_strains(ViewRecipe(height_px=480, walls=("left",)), range(41_100, 41_108))
    assert len(errors) >= 7
    assert rms(errors) < 0.003 * DEG


def test_a_bench_before_a_planter_has_no_step_below() -> None:
    """Test: seat and edge in step, with the floor three rises lower. Expected result: no heading; the step between is missing."""
    recipe = ViewRecipe(scenes=("street",), pitch_deg=(10.0, 50.0), lateral_m=(-0.5, 0.5), textures=("wood", "carpet", "terrazzo"))
    view = draw_view(np.random.default_rng(71_200_002), recipe)
    assert DETECTOR.look(view.frame, view.gravity_C).heading_rad is None


@pytest.mark.parametrize("pitch_deg", [None, 0.0, 15.0, 65.0])
@pytest.mark.parametrize("scene", ROOM_SCENES)
def test_a_scene_without_a_stair_yields_no_heading(scene: str, pitch_deg: float | None) -> None:
    pitch = {} if pitch_deg is None else {"pitch_deg": (pitch_deg, pitch_deg)}
    for seed in range(33_000, 33_003 if pitch_deg is None else 33_001):
        view = draw_view(np.random.default_rng(seed), ViewRecipe(scenes=(scene,), **pitch))
        for gravity_C in (view.gravity_C, None):
            sight = DETECTOR.look(view.frame, gravity_C)
            assert not sight.accepted, f"seed {seed}"
            assert sight.reason


@pytest.mark.parametrize(("scene", "least"), [("foot", 0.8), ("bottom", 0.7)])
def test_two_treads_in_view_are_enough(scene: str, least: float) -> None:
    seen = looked(ViewRecipe(scenes=(scene,)), range(34_700, 34_740))
    shown = [sight.accepted for truth, sight in seen if truth.treads_in_view >= 2]
    # 254 of 264 near the foot and all of 209 before it, of other seeds; of 30, 86 % are two deviations below that.
    assert np.mean(shown) >= 0.86
    assert len(shown) >= 24
    # Of the rest, the image shows one nosing: a doorstep before a wall looks the same. Walls begin level with the first riser.
    errors = [sight.heading_rad - truth.heading_rad for truth, sight in seen if sight.heading_rad is not None]
    assert len(errors) >= least * len(seen)
    assert np.abs(errors).max() < 1.0 * DEG


def maps(recipe: ViewRecipe, seeds: range) -> list[tuple[StairMap, StairTruth]]:
    return [(sight.stair_map, truth) for truth, sight in looked(recipe, seeds) if sight.stair_map is not None]


@pytest.mark.parametrize("kind", ["up", "open", "down", "edge", "top"])
def test_the_map_measures_the_stair(kind: str) -> None:
    slopes, rises, runs, nearest = [], [], [], []
    for seen, truth in maps(KINDS[kind], FRAMES):
        assert seen.direction == truth.direction
        slopes.append(seen.slope_rad - truth.slope_rad)
        rises.append(seen.rise_m - truth.rise_m)
        runs.append(seen.run_m - truth.run_m)
        gaps = np.linalg.norm(np.array(seen.nosings_B)[:, None] - truth.nosings_B, axis=2).min(axis=1, initial=np.inf)
        # Where the chair's middle plane leaves the stair there is no nosing to compare with.
        if gaps[0] < 0.1:
            nearest.append(gaps[0])
            assert gaps.max() < 0.05
    assert rms(np.array(slopes)) < 0.5 * DEG
    assert rms(np.array(rises)) < 0.008
    assert rms(np.array(runs)) < 0.008
    assert len(nearest) >= 5
    assert rms(np.array(nearest)) < 0.010


def test_the_end_of_a_flight_is_seen_and_never_imagined() -> None:
    seen = [(declared.ends, truth.end_in_view) for declared, truth in maps(*INTERVALS["perfect, top"][:2])]
    assert sum(reported for reported, there in seen if there) >= 0.8 * sum(there for _, there in seen) > 0
    within = [declared.ends for declared, truth in maps(*INTERVALS["perfect, up"][:2]) if not truth.end_in_view]
    assert len(within) >= 10
    assert not any(within)


def test_walls_are_as_far_as_they_are() -> None:
    off = []
    for declared, truth in maps(ViewRecipe(walls=("both",)), range(37_000, 37_020)):
        pairs = ((declared.left_wall_m, truth.left_wall_m), (declared.right_wall_m, truth.right_wall_m))
        off += [seen - there for seen, there in pairs if seen is not None and there is not None]
    assert len(off) >= 20
    assert np.abs(off).max() < 0.02


def test_obstacles_are_found_and_a_free_flight_is_free() -> None:
    assert {declared.obstacle_m for declared, _ in maps(ViewRecipe(), range(38_000, 38_012))} == {None}
    looked = maps(ViewRecipe(clutter=("legs",)), range(38_100, 38_130))
    reported = [(declared.obstacle_m, truth.obstacle_m) for declared, truth in looked if truth.obstacle_m is not None]
    found = np.array([seen - there for seen, there in reported if seen is not None])
    assert len(found) >= 0.9 * len(reported) >= 8
    assert np.median(np.abs(found)) < 0.03


def test_the_axes_are_correct_for_an_uncalibrated_mount() -> None:
    recipe = ViewRecipe(mount_pitch_error_deg=(-3.0, 3.0), mount_roll_error_deg=(-3.0, 3.0), gravity_error_deg=0.3)
    off_edge, off_normal = [], []
    for view, truth, sight in sights(recipe, range(39_000, 39_024)):
        axes = sight.axes
        if axes is None:
            continue
        off_edge.append(np.arccos(min(1.0, float(axes.edge_C @ truth.edge_C))))
        # The nosing plane's normal is the chair's z, as the true mount has it.
        off_normal.append(np.arccos(min(1.0, float(axes.normal_C @ view.true_camera.R_BC[2]))))
    assert len(off_edge) >= 20
    assert rms(np.array(off_edge)) < 0.3 * DEG
    assert rms(np.array(off_normal)) < 0.5 * DEG
