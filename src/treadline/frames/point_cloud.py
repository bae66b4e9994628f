"""Point clouds as depth images.

An organised cloud (one point per pixel, row by row) is a depth image already; its intrinsics follow from the points, because
``u = fx·x/z + cx`` and ``v = fy·y/z + cy``. So are the points of a depth image whose holes were left out, if x/z and y/z lie on a
regular grid. Other clouds are projected into a virtual pinhole camera at the origin that looks along z: the nearest point of each
pixel counts, and the focal length gives ``POINTS_PER_PIXEL`` points per pixel on average.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8

from treadline.errors import ImageError
from treadline.frames.named_frame import black
from treadline.signals import PinholeCamera, RgbdFrame

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
"""Range of the median distance of a cloud [m]: that of depth images (``image_files``)."""
IN_FRONT = 0.9
"""Least share of points in front of the camera: a depth camera has all of them in front; some clouds have outliers."""
FEWEST_POINTS = 1000
"""Fewest points of a cloud: an image of 40 × 25 pixels, in which a step 1 m away is 5 pixels high at 60° of view."""
FIT_PX = 0.5
"""Largest RMS residual of the intrinsics [px]: coordinates rounded to a millimetre at 0.5 m give 0.3 px at fx = 600."""
GRID_GAP = 1e-4
"""Smallest gap between columns of a pixel grid in x/z: a tenth of a pixel at fx = 1000; single precision is 1e-7."""
GRID_PX = 0.1
"""Largest deviation of x/z from a regular grid [px]."""
POINTS_PER_PIXEL = 3.0
"""Mean number of points per pixel of the virtual camera: at 3 random points, exp(-3) = 5 % of the pixels stay empty."""
WIDEST_TAN = 3.73
"""Largest x/z and y/z of the virtual camera: a field of view of 150°, the limit of ``camera_file``."""
LARGEST_PX = 1280
"""Largest width and height of the virtual camera [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud:
    """Points of one exposure; points without a return are not finite or zero."""

    points: Float32[np.ndarray, "n 3"]
    """Coordinates in the unit and axes of the file."""
    size_px: tuple[int, int] | None = None
    """Width and height of an organised cloud; None for an unorganised one."""
    rgb: UInt8[np.ndarray, "n 3"] | None = None
    t_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudImage:
    """Depth image of a cloud, and how its camera was found."""

    frame: RgbdFrame
    has_colour: bool
    warning: str | None
    """Property of the conversion that a user has to know."""


def cloud_image(
    where: object, cloud: PointCloud, camera: PinholeCamera | None = None, *, axes: Axes = "camera", unit: str = "m"
) -> CloudImage:
    """Return a cloud as a depth image.

    Args:
        where: Name of the cloud in error messages.
        camera: Camera of the cloud if known. An organised cloud keeps its own intrinsics and takes the mount.
        unit: Unit of the coordinates: m, cm or mm.

    Raises:
        ImageError: If the cloud is too small, lies behind the camera, or has another unit, or if its size is not the camera's.
    """
    scale = np.float32(UNITS[unit])
    points = (cloud.points * scale) @ AXES[axes][1].T.astype(np.float32)
    valid = np.isfinite(points).all(axis=1) & (points != 0.0).any(axis=1)
    if valid.sum() < FEWEST_POINTS:
        raise ImageError(f"{where}: {valid.sum()} points with a return; at least {FEWEST_POINTS} are needed to see two steps")
    _check_unit(where, points[valid], unit)
    _check_in_front(where, points[valid], axes)
    valid &= points[:, 2] > 0.0
    cloud = replace(cloud, points=np.where(valid[:, None], points, np.float32(np.nan)))
    if cloud.size_px is not None:
        return _organised(where, cloud, valid, camera)
    return _projected(cloud, valid, camera)


def _check_unit(where: object, points: Float32[np.ndarray, "n 3"], unit: str) -> None:
    middle = float(np.median(np.linalg.norm(points, axis=1)))
    if PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        return
    count = middle / UNITS[unit]
    fitting = [name for name, metres in UNITS.items() if PLAUSIBLE_M[0] <= count * metres <= PLAUSIBLE_M[1]]
    # Two units can fit; millimetres are the usual unit of depth cameras.
    remedy = (
        f"; the coordinates are probably in {fitting[-1]}: --unit {fitting[-1]}" if fitting else f" in any of {', '.join(UNITS)}"
    )
    raise ImageError(
        f"{where}: the median distance is {middle:.4g} m with the unit {unit}, which is outside {PLAUSIBLE_M[0]:g} to "
        f"{PLAUSIBLE_M[1]:g} m{remedy}"
    )


def _check_in_front(where: object, points: Float32[np.ndarray, "n 3"], axes: Axes) -> None:
    ahead = float((points[:, 2] > 0.0).mean())
    if ahead >= IN_FRONT:
        return
    own = points @ AXES[axes][1].astype(np.float32)
    others = [name for name, (_, R) in AXES.items() if name != axes and (own @ R.T[:, 2] > 0.0).mean() >= IN_FRONT]
    remedy = (
        f"its axes are probably {others[0]} ({AXES[others[0]][0]}): --axes {others[0]}"
        if others
        else "move the cloud into the frame of its sensor, and cut off what lies behind"
    )
    raise ImageError(
        f"{where}: {100.0 * ahead:.0f} % of the points lie in front of the camera ({AXES[axes][0]}), at least "
        f"{100.0 * IN_FRONT:.0f} % are needed; {remedy}"
    )


def _organised(where: object, cloud: PointCloud, valid: np.ndarray, camera: PinholeCamera | None) -> CloudImage:
    assert cloud.size_px is not None  # noqa: S101 - for the type checker
    width, height = cloud.size_px
    if camera is not None and (camera.width_px, camera.height_px) != (width, height):
        raise ImageError(f"{where}: {width}×{height} points, the calibration is for {camera.width_px}×{camera.height_px}")
    index = np.flatnonzero(valid)
    x, y, z = cloud.points[index].astype(float).T
    fx, cx, rms_u = _line(x / z, index % width)
    fy, cy, rms_v = _line(y / z, index // width)
    residual = float(np.hypot(rms_u, rms_v))
    if not (residual <= FIT_PX and fx > 0.0 and fy > 0.0):
        image = _projected(cloud, valid, camera)
        seen = f"{image.frame.camera.width_px}×{image.frame.camera.height_px}"
        return replace(
            image,
            warning=f"the organised cloud is not a pinhole image (residual {residual:.1f} px, at most {FIT_PX:g}: lens "
            f"distortion, or a cloud in another frame than its camera's); seen through a virtual camera of {seen} pixels",
        )
    fitted = PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)
    depth = cloud.points[:, 2].reshape(height, width)
    rgb = black(height, width) if cloud.rgb is None else cloud.rgb.reshape(height, width, 3)
    frame = RgbdFrame(t_s=cloud.t_s, rgb=rgb, depth_m=np.ascontiguousarray(depth), camera=_mounted(fitted, camera))
    return CloudImage(frame=frame, has_colour=cloud.rgb is not None, warning=None)


def _line(ratio: Float64[np.ndarray, " n"], pixel: Int64[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Return focal length, centre and RMS residual of ``pixel = focal·ratio + centre``."""
    spread = ratio - ratio.mean()
    variance = float(spread @ spread)
    if variance == 0.0:
        return 0.0, 0.0, np.inf
    focal = float(spread @ pixel) / variance
    centre = float(pixel.mean() - focal * ratio.mean())
    return focal, centre, float(np.sqrt(np.mean((pixel - focal * ratio - centre) ** 2)))


def _projected(cloud: PointCloud, valid: np.ndarray, camera: PinholeCamera | None) -> CloudImage:
    points = cloud.points[valid].astype(float)
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    grid = _pixel_grid(x, y) if camera is None else None
    used = camera or grid or _virtual_camera(x, y)
    column = np.round(used.fx_px * x + used.cx_px).astype(int)
    row = np.round(used.fy_px * y + used.cy_px).astype(int)
    inside = (column >= 0) & (column < used.width_px) & (row >= 0) & (row < used.height_px)
    # Far points are written first, so that the nearest point of a pixel remains.
    order = np.flatnonzero(inside)[np.argsort(-points[inside, 2], kind="stable")]
    depth = np.full((used.height_px, used.width_px), np.nan, dtype=np.float32)
    depth[row[order], column[order]] = points[order, 2]
    rgb = black(used.height_px, used.width_px)
    if cloud.rgb is not None:
        rgb[row[order], column[order]] = cloud.rgb[valid][order]
    warning = None
    if camera is None and grid is None:
        warning = (
            f"unorganised cloud of {len(points)} points: seen through a virtual camera of {used.width_px}×{used.height_px} pixels, "
            f"fx = {used.fx_px:.1f} px, at the origin of the cloud; an organised cloud, or --camera, keeps the pixels as measured"
        )
    frame = RgbdFrame(t_s=cloud.t_s, rgb=rgb, depth_m=depth, camera=used)
    return CloudImage(frame=frame, has_colour=cloud.rgb is not None, warning=warning)


def _pixel_grid(x: Float64[np.ndarray, " n"], y: Float64[np.ndarray, " n"]) -> PinholeCamera | None:
    """Return the camera of points that are pixels of a depth image; None if x/z or y/z does not lie on a regular grid."""
    horizontal, vertical = _regular(x), _regular(y)
    if horizontal is None or vertical is None:
        return None
    (fx, cx, width), (fy, cy, height) = horizontal, vertical
    if max(width, height) > 4 * LARGEST_PX or len(x) > width * height:
        return None
    return PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def _regular(ratio: Float64[np.ndarray, " n"]) -> tuple[float, float, int] | None:
    """Return focal length, centre and number of pixels of a regular grid of ratios, or None."""
    ordered = np.sort(ratio)
    first = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > GRID_GAP)
    lines = np.add.reduceat(ordered, first) / np.diff(np.append(first, len(ordered)))
    if len(lines) < 16 or 4 * len(lines) > len(ratio):
        return None
    pitch = float(np.median(np.diff(lines)))
    number = np.round((lines - lines[0]) / pitch)
    focal, centre, _ = _line(lines, number.astype(int))
    off_px = np.abs(focal * ratio + centre - np.round(focal * ratio + centre))
    if focal <= 0.0 or float(np.percentile(off_px, 99.0)) > GRID_PX:
        return None
    return focal, centre, int(number[-1]) + 1


def _virtual_camera(x: Float64[np.ndarray, " n"], y: Float64[np.ndarray, " n"]) -> PinholeCamera:
    """Return the camera at the origin whose image holds the cloud without its outermost half percent on each side."""
    (left, right), (top, bottom) = (np.clip(np.percentile(ratio, (0.5, 99.5)), -WIDEST_TAN, WIDEST_TAN) for ratio in (x, y))
    wide, high = max(float(right - left), 1e-3), max(float(bottom - top), 1e-3)
    focal = min((len(x) / POINTS_PER_PIXEL / (wide * high)) ** 0.5, LARGEST_PX / max(wide, high))
    return PinholeCamera(
        width_px=max(16, int(np.ceil(focal * wide))),
        height_px=max(16, int(np.ceil(focal * high))),
        fx_px=focal,
        fy_px=focal,
        cx_px=float(-focal * left),
        cy_px=float(-focal * top),
    )


def _mounted(fitted: PinholeCamera, camera: PinholeCamera | None) -> PinholeCamera:
    """Return the fitted intrinsics with the mount of the calibration."""
    if camera is None:
        return fitted
    intrinsics = {name: getattr(fitted, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
    return replace(camera, **intrinsics)
