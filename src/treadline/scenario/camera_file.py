"""Camera from a TOML file: intrinsics, mount, and for the simulator the errors, rate and latency."""

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from treadline.core.angles import DEG
from treadline.core.camera_images import BASELINES_M, DepthSensor, PinholeCamera
from treadline.core.errors import SettingsError
from treadline.core.settings import Settings, parse_toml, read_toml, settings_of
from treadline.scenario.shipped_files import CAMERAS, file_named

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
INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
"""Names of the focal lengths and of the principal point."""


class CameraFile(Settings):
    """Pinhole camera, the unit of its depth images, its mount on the chair, and what the simulator needs to render it.

    A key that is missing has the value of the sensor's kind; intrinsics only for images of its size.
    """

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
    range_m: tuple[Positive, Positive] = (0.15, 10.0)
    """Smallest and largest depth that the sensor measures."""
    sigma_m: tuple[float, float, Annotated[float, Field(ge=0.0, le=4.0)]] | None = None
    """Noise law of the simulated sensor, [a, b, exponent]: standard deviation a + b·Z^exponent [m] at a depth of Z metres, positive
    over ``range_m``. Unset: the noise of the sensor's kind; a Kinect 1's with auto."""
    rate_hz: Annotated[float, Field(ge=5.0, le=100.0)] = 10.0
    """Frames per second of the simulated camera (Table I: 10)."""
    latency_s: Annotated[float, Field(ge=0.0, le=0.5)] | None = None
    """Mean time from exposure to delivery in the simulator. Unset: ``realism.camera_latency_s`` of the scenario."""

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, tables: object) -> object:
        """Add the values of the sensor's kind; intrinsics only for images of its size."""
        if not isinstance(tables, Mapping) or tables.get("sensor") not in BASELINES_M:
            return tables
        known = _kind(tables["sensor"])
        has_its_size = all(tables.get(side, known[side]) == known[side] for side in ("width", "height"))
        return (known if has_its_size else {"range_m": known["range_m"]}) | dict(tables)

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
    def _has_noise_at_any_depth(self) -> "CameraFile":
        near_m, far_m = self.range_m
        if near_m >= far_m:
            raise ValueError(f"range_m is [{near_m:g}, {far_m:g}]; give the smallest depth first")
        if self.sigma_m is not None:
            floor_m, gain, exponent = self.sigma_m
            # The law is monotonic: its smallest value is at one of the ends.
            sigma_m, depth_m = min((floor_m + gain * depth_m**exponent, depth_m) for depth_m in self.range_m)
            if sigma_m <= 0.0:
                raise ValueError(
                    f"sigma_m = {list(self.sigma_m)} is a standard deviation of {sigma_m:.4g} m at a depth of {depth_m:g} m; it "
                    f"must be above 0 over range_m, from {near_m:g} to {far_m:g} m"
                )
        return self

    @model_validator(mode="after")
    def _is_a_lens_of_its_size(self) -> "CameraFile":
        for axis, place, size in (("cx", self.cx_px, self.width), ("cy", self.cy_px, self.height)):
            if not AT_THE_EDGE * size < place < (1.0 - AT_THE_EDGE) * size:
                raise ValueError(
                    f"{axis}_px = {place:g} lies at the edge of an image of {self.width}×{self.height}; is the calibration of "
                    "another size?"
                )
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

    @classmethod
    def of(cls, camera: PinholeCamera, where: str, depth_unit_m: float = 0.001) -> "CameraFile":
        """Return the file of a calibration; ``where`` names its source in messages. A mount without angles is unknown."""
        angles = {name: round(float(getattr(camera, name.replace("_deg", "_rad"))) / DEG, 9) for name in MOUNT_ANGLES}
        lens = {name: float(getattr(camera, name)) for name in INTRINSICS} | (angles if any(angles.values()) else {})
        size = {"width": camera.width_px, "height": camera.height_px, "mount_m": camera.mount_m, "sensor": camera.sensor}
        return settings_of(lens | size | {"depth_unit_m": depth_unit_m}, cls, where=where)

    @property
    def text(self) -> str:
        """The file, with the keys that are set."""
        table = self.model_dump(mode="json", exclude_none=True, exclude_unset=True)
        # Numbers, strings and lists of JSON are also valid TOML.
        return "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())

    @property
    def kind(self) -> DepthSensor:
        """Kind of sensor that the simulator renders."""
        return "kinect1" if self.sensor == "auto" else self.sensor

    @property
    def mount(self) -> dict[str, object]:
        """Values of the mount on a chair that the file gives, by their key there."""
        keys = {name: name.removeprefix("mount_") for name in MOUNT_ANGLES} | {"mount_m": "position_m"}
        return {key: getattr(self, name) for name, key in keys.items() if name in self.model_fields_set}

    @property
    def mount_known(self) -> bool:
        """Whether the file gives the mount orientation; otherwise the camera is assumed level and facing ahead."""
        return not self.model_fields_set.isdisjoint(MOUNT_ANGLES)

    @property
    def camera(self) -> PinholeCamera:
        """Calibration as used by the detector."""
        return self.scaled(self.height)

    def scaled(self, height_px: int) -> PinholeCamera:
        """Return the calibration of an image scaled to a height [px]."""
        scale = height_px / self.height
        return PinholeCamera(
            width_px=round(self.width * scale),
            height_px=height_px,
            fx_px=self.fx_px * scale,
            fy_px=self.fy_px * scale,
            cx_px=(self.cx_px + 0.5) * scale - 0.5,  # pixel centres are integers: the image's edge is at -0.5
            cy_px=(self.cy_px + 0.5) * scale - 0.5,
            mount_pitch_rad=self.mount_pitch_deg * DEG,
            mount_roll_rad=self.mount_roll_deg * DEG,
            mount_yaw_rad=self.mount_yaw_deg * DEG,
            mount_m=self.mount_m,
            sensor=self.sensor,
        )


def read_camera(path: Path | Mapping[str, object]) -> CameraFile:
    """Return the camera in a file, the shipped camera of that name, or the camera of a file's tables.

    Raises:
        SettingsError: If the file is missing or invalid.
    """
    if isinstance(path, Mapping):
        return settings_of(path, CameraFile, where="camera")
    is_name = str(path) in BASELINES_M and not path.exists()
    return read_toml(file_named(str(path), CAMERAS) if is_name else path, CameraFile)


def calibration_in(camera: object) -> CameraFile:
    """Return the calibration that is given as such, as a ``PinholeCamera``, or as ``read_camera`` takes it.

    Raises:
        SettingsError: If it is none of these, or invalid.
    """
    if isinstance(camera, CameraFile):
        return camera
    if isinstance(camera, str | Path | Mapping):
        return read_camera(Path(camera) if isinstance(camera, str) else camera)
    if not isinstance(camera, PinholeCamera):
        known = ", ".join(BASELINES_M)
        raise SettingsError(f"camera is of type {type(camera).__name__}; give a PinholeCamera, a camera.toml, or a name: {known}")
    return CameraFile.of(camera, "camera")


@cache
def _kind(name: str) -> dict[str, Any]:
    return parse_toml(file_named(name, CAMERAS))


KINECT_1 = read_camera(Path("kinect1"))
"""Camera of a chair whose file names none."""
