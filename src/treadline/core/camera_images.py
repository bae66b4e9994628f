"""Camera, images and what is measured from one image: pinhole model (pixel to point), RGB-D frames, frames with a name.

Frame C: x right, y down, z forward. Pixel centres have integer coordinates.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy.typing import ArrayLike

from treadline.core.errors import ImageError
from treadline.core.files import text_of
from treadline.core.printing import Brief
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z

CAMERA_AXES_IN_CHAIR = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation of C in B for a camera facing straight ahead: columns are x_C (right), y_C (down), z_C (forward)."""
CAMERA_AXES_IN_CHAIR.setflags(write=False)

DepthSensor = Literal["auto", "kinect1", "kinect2", "d435", "d455", "tof"]
"""Kind of a depth sensor: structured light (kinect1, also Xtion and Astra), time of flight (kinect2, or tof for others), active
stereo (d435, d455), or unknown (auto). Each known kind has a camera file in ``data/cameras``."""
BASELINES_M: Mapping[DepthSensor, float] = {"kinect1": 0.075, "kinect2": 0.0, "d435": 0.050, "d455": 0.095, "tof": 0.0}
"""Distance of a kind's imager from its projector or second imager [m]; 0 for time of flight, which measures ranges."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PinholeCamera:
    """Calibration of a pinhole camera and its mount on the chair. Pixel centres have integer coordinates."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    mount_pitch_rad: float = 0.0
    """Pitch of the mount [rad], positive downwards from the chair's forward axis."""
    mount_roll_rad: float = 0.0
    """Roll of the mount about the optical axis [rad]."""
    mount_yaw_rad: float = 0.0
    """Yaw of the mount [rad]. The rotation order is yaw, pitch, roll."""
    mount_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of C in B [m]."""
    sensor: DepthSensor = "auto"
    """Kind of the depth sensor: it decides whether ranges or disparities are measured, and the distance between the imagers."""

    @property
    def pinhole(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point fx, fy, cx, cy [px]."""
        return self.fx_px, self.fy_px, self.cx_px, self.cy_px

    @property
    def R_BC(self) -> Rotation:
        """Rotation of the camera in the chair frame B."""
        return _turned(self.mount_yaw_rad, self.mount_pitch_rad, self.mount_roll_rad).copy()

    def pixel_to_point(self, u: np.ndarray, v: np.ndarray, depth_m: np.ndarray | float = 1.0) -> Float[np.ndarray, "*shape 3"]:
        """Return the points in C [m] at columns ``u`` and rows ``v``; at a depth of 1, the rays through the pixels."""
        x, y = (u - self.cx_px) / self.fx_px * depth_m, (v - self.cy_px) / self.fy_px * depth_m
        return np.stack(np.broadcast_arrays(x, y, depth_m), axis=-1)

    def point_to_pixel(
        self, points: Float[np.ndarray, "*shape 3"]
    ) -> tuple[Float[np.ndarray, "*shape"], Float[np.ndarray, "*shape"]]:
        """Return columns and rows of points in C [m], NaN for points that are not in the image."""
        x, y, z = np.moveaxis(points, -1, 0)
        with np.errstate(all="ignore"):
            u, v = self.fx_px * x / z + self.cx_px, self.fy_px * y / z + self.cy_px
        inside = (
            (z > 0.0)
            & (np.abs(2.0 * u + 1.0 - self.width_px) < self.width_px)
            & (np.abs(2.0 * v + 1.0 - self.height_px) < self.height_px)
        )
        return np.where(inside, u, np.nan), np.where(inside, v, np.nan)


MOUNT_FIELDS = ("mount_pitch_rad", "mount_roll_rad", "mount_yaw_rad", "mount_m", "sensor")
"""Fields of a ``PinholeCamera`` that the messages of a camera do not hold: its mount on the chair, and the kind of its sensor."""


@lru_cache(maxsize=64)
def _turned(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Rotation:
    """Return the rotation of a mount; cached, because each frame of a camera needs the same matrix."""
    return np.asarray(rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad) @ CAMERA_AXES_IN_CHAIR)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class RgbdFrame(Brief):
    """Registered colour and depth images of one exposure."""

    t_s: float
    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    """Distance along the optical axis [m]; NaN at pixels without a return."""
    camera: PinholeCamera


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairAxes:
    """Directions of the stair measured from one frame, in C; independent of the camera mount calibration."""

    t_s: float
    edge_C: Vector3
    """Unit vector along the nosings, pointing right."""
    down_C: Vector3
    """Unit vector normal to the treads and to ``edge_C``: the direction of gravity on a stair with horizontal treads."""
    normal_C: Vector3
    """Unit vector normal to the nosing plane, pointing away from the stair."""
    down_sigma_rad: float
    """Standard deviation of ``down_C`` about the edge [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class NamedFrame(Brief):
    """Frame, its name and the direction of gravity if known."""

    name: str
    frame: RgbdFrame | None
    """Frame; None if the images cannot be read."""
    mount_known: bool
    """Whether the calibration includes the orientation of the mount."""
    gravity_C: Vector3 | None
    reason: str | None = None
    """Reason for an unreadable frame."""
    has_colour: bool = True
    """Whether the frame has a colour image; without one, ``frame.rgb`` is black."""
    t_s: float | None = None
    """Time since the start of the recording [s]; None for single frames."""


@runtime_checkable
class FrameSource(Protocol):
    """Series of frames. Its warnings are complete after the last frame."""

    @property
    def warnings(self) -> Sequence[str]:
        """Properties of the source that a user has to know."""
        ...

    @property
    def count(self) -> int | None:
        """Number of frames, if known in advance."""
        ...

    def __iter__(self) -> Iterator[NamedFrame]: ...


class SeveralFrames:
    """Frames that are in memory, with the warnings of their reader."""

    def __init__(self, frames: Sequence[NamedFrame], warnings: Sequence[str] = ()) -> None:
        self._frames = frames
        self.warnings = warnings
        self.count: int | None = len(frames)

    def __iter__(self) -> Iterator[NamedFrame]:
        return iter(self._frames)


def black(height: int, width: int) -> np.ndarray:
    """Return the colour image of a frame without colour."""
    return np.zeros((height, width, 3), dtype=np.uint8)


def gravity_of(given: ArrayLike | None) -> Vector3 | None:
    """Return the direction in the option ``--gravity x,y,z``, or in three numbers.

    Raises:
        ImageError: If these are not three finite numbers that are not all zero.
    """
    if given is None:
        return None
    return _direction("--gravity" if isinstance(given, str) else "gravity", given.split(",") if isinstance(given, str) else given)


def gravity_table(path: Path) -> dict[str, Vector3]:
    """Return the direction of gravity by frame name from a CSV file with the columns name,x,y,z; empty without the file.

    Raises:
        ImageError: If the file is not such a table, or a name occurs twice.
    """
    if not path.exists():
        return {}
    reader, found = csv.DictReader(text_of(path, "a table", ImageError).splitlines()), dict[str, Vector3]()
    for row in reader:
        where = f"{path}:{reader.line_num}"
        name, *cells = (row.get(column) for column in ("name", "x", "y", "z"))
        if name is None or None in cells:
            raise ImageError(f"{where}: needs the columns name,x,y,z")
        if name in found:
            raise ImageError(f"{where}: '{name}' occurs twice; remove one")
        found[name] = _direction(where, [str(cell) for cell in cells])
    return found


def _direction(where: str, parts: ArrayLike) -> Vector3:
    try:
        vector = np.asarray(parts, dtype=float)
    except (TypeError, ValueError):
        raise ImageError(f"{where}: gravity must be three numbers x,y,z") from None
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(vector).all() or length < 1e-6:
        raise ImageError(f"{where}: gravity must be three finite numbers x,y,z that are not all zero")
    return vector / length
