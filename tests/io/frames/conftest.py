"""Frames with known truth, and their point clouds."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG, rotation_z
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.plant.sensors.camera import Camera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

Rendered = Callable[..., RgbdFrame]


def rendered_frame(seed: int = 1, heading_deg: float = 12.0, *, kind: str = "kinect1") -> RgbdFrame:
    """Return a frame seen from a flight of 28°, and down in C."""
    rng = np.random.default_rng(seed)
    staircase = build_staircase(Stair(slope_deg=28.0), rng)
    calibration = read_chair("wheelchair").camera_at(240)
    R_WB = staircase.R_WS @ rotation_z(heading_deg * DEG)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([1.0, 0.0, 0.0])
    camera = Camera(staircase, calibration, kind=kind, rng=rng)
    return camera.frame(0.0, R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m))


def points_of_frame(frame: RgbdFrame) -> Float[np.ndarray, "n 3"]:
    """Return the point of each pixel, row by row; NaN without a return."""
    camera, z = frame.camera, frame.depth_m.astype(float)
    v, u = np.indices(z.shape)
    x, y = (u - camera.cx_px) / camera.fx_px * z, (v - camera.cy_px) / camera.fy_px * z
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def write_calibration(path: Path, camera: PinholeCamera, mount: str = "mount_pitch_deg = 40.0\n") -> Path:
    path.write_text(
        f"width = {camera.width_px}\nheight = {camera.height_px}\nfx_px = {camera.fx_px}\nfy_px = {camera.fy_px}\n"
        f"cx_px = {camera.cx_px}\ncy_px = {camera.cy_px}\n{mount}"
    )
    return path


@pytest.fixture
def rendered() -> Rendered:
    """Return a frame from within a flight."""
    return rendered_frame


@pytest.fixture
def points() -> Callable[[RgbdFrame], Float[np.ndarray, "n 3"]]:
    """Return the points of a frame."""
    return points_of_frame


@pytest.fixture
def calibration_file() -> Callable[..., Path]:
    """Write a calibration."""
    return write_calibration
