"""Point clouds as depth images, and the options of frames whose files do not say all.

A cloud is turned into the frame of its sensor, and projected by ``_cloud_projection``. F is the frame of the cloud with the axes of
a camera, B is F with x forward, y left and z up, C is the frame of the camera that sees it. Poses of a sensor have the axes of B.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy.typing import ArrayLike

from treadline.core.angles import DEG
from treadline.core.arrays import LARGEST
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, NamedFrame, PinholeCamera, RgbdFrame, gravity_of
from treadline.core.errors import ImageError, SettingsError
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z
from treadline.io.frames._cloud_projection import SAMPLE, SECTOR_TAN, organised, projected, rays_of
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
IN_FRONT = 0.9
"""Least share of points in the sector ahead of a camera: a depth camera has all of them there; some clouds have outliers. A cloud
with fewer is cropped to the sector."""
FEWEST_POINTS = 1000
"""Fewest points of a cloud: an image of 40 × 25 pixels, in which a step 1 m away is 5 pixels high at 60° of view."""


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
        angles_rad: Any = tuple((numbers[3:] * DEG).tolist())
        return cls(position_m=numbers[:3], angles_rad=angles_rad or None)

    @property
    def R(self) -> Rotation:
        """Rotation of the sensor's frame; the order is yaw, pitch, roll."""
        roll_rad, pitch_rad, yaw_rad = self.angles_rad or (0.0, 0.0, 0.0)
        return np.asarray(rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad))

    @property
    def down_C(self) -> Vector3:
        """Direction of gravity in the sensor's frame with the axes of a camera."""
        return np.asarray(CAMERA_AXES_IN_CHAIR.T @ self.R.T @ np.array([0.0, 0.0, -1.0]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOptions:
    """Properties of frames that their files do not hold."""

    camera: CameraFile | None = None
    """Calibration; a folder has its own camera.toml, a cloud and a log need none."""
    gravity_C: Vector3 | None = None
    """Unit vector that points down in the camera frame; for clouds, in the cloud's frame with the axes of a camera."""
    unit: str | None = None
    """Unit of depth counts or cloud coordinates: m, cm or mm."""
    axes: Axes | None = None
    """Axes of point clouds; None: found from the points."""
    pose: SensorPose | None = None
    """Pose of the sensor in the frame of its clouds, if that is the level frame of a chair."""
    topic: str | None = None
    """Topic of the depth images or point clouds of a log."""
    mount: PinholeCamera | None = None
    """Camera whose mount the camera of a log has, if no calibration is given."""
    colour: bool = True
    """Whether the colour images of a log are wanted; depth alone is read faster."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud:
    """Points of one exposure; points without a return are not finite or zero."""

    points: Float[np.ndarray, "n 3"]
    """Coordinates in the unit and axes of the file."""
    size_px: tuple[int, int] | None = None
    """Width and height of an organised cloud; None for an unorganised one."""
    rgb: UInt8[np.ndarray, "n 3"] | None = None
    t_s: float = 0.0


def frame_of_points(
    points: Any,
    *,
    poses: Sequence[ArrayLike] | None = None,
    pose: ArrayLike | None = None,
    axes: Axes | None = None,
    unit: str = "m",
    gravity: ArrayLike | None = None,
) -> NamedFrame:
    """Return the frame of a point cloud, or of several scans that add up in odometry, for ``tl.detect_stair``.

    Args:
        points: Coordinates, one row of x, y, z a point; with ``poses``, one such array a scan.
        poses: Pose of each scan in level odometry: x, y, z [m], roll, pitch, yaw [deg]. The frame is that of the last scan.
        pose: Pose of the sensor in the points' frame, if that is the level frame of a chair: x, y, z [m] and, if known, roll, pitch
            and yaw [deg], with x forward, y left and z up.
        axes: Axes of the points: camera (x right, y down, z forward), ros (x forward, z up) or opengl (y up, z backward). Default:
            ros with poses, else found from the points.
        unit: Unit of the coordinates: m, cm or mm.
        gravity: Vector that points down in the points' frame with the axes of a camera.

    Raises:
        ImageError: If points or poses are not arrays of numbers, or the cloud is refused.
        SettingsError: If unit or axes are unknown.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> wall = np.stack(np.meshgrid([2.0], np.linspace(-1, 1, 80), np.linspace(0, 1, 60)), axis=-1).reshape(-1, 3)
        >>> tl.detect_stair(tl.frame_of_points(wall, axes="ros")).accepted
        False
    """
    if unit not in UNITS or axes not in {None, *AXES}:
        raise SettingsError(f"unit is '{unit}', axes are '{axes}'; allowed: {', '.join(UNITS)}, and {', '.join(AXES)}")
    own = None if pose is None else SensorPose.of("pose", pose)
    down = gravity_of(gravity)
    if poses is None:
        cloud = PointCloud(points=_rows("points", points))
    else:
        scans = [PointCloud(points=_rows(f"points[{number}]", scan)) for number, scan in enumerate(points)]
        cloud, down = fused("poses", scans, [SensorPose.of("poses", one) for one in poses], axes or "ros", unit, down)
        axes, unit = "camera", "m"
    return cloud_image("points", cloud, FrameOptions(axes=axes, unit=unit, pose=own, gravity_C=down))[0]


def fused(
    where: object, clouds: Sequence[PointCloud], poses: Sequence[SensorPose], axes: Axes, unit: str, gravity_F: Vector3 | None
) -> tuple[PointCloud, Vector3]:
    """Return scans added up in level odometry, in the frame of the last one with the axes of a camera [m], and gravity there.

    Raises:
        ImageError: If the numbers of scans and poses differ.
    """
    if not clouds or len(clouds) != len(poses):
        raise ImageError(f"{where}: {len(poses)} poses of {len(clouds)} clouds; give one pose a cloud")
    in_last = _added_up([_in_camera(cloud.points, axes, UNITS[unit]) for cloud in clouds], poses)
    rgb = [cloud.rgb for cloud in clouds]
    colours = None if any(part is None for part in rgb) else np.concatenate([part for part in rgb if part is not None])
    down = poses[-1].down_C if gravity_F is None else gravity_F
    return PointCloud(points=in_last, rgb=colours, t_s=clouds[-1].t_s), down


def cloud_image(where: object, cloud: PointCloud, options: FrameOptions) -> tuple[NamedFrame, str | None]:
    """Return a cloud as a depth image, and what a user has to know of the conversion.

    Args:
        where: Name of the cloud in error messages, and of the frame.
        options: An organised cloud keeps its own intrinsics and takes the mount of the ``camera``. Without ``axes`` a cloud with a
            pose, or with points all around, has those of ROS, any other those of a camera. Gravity is down in a cloud with a pose.

    Raises:
        ImageError: If the cloud is too small, lies behind the camera, or has another unit, or if its size is not the camera's.
    """
    camera = None if options.camera is None else options.camera.camera
    axes, unit, pose, gravity_F = options.axes, options.unit or "m", options.pose, options.gravity_C
    if pose is not None and pose.angles_rad is None and camera is not None:
        pose = replace(pose, angles_rad=(camera.mount_roll_rad, camera.mount_pitch_rad, camera.mount_yaw_rad))
    used = axes or ("camera" if pose is None else "ros")
    points = _in_camera(cloud.points if pose is None else cloud.points.astype(float), used, UNITS[unit])
    if pose is not None:
        points -= CAMERA_AXES_IN_CHAIR.T @ pose.position_m
        gravity_F = np.array([0.0, 1.0, 0.0]) if gravity_F is None else gravity_F
    size = np.abs(points).max(axis=1)
    index = np.flatnonzero((size > 1.0 / LARGEST) & (size < LARGEST))  # NaN is neither
    if len(index) < FEWEST_POINTS:
        raise ImageError(f"{where}: {len(index)} points with a return; at least {FEWEST_POINTS} are needed to see two steps")
    some = points[index[:: max(1, len(index) // SAMPLE)]]
    _check_unit(where, some, unit)
    if axes is None and pose is None and (used := _axes_of(where, some)) != "camera":
        points, some = _in_camera(points, used, 1.0), _in_camera(some, used, 1.0)
    share = _share_ahead(some)
    is_turned = pose is None and camera is None and (share < IN_FRONT or _lies_aside(some))
    R_BS, mount = _orientation(some, pose, is_turned=is_turned)
    R_FC = CAMERA_AXES_IN_CHAIR.T @ R_BS @ CAMERA_AXES_IN_CHAIR
    seen = rays_of((points[index] @ R_FC).astype(np.float32), index)
    if len(seen.number) < FEWEST_POINTS:
        raise ImageError(
            f"{where}: {len(seen.number)} of {len(index)} points lie in front of the camera ({AXES[used][0]}), at least "
            f"{FEWEST_POINTS} are needed; give the cloud's own --axes, or the sensor's --pose in it"
        )
    if cloud.size_px is None:
        image = projected(seen, camera, cloud.rgb)
    else:
        image = organised(where, cloud.size_px, seen, camera, cloud.rgb)
    plane, depth_m, rgb, warning = image
    if pose is not None or is_turned:
        plane = replace(plane, **mount)
    if is_turned:
        pitch_deg = mount["mount_pitch_rad"] / DEG
        warning = f"{warning}; it looks {pitch_deg:.0f}° down, and {share:.0%} of the points lie in its sector ({AXES[used][0]})"
    frame = RgbdFrame(t_s=cloud.t_s, rgb=rgb, depth_m=depth_m, camera=plane)
    named = NamedFrame(
        name=str(where),
        frame=frame,
        gravity_C=None if gravity_F is None else R_FC.T @ gravity_F,
        mount_known=pose is not None or (options.camera is not None and options.camera.mount_known),
        has_colour=cloud.rgb is not None,
    )
    return named, warning


def _added_up(scans_C: Sequence[Float[np.ndarray, "n 3"]], poses: Sequence[SensorPose]) -> Float[np.ndarray, "m 3"]:
    """Return all points in the frame of the last scan, each in its own frame with the axes of a camera before [m]."""
    last = poses[-1]
    moved = []
    for points, pose in zip(scans_C, poses, strict=True):
        R = CAMERA_AXES_IN_CHAIR.T @ last.R.T @ pose.R @ CAMERA_AXES_IN_CHAIR
        shift = CAMERA_AXES_IN_CHAIR.T @ last.R.T @ (pose.position_m - last.position_m)
        moved.append(points.astype(float) @ R.T + shift)
    return np.concatenate(moved)


def _rows(name: str, points: object) -> Float[np.ndarray, "n 3"]:
    try:
        rows = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ImageError(f"{name} is not an array of one row of x, y, z a point; several scans need their poses")
    return rows


def _in_camera(points: Float[np.ndarray, "n 3"], axes: Axes, scale: float) -> Float[np.ndarray, "n 3"]:
    """Return the points in the axes of a camera [m]: all rotations of ``AXES`` permute axes and change signs."""
    R = AXES[axes][1]
    with np.errstate(invalid="ignore", over="ignore"):  # a hostile point is no return
        return points[:, np.argmax(np.abs(R), axis=1)] * (scale * R.sum(axis=1)).astype(points.dtype)


def _axes_of(where: object, points: Float[np.ndarray, "n 3"]) -> Axes:
    """Return the axes of a cloud in its sensor's frame: camera if its points lie ahead so, ros if they lie all around.

    Raises:
        ImageError: If the points lie ahead in other axes: these are a guess that the user has to make.
    """
    if _share_ahead(points) >= IN_FRONT:
        return "camera"
    for axes in AXES:
        if _share_ahead(_in_camera(points, axes, 1.0)) >= IN_FRONT:
            raise ImageError(
                f"{where}: {_share_ahead(points):.0%} of the points lie in front of the camera ({AXES['camera'][0]}); its axes "
                f"are probably {axes} ({AXES[axes][0]}): --axes {axes}"
            )
    return "ros"


def _share_ahead(points: Float[np.ndarray, "n 3"]) -> float:
    """Return the share of points in the sector ahead, which a virtual camera sees."""
    return float((np.abs(points[:, :2]).max(axis=1) <= SECTOR_TAN * points[:, 2]).mean())


def _lies_aside(points: Float[np.ndarray, "n 3"]) -> bool:
    """Return whether a level camera would look over or under the points: they are those of a pitched one in a level frame."""
    ahead = points[points[:, 2] > 1e-6]
    low, high = np.percentile(ahead[:, 1] / ahead[:, 2], (0.5, 99.5)) if len(ahead) else (0.0, 0.0)
    return bool(low > 0.0 or high < 0.0)


def _orientation(points: Float[np.ndarray, "n 3"], pose: SensorPose | None, *, is_turned: bool) -> tuple[Rotation, dict[str, Any]]:
    """Return the rotation of the camera in B and the fields of its mount; without angles it is pitched to the points ahead."""
    if pose is None and not is_turned:
        return np.eye(3), {}
    if pose is not None and pose.angles_rad is not None:
        R_BS, (roll_rad, pitch_rad, yaw_rad) = pose.R, pose.angles_rad
    else:
        ahead = points[np.abs(points[:, 0]) < SECTOR_TAN * points[:, 2]]
        pitch_rad = float(np.median(np.arctan2(ahead[:, 1], np.hypot(ahead[:, 0], ahead[:, 2])))) if len(ahead) else 0.0
        R_BS, roll_rad, yaw_rad = rotation_y(pitch_rad), 0.0, 0.0
    position_m = (0.0, 0.0, 0.0) if pose is None else tuple(pose.position_m.tolist())
    mount = {"mount_roll_rad": roll_rad, "mount_pitch_rad": pitch_rad, "mount_yaw_rad": yaw_rad, "mount_m": position_m}
    return R_BS, mount


def _check_unit(where: object, points: Float[np.ndarray, "n 3"], unit: str) -> None:
    """Reject a cloud whose points are at no distance of a stair from the sensor."""
    middle = float(np.median(np.linalg.norm(points, axis=1)))
    if PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        return
    said = f"{where}: the median distance is {middle:.4g} m with the unit {unit}, which is outside {PLAUSIBLE_M[0]:g} to "
    said += f"{PLAUSIBLE_M[1]:g} m"
    extent = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    if middle > PLAUSIBLE_M[1] and PLAUSIBLE_M[0] <= extent <= PLAUSIBLE_M[1]:
        raise ImageError(
            f"{said}, but the points lie within {extent:.3g} m of each other: the coordinates are probably those of a map; give "
            "the place of the sensor in it: --pose x,y,z"
        )
    count = middle / UNITS[unit]
    fitting = [name for name, metres in UNITS.items() if PLAUSIBLE_M[0] <= count * metres <= PLAUSIBLE_M[1]]
    # Two units can fit; millimetres are the usual unit of depth cameras.
    remedy = (
        f"; the coordinates are probably in {fitting[-1]}: --unit {fitting[-1]}" if fitting else f" in any of {', '.join(UNITS)}"
    )
    raise ImageError(said + remedy)
