"""Eq. (1)-(4) as printed, and the form that is exact for a level camera."""

import math

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import rotation_z
from treadline.perception.paper.printed_heading import delta_d, delta_x, heading_about, heading_as_printed, heading_of_edge, world_x

A, CENTRE = 1.0 / 575.0, 320.0


@pytest.mark.parametrize("heading_deg", [-35.0, -10.0, 0.0, 10.0, 35.0])
def test_the_heading_of_an_edge_is_exact_for_a_level_camera(heading_deg: float) -> None:
    along = np.array([-0.4, 0.4])
    depth = 2.0 - along * math.sin(heading_deg * DEG)
    column = CENTRE + along * math.cos(heading_deg * DEG) / (A * depth)
    left, right = (np.array([column[i], depth[i]]) for i in range(2))
    width = delta_x(left, right, A, CENTRE)
    heading = heading_of_edge(delta_d(depth[:1], depth[1:]), width)
    assert heading == pytest.approx(heading_deg * DEG, abs=1e-12)
    assert width == pytest.approx(
        world_x(float(right[0]), float(right[1]), A, CENTRE) - world_x(float(left[0]), float(left[1]), A, CENTRE)
    )


def test_the_printed_equation_2_has_no_answer_where_depth_exceeds_width() -> None:
    assert math.isnan(heading_as_printed(1.2, 1.0))


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (40.0, 0.0), (25.0, -7.0), (60.0, 12.0)])
@pytest.mark.parametrize("heading_deg", [-35.0, 0.0, 20.0])
def test_a_heading_about_the_chairs_z_needs_neither_pitch_nor_roll_of_the_mount(
    heading_deg: float, pitch_deg: float, roll_deg: float
) -> None:
    camera = PinholeCamera(
        width_px=320, height_px=240, fx_px=290.0, fy_px=290.0, cx_px=160.0, cy_px=120.0,
        mount_pitch_rad=pitch_deg * DEG, mount_roll_rad=roll_deg * DEG,
    )  # fmt: skip
    edge_B = rotation_z(-heading_deg * DEG) @ np.array([0.0, -1.0, 0.0])
    heading = heading_about(camera.R_BC.T @ np.array([0.0, 0.0, 1.0]), camera.R_BC.T @ edge_B)
    assert heading == pytest.approx(heading_deg * DEG, abs=1e-12)


def test_a_camera_looking_along_the_chairs_z_gives_no_heading() -> None:
    assert heading_about(np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])) is None
