"""Camera calibration from a TOML file."""

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from treadline.core.angles import DEG
from treadline.core.camera_images import DepthSensor, PinholeCamera
from treadline.core.settings import Settings, read_toml

Positive = Annotated[float, Field(gt=0.0)]
AT_THE_EDGE = 0.02
"""Image fraction next to the border: a principal point there belongs to an image of twice the size, not to a crop."""
SQUARE = (0.8, 1.25)
"""Range of the ratio of pixel width to pixel height; anamorphic cameras are not supported."""
FIELD_DEG = (10.0, 150.0)
"""Range of the field of view, horizontal and vertical [deg]: smaller for a telescope, larger for a fisheye, which is not a pinhole
camera."""
RIGID = 1e-3
"""Largest deviation of a rotation matrix from orthogonality, for matrices with few digits."""
MOUNT_ANGLES = ("mount_pitch_deg", "mount_roll_deg", "mount_yaw_deg")
"""Names of the mount angles."""
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]
Pixels = Annotated[int, Field(ge=16, le=8192)]


class CameraFile(Settings):
    """Pinhole camera, the unit of its depth images and its mount on the chair."""

    width: Pixels
    height: Pixels
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    depth_unit_m: Annotated[float, Field(gt=0.0, le=1.0)] = 0.001
    """Depth per count of the depth image; counts 0 and 65535 mean no return."""
    sensor: DepthSensor = "auto"
    """Kind of the depth sensor, which decides what it measures: kinect1 (also Xtion, Astra), kinect2, d435, d455, tof or auto."""
    registered: bool = True
    """Whether colour and depth share one image plane; if not, the calibration is that of the depth camera."""
    X_depth_colour: tuple[float, ...] | None = None
    """Pose of the colour camera in the depth camera, both with the same lens: four or three rows of four numbers [m]."""
    mount_pitch_deg: Degrees = 0.0
    mount_roll_deg: Degrees = 0.0
    mount_yaw_deg: Degrees = 0.0
    mount_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @field_validator("X_depth_colour", mode="before")
    @classmethod
    def _rows_in_a_row(cls, value: object) -> object:
        rows = value if isinstance(value, tuple) else ()
        return tuple(cell for row in rows for cell in row) if rows and all(isinstance(row, tuple) for row in rows) else value

    @model_validator(mode="after")
    def _poses_are_rigid(self) -> "CameraFile":
        if self.X_depth_colour is not None:
            X = np.array(self.X_depth_colour)
            if X.size not in {12, 16}:
                raise ValueError(f"X_depth_colour holds {X.size} numbers; give four rows of four, the last 0, 0, 0, 1")
            R = X.reshape(-1, 4)[:3, :3]
            if np.abs(R @ R.T - np.eye(3)).max() > RIGID or np.linalg.det(R) < 0.0:
                raise ValueError(
                    "X_depth_colour turns by a matrix that is no rotation; its rows must be unit vectors at right angles"
                )
        return self

    @model_validator(mode="after")
    def _fits_its_size(self) -> "CameraFile":
        for axis, place, size in (("cx", self.cx_px, self.width), ("cy", self.cy_px, self.height)):
            if not AT_THE_EDGE * size < place < (1.0 - AT_THE_EDGE) * size:
                raise ValueError(
                    f"{axis}_px = {place:g} lies at the edge of an image of {self.width}×{self.height}; is the calibration of "
                    "another size?"
                )
        return self

    @model_validator(mode="after")
    def _is_a_lens(self) -> "CameraFile":
        for focal, length, size in (("fx", self.fx_px, self.width), ("fy", self.fy_px, self.height)):
            field_deg = 2.0 * math.atan(0.5 * size / length) / DEG
            if not FIELD_DEG[0] <= field_deg <= FIELD_DEG[1]:
                raise ValueError(
                    f"{focal}_px = {length:g} for {size} pixels is a field of view of {field_deg:.1f}°; it must be from "
                    f"{FIELD_DEG[0]:g} to {FIELD_DEG[1]:g}°: calibrate the camera at this size"
                )
        if not SQUARE[0] <= self.fx_px / self.fy_px <= SQUARE[1]:
            raise ValueError(
                f"fx_px / fy_px is {self.fx_px / self.fy_px:.3g}; pixels are square, so it must be from {SQUARE[0]:g} to "
                f"{SQUARE[1]:g}: calibrate the camera again"
            )
        return self

    @property
    def mount_known(self) -> bool:
        """Whether the file gives the mount orientation; otherwise the camera is assumed level and facing ahead."""
        return not self.model_fields_set.isdisjoint(MOUNT_ANGLES)

    @property
    def camera(self) -> PinholeCamera:
        """Calibration as used by the detector."""
        return PinholeCamera(
            width_px=self.width,
            height_px=self.height,
            fx_px=self.fx_px,
            fy_px=self.fy_px,
            cx_px=self.cx_px,
            cy_px=self.cy_px,
            mount_pitch_rad=self.mount_pitch_deg * DEG,
            mount_roll_rad=self.mount_roll_deg * DEG,
            mount_yaw_rad=self.mount_yaw_deg * DEG,
            mount_m=self.mount_m,
            sensor=self.sensor,
        )


def read_camera(path: Path) -> CameraFile:
    """Return the calibration in a file.

    Raises:
        SettingsError: If the file is missing or invalid.
    """
    return read_toml(path, CameraFile)
