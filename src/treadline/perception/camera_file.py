"""A camera's calibration from its TOML file."""

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from treadline.angles import DEG
from treadline.settings import Settings, read_toml
from treadline.signals import PinholeCamera

Positive = Annotated[float, Field(gt=0.0)]
AT_THE_EDGE = 0.02
"""Share of the image: a principal point there belongs to an image of twice the size, not to a crop that anyone takes."""
Pixels = Annotated[int, Field(ge=16, le=8192)]


class CameraFile(Settings):
    """A pinhole camera, the unit of its depth images and its mount on the chair."""

    width: Pixels
    height: Pixels
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    depth_unit_m: Annotated[float, Field(gt=0.0, le=1.0)] = 0.001
    """One count of the depth image; 0 and 65535 mean no return."""
    registered: bool = True
    """Whether colour and depth share one image plane."""
    mount_pitch_deg: float = 0.0
    mount_roll_deg: float = 0.0
    mount_yaw_deg: float = 0.0
    mount_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _fits_its_size(self) -> "CameraFile":
        for axis, place, size in (("cx", self.cx_px, self.width), ("cy", self.cy_px, self.height)):
            if not AT_THE_EDGE * size < place < (1.0 - AT_THE_EDGE) * size:
                raise ValueError(
                    f"{axis}_px = {place:g} lies at the edge of an image of {self.width}×{self.height}; is the calibration of "
                    "another size?"
                )
        return self

    @property
    def camera(self) -> PinholeCamera:
        """The calibration as the detector reads it."""
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
        )


def read_camera(path: Path) -> CameraFile:
    """Return the calibration in a file.

    Raises:
        SettingsError: If it is missing or says something it must not.
    """
    return read_toml(path, CameraFile)
