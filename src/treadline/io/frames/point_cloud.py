"""Point clouds of one view as depth images, and the options of frames whose files do not say all.

F is the frame of the cloud in metres, after ``--axes``; C is the frame of the camera that sees it, which is F for a cloud without
rows, and is found by ``_cloud_projection`` for an organised one.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy.typing import ArrayLike

from treadline.core.arrays import LARGEST
from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame, gravity_of
from treadline.core.errors import ImageError, SettingsError
from treadline.core.rotations import Vector3
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
"""Least share of points in the sector ahead of a camera: a depth camera has all of them there; some clouds have outliers."""
FEWEST_POINTS = 1000
"""Fewest points of a cloud: an image of 40 × 25 pixels, in which a step 1 m away is 5 pixels high at 60° of view."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOptions:
    """Properties of frames that their files do not hold."""

    camera: CameraFile | None = None
    """Calibration; a folder has its own camera.toml, a cloud and a log need none."""
    gravity_C: Vector3 | None = None
    """Unit vector that points down in the camera frame; for clouds, in their frame F."""
    unit: str | None = None
    """Unit of depth counts or cloud coordinates: m, cm or mm."""
    axes: Axes | None = None
    """Axes of point clouds; None: those of a camera, or found from an organised cloud."""
    grid_m: float | None = None
    """Side of a cell of an elevation map [m]; None for other files."""
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


def frame_of_points(points: Any, *, axes: Axes | None = None, unit: str = "m", gravity: ArrayLike | None = None) -> NamedFrame:
    """Return the frame of a point cloud of one view for ``tl.detect_stair``.

    Args:
        points: Coordinates, one row of x, y, z a point; or rows of pixels of x, y, z, whose camera is found in any axes.
        axes: Axes of the points: camera (x right, y down, z forward; the default), ros (x forward, z up) or opengl (y up, z
            backward).
        unit: Unit of the coordinates: m, cm or mm.
        gravity: Vector that points down in these axes, turned into those of a camera.

    Raises:
        ImageError: If the points are no array of numbers, or the cloud is refused.
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
    try:
        rows = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in {2, 3} or rows.shape[-1] != 3:
        raise ImageError("points is not an array of x, y, z: one row a point, or rows of pixels")
    cloud = PointCloud(points=rows.reshape(-1, 3), size_px=(rows.shape[1], rows.shape[0]) if rows.ndim == 3 else None)
    return cloud_image("points", cloud, FrameOptions(axes=axes, unit=unit, gravity_C=gravity_of(gravity)))[0]


def cloud_image(where: object, cloud: PointCloud, options: FrameOptions) -> tuple[NamedFrame, str | None]:
    """Return a cloud as a depth image, and what a user has to know of the conversion.

    Args:
        where: Name of the cloud in error messages, and of the frame.
        options: An organised cloud keeps its own intrinsics and takes the mount of the ``camera``.

    Raises:
        ImageError: If the cloud is too small, lies behind the camera, is no image of a camera, or has another unit, or if its size
            is not the camera's.
    """
    given, gravity_F, unit = options.camera, options.gravity_C, options.unit or "m"
    camera = None if given is None else given.camera
    points = _in_camera(cloud.points, options.axes or "camera", UNITS[unit])
    size = np.abs(points).max(axis=1)
    index = np.flatnonzero((size > 1.0 / LARGEST) & (size < LARGEST))  # NaN is neither
    if len(index) < FEWEST_POINTS:
        raise ImageError(f"{where}: {len(index)} points with a return; at least {FEWEST_POINTS} are needed to see two steps")
    R_CF, p_FC = np.eye(3), np.zeros(3)
    if cloud.size_px is None:
        _check_axes(where, cloud.points[index[:: max(1, len(index) // SAMPLE)]], options.axes or "camera")
        image = projected(rays_of(points[index].astype(np.float32), index), camera, cloud.rgb)
    else:
        image, R_CF, p_FC = organised(where, cloud.size_px, points[index].astype(float), index, camera, cloud.rgb)
    _check_unit(where, points[index] - p_FC, unit)
    named = NamedFrame(
        name=str(where),
        frame=RgbdFrame(t_s=cloud.t_s, rgb=image.rgb, depth_m=image.depth_m, camera=image.camera),
        gravity_C=None if gravity_F is None else R_CF @ gravity_F,
        mount_known=given is not None and given.mount_known,
        has_colour=cloud.rgb is not None,
    )
    return named, image.warning


def _in_camera(points: Float[np.ndarray, "n 3"], axes: Axes, scale: float) -> Float[np.ndarray, "n 3"]:
    """Return the points in the axes of a camera [m]: all rotations of ``AXES`` permute axes and change signs."""
    R = AXES[axes][1]
    with np.errstate(invalid="ignore", over="ignore"):  # a hostile point is no return
        return points[:, np.argmax(np.abs(R), axis=1)] * (scale * R.sum(axis=1)).astype(points.dtype)


def _check_axes(where: object, points: Float[np.ndarray, "n 3"], used: Axes) -> None:
    """Reject a cloud whose points do not lie ahead; other axes in which they do are a guess that the user has to make."""
    turned = {axes: _in_camera(points, axes, 1.0) for axes in AXES}
    ahead = {axes: float((np.abs(p[:, :2]).max(axis=1) <= SECTOR_TAN * p[:, 2]).mean()) for axes, p in turned.items()}
    if ahead[used] >= IN_FRONT:
        return
    likely = next((axes for axes, share in ahead.items() if share >= IN_FRONT), None)
    remedy = "clouds are of one view: give the part ahead of the sensor, in its axes (--axes)"
    if likely is not None:
        remedy = f"its axes are probably {likely} ({AXES[likely][0]}): --axes {likely}"
    raise ImageError(f"{where}: {ahead[used]:.0%} of the points lie in front of the camera ({AXES[used][0]}); {remedy}")


def _check_unit(where: object, points: Float[np.ndarray, "n 3"], unit: str) -> None:
    """Reject a cloud whose points are at no distance of a stair from the sensor."""
    middle = float(np.median(np.linalg.norm(points, axis=1)))
    if PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        return
    fitting = [name for name, metres in UNITS.items() if PLAUSIBLE_M[0] <= middle / UNITS[unit] * metres <= PLAUSIBLE_M[1]]
    remedy = f" in any of {', '.join(UNITS)}; subtract the place of the sensor from coordinates of a map"
    if fitting:  # Two units can fit; millimetres are the usual unit of depth cameras.
        remedy = f"; the coordinates are probably in {fitting[-1]}: --unit {fitting[-1]}"
    raise ImageError(
        f"{where}: the median distance is {middle:.4g} m with the unit {unit}, which is outside {PLAUSIBLE_M[0]:g} to "
        f"{PLAUSIBLE_M[1]:g} m{remedy}"
    )
