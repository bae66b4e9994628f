"""Shapes of steps and flights: bowed nosings, bands without depth, narrow open flights, curved flights and winders."""

import numpy as np
import pytest
from jaxtyping import Float
from scenes import View, ViewRecipe, draw_view

IDEAL: dict[str, object] = {"sensor": "ideal", "gravity_error_deg": 0.0, "heading_deg": (0.0, 0.0), "back_wall_deg": (0.0, 0.0)}


def view(seed: int, **recipe: object) -> View:
    return draw_view(np.random.default_rng(seed), ViewRecipe(**(IDEAL | recipe)))


def points_B(seen: View) -> Float[np.ndarray, "h w 3"]:
    camera = seen.true_camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(u.shape)], axis=-1)
    return (rays * seen.exact.depth_m[:, :, None]) @ camera.R_BC.T + np.array(camera.mount_m)


def tread_front(seen: View, index: int, y_m: float) -> float:
    """Return where a visible nosing begins at a distance to the left of the chair, in the chair's level frame [m]."""
    truth = seen.stair
    assert truth is not None
    up = -seen.true_camera.R_BC @ seen.true_gravity_C
    forward = np.cross(np.array([0.0, 1.0, 0.0]), up)
    points = points_B(seen).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    height = truth.nosings_B[index] @ up
    there = (np.abs(points @ up - height) < 1e-4) & (np.abs(points[:, 1] - y_m) < 0.01)
    return float((points[there] @ forward).min() - truth.nosings_B[index] @ forward)


@pytest.mark.parametrize("bow_m", [0.05, 0.15, -0.05])
def test_a_bowed_nosing_is_a_parabola_with_its_middle_in_place(bow_m: float) -> None:
    seen = view(1, bow_m=(bow_m, bow_m), lateral_m=(0.0, 0.0), width_m=(1.2, 1.2), walls=("none",), height_px=1080)
    assert seen.stair is not None
    assert seen.stair.bow_m == bow_m
    index = int(np.flatnonzero(seen.stair.nosing_in_view)[1])
    for y_m in (0.0, 0.2, -0.2, 0.35):
        # Rows are up to 5 mm apart on the tread, and the strip of 2 cm adds the slope of the parabola.
        expected = bow_m * (y_m / 0.6) ** 2
        assert tread_front(seen, index, y_m) == pytest.approx(expected, abs=0.008)


def test_the_truth_of_a_bowed_nosing_lies_on_the_surface_beside_the_middle() -> None:
    seen = view(2, bow_m=(0.15, 0.15), lateral_m=(0.3, 0.3), width_m=(1.2, 1.2), walls=("none",), heading_deg=(12.0, 12.0))
    assert seen.stair is not None
    points = points_B(seen).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    near = seen.stair.nosings_B[seen.stair.nosing_in_view & (seen.stair.nosings_B[:, 0] < 2.0)]
    assert len(near) >= 2
    assert max(np.linalg.norm(points - nosing, axis=1).min() for nosing in near) < 0.01


def test_a_narrow_flight_ends_with_a_drop_at_each_side() -> None:
    seen = view(3, width_m=(0.45, 0.45), walls=("none",), lateral_m=(0.05, 0.05))
    truth = seen.stair
    assert truth is not None
    assert (truth.left_side, truth.right_side) == ("open", "open")
    assert truth.width_m == pytest.approx(0.45)
    assert truth.left_edge_m + 0.05 == pytest.approx(0.225)
    step = np.array([*(kind == "step" for kind in seen.kinds), False])[np.where(seen.exact.face >= 0, seen.exact.face // 6, -1)]
    across = points_B(seen)[step][:, 1]
    assert across.max() == pytest.approx(truth.left_edge_m, abs=0.01)
    assert across.min() == pytest.approx(-truth.right_edge_m, abs=0.01)


@pytest.mark.parametrize("band_m", [0.015, 0.03])
def test_bands_along_the_edges_have_no_depth(band_m: float) -> None:
    plain, holed = (view(5, sensor="kinect1", open_risers=True, edge_holes_m=m, height_px=480) for m in (0.0, band_m))
    truth = plain.stair
    assert truth is not None
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
    solid, through = (view(6, open_risers=True, treads=word, walls=("none",)) for word in ("solid", treads))
    assert solid.stair is not None
    assert through.stair is not None
    assert through.stair.share == solid.stair.share
    assert through.stair.treads_in_view == solid.stair.treads_in_view
    np.testing.assert_array_equal(through.stair.nosing_in_view, solid.stair.nosing_in_view)
    # The sensor sees through them.
    deeper = np.nan_to_num(through.exact.depth_m, nan=99.0) - np.nan_to_num(solid.exact.depth_m, nan=99.0)
    assert deeper.min() > -1e-9
    assert np.mean(deeper > 0.05) > 0.05


def test_a_runner_is_8_mm_higher_than_its_treads() -> None:
    seen = view(7, runner=True, lateral_m=(0.0, 0.0), walls=("none",))
    assert seen.stair is not None
    up = -seen.true_camera.R_BC @ seen.true_gravity_C
    heights = (points_B(seen) - seen.stair.nosings_B[seen.stair.nosing_in_view][0]) @ up
    assert np.mean(np.abs(heights - 0.008) < 1e-5) > 0.03
    assert np.mean(np.abs(heights) < 1e-5) > 0.002


def test_steps_of_a_curved_flight_turn_by_run_over_radius() -> None:
    seen = view(8, radius_m=(4.0, 4.0), walls=("none",), run_m=(0.28, 0.28))
    assert seen.stair is not None
    assert abs(seen.stair.curvature_1_m) == pytest.approx(0.25)
    step_of = np.array([*seen.kinds, ""])[np.where(seen.exact.face >= 0, seen.exact.face // 6, -1)]
    assert (step_of == "step").mean() > 0.15
    # The chair stands on the part of the arc that keeps its direction.
    assert seen.stair.heading_rad == pytest.approx(0.0, abs=1e-9)
    # Nosings ahead come nearer to each other or further apart where they cross the chair's middle plane, but stay ahead.
    gaps = np.diff(seen.stair.nosings_B[:4, 0])
    assert gaps.min() > 0.2


def test_winders_turn_a_quarter_ahead_of_a_straight_part() -> None:
    seen = view(9, winder_radius_m=(0.7, 0.7), walls=("both",))
    assert seen.stair is not None
    assert abs(seen.stair.curvature_1_m) == pytest.approx(1.0 / 0.7)
    # A flight walled on both sides has no gap between the pieces of its walls.
    assert np.isnan(seen.exact.depth_m).mean() < 0.01


def test_shapes_that_cannot_be_combined_are_refused_with_their_names() -> None:
    with pytest.raises(ValueError, match="bow_m with treads is not supported; give one of them"):
        ViewRecipe(bow_m=(0.05, 0.05), treads="glass")
