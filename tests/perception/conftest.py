"""Frames as the chair's camera has them from within a flight."""

from collections.abc import Callable

import numpy as np
import pytest
from jaxtyping import Float
from surfaces import frame_of

from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import rotation_z
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

View = Callable[..., tuple[RgbdFrame, Float[np.ndarray, " 3"]]]


def view_from_the_flight(
    seed: int, heading_rad: float, stair: Stair, *, kind: str = "kinect1", height_px: int = 240
) -> tuple[RgbdFrame, Float[np.ndarray, " 3"]]:
    rng = np.random.default_rng(seed)
    staircase = build_staircase(stair, rng)
    calibration = read_chair("wheelchair").camera_at(height_px)
    R_WB = staircase.R_WS @ rotation_z(heading_rad)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([rng.uniform(0.3, 3.0), rng.uniform(-0.2, 0.2), 0.0])
    return frame_of(staircase, calibration, R_WB, p_WB, rng, kind=kind, texture=stair.texture, light=stair.light)


@pytest.fixture
def view() -> View:
    """Return a frame from within the flight, and down in C."""
    return view_from_the_flight
