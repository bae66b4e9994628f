"""Frames with known truth, and their point clouds."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frame_files import points_of_frame, write_calibration
from jaxtyping import Float
from surfaces import on_a_flight

from treadline.core.camera_images import RgbdFrame

Rendered = Callable[..., RgbdFrame]


@pytest.fixture
def rendered() -> Rendered:
    """Return a frame from within a flight."""
    return lambda seed=1, heading_deg=12.0, **options: on_a_flight(seed, heading_deg, **options)[0]


@pytest.fixture
def points() -> Callable[[RgbdFrame], Float[np.ndarray, "n 3"]]:
    """Return the points of a frame."""
    return points_of_frame


@pytest.fixture
def calibration_file() -> Callable[..., Path]:
    """Write a calibration."""
    return write_calibration
