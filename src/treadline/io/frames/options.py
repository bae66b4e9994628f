"""Properties of frames that their files do not hold: calibration, gravity, unit, axes."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float64

from treadline.core.images import PinholeCamera
from treadline.scenario.camera_file import CameraFile

Axes = Literal["camera", "ros", "opengl"]
AXES: dict[Axes, tuple[str, Float64[np.ndarray, "3 3"]]] = {
    "camera": ("x right, y down, z forward", np.eye(3)),
    "ros": ("x forward, y left, z up", np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])),
    "opengl": ("x right, y up, z backward", np.diag([1.0, -1.0, -1.0])),
}
"""Axes of a cloud: meaning, and rotation into the camera frame."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units of length [m]."""
PLAUSIBLE_M = (0.2, 30.0)
"""Range of the median depth of an indoor frame [m]; outside it the unit is wrong."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOptions:
    """Properties of frames that their files do not hold."""

    camera: CameraFile | None = None
    """Calibration; a folder has its own camera.toml, a cloud and a log need none."""
    gravity_C: Float[np.ndarray, " 3"] | None = None
    """Unit vector that points down in the camera frame."""
    unit: str | None = None
    """Unit of depth counts or cloud coordinates: m, cm or mm."""
    axes: Axes = "camera"
    """Axes of point clouds."""
    topic: str | None = None
    """Topic of the depth images or point clouds of a log."""
    mount: PinholeCamera | None = None
    """Camera whose mount the camera of a log has, if no calibration is given."""
    colour: bool = True
    """Whether the colour images of a log are wanted; depth alone is read faster."""
