"""Frames and signs agree with docs/frames.md."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import attitude_of, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

X, Y, Z = np.eye(3)


def stair_axes(slope_deg: float) -> np.ndarray:
    return build_staircase(Stair(slope_deg=slope_deg), np.random.default_rng(0)).R_WS


def camera(pitch_deg: float) -> PinholeCamera:
    return PinholeCamera(
        width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5, mount_pitch_rad=pitch_deg * DEG
    )


def test_the_stairs_x_climbs_its_y_is_level_and_left_and_its_z_leans_back() -> None:
    R_WS = stair_axes(28.0)
    np.testing.assert_allclose(R_WS @ X, [math.cos(28 * DEG), 0.0, math.sin(28 * DEG)], atol=1e-12)
    np.testing.assert_allclose(R_WS @ Y, Y, atol=1e-12)
    np.testing.assert_allclose(R_WS @ Z, [-math.sin(28 * DEG), 0.0, math.cos(28 * DEG)], atol=1e-12)


@given(heading=st.floats(-89.0, 89.0), slope=st.floats(10.0, 44.0))
def test_yaw_is_the_heading_seen_along_gravity(heading: float, slope: float) -> None:
    R_WB = stair_axes(slope) @ rotation_z(heading * DEG)
    yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
    assert math.tan(yaw) == pytest.approx(math.tan(heading * DEG) / math.cos(slope * DEG), rel=1e-9)
    assert abs(yaw) >= abs(heading * DEG) - 1e-12


@pytest.mark.parametrize(("pitch_deg", "seen_deg"), [(0.0, 30.0), (25.0, 27.6), (40.0, 23.9)])
def test_a_camera_that_looks_down_sees_less_than_the_heading(pitch_deg: float, seen_deg: float) -> None:
    e_C = camera(pitch_deg).R_BC.T @ rotation_z(30.0 * DEG).T @ -Y
    assert math.atan2(-e_C[2], e_C[0]) / DEG == pytest.approx(seen_deg, abs=0.05)
    assert math.tan(seen_deg * DEG) == pytest.approx(math.tan(30.0 * DEG) * math.cos(pitch_deg * DEG), abs=2e-3)


def test_the_shipped_camera_looks_40_degrees_down() -> None:
    R_BC = read_chair("wheelchair").camera_at(240).R_BC
    np.testing.assert_allclose(R_BC @ Z, [math.cos(40 * DEG), 0.0, -math.sin(40 * DEG)], atol=1e-12)
    np.testing.assert_allclose(R_BC @ X, -Y, atol=1e-12)  # right in the image is the chair's right
    assert (R_BC @ Y) @ Z < 0.0  # down in the image is down


@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-1.2, 1.2), bank=st.floats(-1.2, 1.2))
def test_the_attitude_follows_from_yaw_and_the_elevations_of_two_axes(yaw: float, pitch: float, bank: float) -> None:
    """Test: a rotation, reduced to what the ground truth keeps of it. Expected: the same rotation."""
    R_WB = rotation_z(yaw) @ rotation_y(-pitch) @ rotation_x(bank)
    elevation_x, elevation_y = math.asin(R_WB[2, 0]), math.asin(R_WB[2, 1])
    back = attitude_of(np.array([yaw]), np.array([elevation_x]), np.array([elevation_y]))
    assert back.shape == (1, 4)
    # Two arcsines of up to 0.93: rounding grows by less than ten.
    np.testing.assert_allclose(rotation_of(back[0]), R_WB, atol=1e-12)
