"""Errors common to all surfaces of a frame: how they rotate planes and lines, and how a frame shows its kind of noise."""

import math

import numpy as np
import pytest
from jaxtyping import Float
from scenes import ViewRecipe, draw_view
from surfaces import CAMERA, ends_at, line_between, surface

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_y
from treadline.perception._nuisance import turns_of_lines, turns_of_surfaces
from treadline.perception._plane_segmentation import End, surface_blocks

# Literals, so that a changed value in the code is detected here.
RATE_RAD_S = 3.6 * DEG
READOUT_S = 0.033
SPEED_M_S = 0.09

RISER = rotation_y(25.0 * DEG) @ rotation_x(-23.6 * DEG) @ np.array([0.0, 0.0, 1.0])
"""Unit normal of a riser in C, of a camera that looks down."""


def rays(columns: Float[np.ndarray, " k"], rows: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    return np.column_stack([(columns - CAMERA.cx_px) / CAMERA.fx_px, (rows - CAMERA.cy_px) / CAMERA.fy_px, np.ones(columns.size)])


def motion_of(part: int) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Return angular velocity and velocity of the camera in C for one unit of a part of the motion."""
    if part == 3:
        return np.zeros(3), SPEED_M_S * CAMERA.R_BC[0]
    rate = RATE_RAD_S * np.eye(3)[part]
    return rate, CAMERA.R_BC.T @ np.cross(CAMERA.R_BC @ rate, np.array(CAMERA.mount_m))


@pytest.mark.parametrize("part", range(4))
def test_a_plane_in_rows_of_different_times_is_rotated_as_predicted(part: int) -> None:
    columns = np.arange(40, 280)
    upper, lower = (ends_at(columns, np.full(columns.size, row)) for row in (90.0, 150.0))
    seen = surface(RISER, 1.4, upper=upper, lower=lower)
    rate, velocity = motion_of(part)
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(40.0, 280.0, 8.0), np.array([90.0, 120.0, 150.0])))
    at = rays(u, v)
    after = READOUT_S * (v / CAMERA.height_px - 0.5)
    # A point P of the moved camera was at P + t (rate × P + velocity) at the time of the middle row.
    depth = (1.0 - after * float(seen.normal @ velocity)) / (at @ seen.normal + after * (np.cross(rate, at) @ seen.normal))
    fitted = np.linalg.lstsq(at, 1.0 / depth, rcond=None)[0]
    predicted = turns_of_surfaces([seen], CAMERA)[0, :, part - 5]
    # Second order: a rotation of 0.24° during the readout, squared, is 2e-5.
    np.testing.assert_allclose((fitted - seen.normal) * seen.distance_m, predicted, atol=6e-5)


@pytest.mark.parametrize("end", ["upper", "lower"])
def test_a_line_at_the_end_of_a_grown_surface_is_rotated_as_predicted(end: End) -> None:
    along = rotation_y(25.0 * DEG) @ np.array([1.0, 0.0, 0.0])
    points = np.array([[0.0, 0.4, 1.6] - 0.5 * along, [0.0, 0.4, 1.6] + 0.5 * along])
    normal = np.cross(points[1], points[0])
    normal /= np.linalg.norm(normal) * math.copysign(1.0, normal[1]) * -1.0
    line = line_between(points, normal, kind="edge", end=end)
    # A square window of 7 px reaches 3 px up or down, and 3 px to the side.
    aside = math.copysign(3.0 / CAMERA.fx_px, normal[0] * normal[1])
    shifted = points / points[:, 2:] + (1.0 if end == "lower" else -1.0) * np.array([aside, 3.0 / CAMERA.fy_px, 0.0])
    moved = np.cross(shifted[1], shifted[0])
    moved /= np.linalg.norm(moved) * math.copysign(1.0, moved[1]) * -1.0
    predicted = turns_of_lines([line], CAMERA, 3.0)[0, :, -1]
    # Second order: 4 px are an angle of 0.015, whose square is 2e-4.
    np.testing.assert_allclose(moved - normal, predicted, atol=3e-4)
    assert abs(float(predicted @ along)) > 1e-3


@pytest.mark.parametrize(("sensor", "measures_range"), [("kinect1", False), ("d435", False), ("tof", True), ("kinect2", True)])
def test_noise_over_depth_separates_time_of_flight_from_disparity(sensor: str, *, measures_range: bool) -> None:
    views = [draw_view(np.random.default_rng(seed), ViewRecipe(sensor=sensor)) for seed in range(58_000, 58_004)]
    found = [surface_blocks(view.frame.depth_m, view.frame.camera).measures_range for view in views]
    # A frame whose planes are all at one distance does not show the law.
    assert sum(found) >= 3 if measures_range else not any(found)


@pytest.mark.parametrize(("sensor", "window_px"), [("kinect1", 1.0), ("d435", 7.0)])
def test_noise_shows_the_width_of_the_matching_window(sensor: str, window_px: float) -> None:
    view = draw_view(np.random.default_rng(58_010), ViewRecipe(sensor=sensor, height_px=480))
    # Within 1 px of the window of the sensor model: the spread is half of it.
    assert surface_blocks(view.frame.depth_m, view.frame.camera).window_px == pytest.approx(window_px, abs=1.0)
