"""Poses of a sensor, and scans that add up in odometry. Axes: x forward, y left, z up, as for the mount of a camera file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from treadline.core.angles import DEG
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, named_rows
from treadline.core.errors import ImageError
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z

COLUMNS = ("x", "y", "z", "roll", "pitch", "yaw")
"""Columns of a table of poses after the name of the cloud: position [m] and angles [deg]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorPose:
    """Pose of a sensor in a level frame."""

    position_m: Vector3
    angles_rad: tuple[float, float, float] | None = None
    """Roll, pitch (positive downwards) and yaw [rad]; None if they are not known."""

    @classmethod
    def of(cls, where: str, given: ArrayLike) -> "SensorPose":
        """Return the pose in three or six numbers, or in their text x,y,z,roll,pitch,yaw [m and deg].

        Raises:
            ImageError: If these are not three or six finite numbers.
        """
        try:
            numbers = np.asarray(given.split(",") if isinstance(given, str) else given, dtype=float)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape not in {(3,), (6,)} or not np.isfinite(numbers).all():
            raise ImageError(f"{where}: a pose is three or six numbers: x,y,z in metres, roll,pitch,yaw in degrees")
        roll, pitch, yaw = numbers[3:] * DEG if len(numbers) == 6 else (0.0, 0.0, 0.0)
        angles_rad = (float(roll), float(pitch), float(yaw)) if len(numbers) == 6 else None
        return cls(position_m=numbers[:3], angles_rad=angles_rad)

    @property
    def R(self) -> Rotation:
        """Rotation of the sensor's frame; the order is yaw, pitch, roll."""
        roll_rad, pitch_rad, yaw_rad = self.angles_rad or (0.0, 0.0, 0.0)
        return np.asarray(rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad))

    @property
    def down_C(self) -> Vector3:
        """Direction of gravity in the sensor's frame with the axes of a camera."""
        return np.asarray(CAMERA_AXES_IN_CHAIR.T @ self.R.T @ np.array([0.0, 0.0, -1.0]))


def added_up(scans_C: Sequence[Float[np.ndarray, "n 3"]], poses: Sequence[SensorPose]) -> Float[np.ndarray, "m 3"]:
    """Return all points in the frame of the last scan, each in its own frame with the axes of a camera before [m]."""
    last = poses[-1]
    moved = []
    for points, pose in zip(scans_C, poses, strict=True):
        R = CAMERA_AXES_IN_CHAIR.T @ last.R.T @ pose.R @ CAMERA_AXES_IN_CHAIR
        shift = CAMERA_AXES_IN_CHAIR.T @ last.R.T @ (pose.position_m - last.position_m)
        moved.append(points.astype(float) @ R.T + shift)
    return np.concatenate(moved)


def read_poses(path: Path) -> dict[str, SensorPose]:
    """Return the poses in a table with the columns name,x,y,z,roll,pitch,yaw [m and deg], by the name of the cloud.

    Raises:
        ImageError: If the file is not such a table.
    """
    return {name: SensorPose.of(where, cells) for where, name, cells in named_rows(path, COLUMNS)}
