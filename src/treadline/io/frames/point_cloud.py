"""Point clouds as depth images, and the options of frames whose files do not say all.

An organised cloud (one point per pixel, row by row) is a depth image already; its intrinsics follow from the points, because
``u = fx·x/z + cx`` and ``v = fy·y/z + cy``. So are the points of a depth image whose holes were left out, if x/z and y/z lie on a
regular grid. Other clouds are projected into a virtual pinhole camera at the origin that looks along z: the nearest surface of each
pixel counts, and the focal length gives ``POINTS_PER_PIXEL`` points per pixel on average.
"""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8

from treadline.core.arrays import LARGEST
from treadline.core.camera_images import PinholeCamera, RgbdFrame, black
from treadline.core.errors import ImageError
from treadline.core.rotations import Vector3
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
"""Least share of points in front of the camera: a depth camera has all of them in front; some clouds have outliers."""
FEWEST_POINTS = 1000
"""Fewest points of a cloud: an image of 40 × 25 pixels, in which a step 1 m away is 5 pixels high at 60° of view."""
FIT_PX = 0.5
"""Largest RMS residual of the intrinsics [px]: coordinates rounded to a millimetre at 0.5 m give 0.3 px at fx = 600."""
SAMPLE = 20_000
"""Number of points from which unit, axes and intrinsics follow; the intrinsics of exact points are exact from two of them."""
GRID_GAP = 1e-4
"""Smallest gap between columns of a pixel grid in x/z: a tenth of a pixel at fx = 1000; single precision is 1e-7."""
GRID_PX = 0.1
"""Largest deviation of x/z from a regular grid [px]."""
POINTS_PER_PIXEL = 3.0
"""Mean number of points per pixel of the virtual camera: at 3 random points, exp(-3) = 5 % of the pixels stay empty."""
SURFACE = 0.05
"""Depth range of one surface within a pixel, relative to its depth: a tread seen at 6° to its plane, 1/(200 px · tan 6°) = 4.8 %.

Edge direction of 24 clouds without a pixel grid against their depth images: 0.005° RMS at 2 and 5 %, 0.015° at 0.5 %, and 0.018°
with the nearest point alone.
"""
WIDEST_TAN = 3.73
"""Largest x/z and y/z of the virtual camera: a field of view of 150°, the limit of ``camera_file``."""
LARGEST_PX = 1280
"""Largest width and height of the virtual camera [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOptions:
    """Properties of frames that their files do not hold."""

    camera: CameraFile | None = None
    """Calibration; a folder has its own camera.toml, a cloud and a log need none."""
    gravity_C: Vector3 | None = None
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
    x, y, z = _in_camera(cloud.points, axes, UNITS[unit])
    size = np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z))
    index = np.flatnonzero((size > 1.0 / LARGEST) & (size < LARGEST))  # NaN is neither
    if len(index) < FEWEST_POINTS:
        raise ImageError(f"{where}: {len(index)} points with a return; at least {FEWEST_POINTS} are needed to see two steps")
    some = index[:: max(1, len(index) // SAMPLE)]
    _check_unit(where, np.stack([x[some], y[some], z[some]], axis=1), unit)
    _check_in_front(where, np.stack([x[some], y[some], z[some]], axis=1), axes)
    index = index[z[index] > 1.0 / LARGEST]
    depth = z[index]
    seen = _Seen(number=index, depth=depth, x=x[index] / depth, y=y[index] / depth)
    return _projected(cloud, seen, camera) if cloud.size_px is None else _organised(where, cloud, seen, camera)


class _Seen(NamedTuple):
    """Points in front of the camera: number in the cloud, depth [m], x/z and y/z."""

    number: Int64[np.ndarray, " n"]
    depth: Float32[np.ndarray, " n"]
    x: Float32[np.ndarray, " n"]
    y: Float32[np.ndarray, " n"]


def _in_camera(points: Float32[np.ndarray, "n 3"], axes: Axes, scale: float) -> list[Float32[np.ndarray, " n"]]:
    """Return the coordinates in the camera frame [m]: all rotations of ``AXES`` permute axes and change signs."""
    places = np.argmax(np.abs(AXES[axes][1]), axis=1)
    with np.errstate(invalid="ignore", over="ignore"):  # a hostile point is no return
        return [points[:, place] * np.float32(scale * row[place]) for place, row in zip(places, AXES[axes][1], strict=True)]


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


def _organised(where: object, cloud: PointCloud, seen: _Seen, camera: PinholeCamera | None) -> CloudImage:
    assert cloud.size_px is not None  # noqa: S101 - for the type checker
    width, height = cloud.size_px
    if camera is not None and (camera.width_px, camera.height_px) != (width, height):
        raise ImageError(f"{where}: {width}×{height} points, the calibration is for {camera.width_px}×{camera.height_px}")
    some = slice(None, None, max(1, len(seen.number) // SAMPLE))
    fx, cx, rms_u = _line(seen.x[some].astype(float), seen.number[some] % width)
    fy, cy, rms_v = _line(seen.y[some].astype(float), seen.number[some] // width)
    residual = float(np.hypot(rms_u, rms_v))
    if not (residual <= FIT_PX and fx > 0.0 and fy > 0.0):
        image = _projected(cloud, seen, camera)
        used = f"{image.frame.camera.width_px}×{image.frame.camera.height_px}"
        return replace(
            image,
            warning=f"the organised cloud is not a pinhole image (residual {residual:.1f} px, at most {FIT_PX:g}: lens "
            f"distortion, or a cloud in another frame than its camera's); seen through a virtual camera of {used} pixels",
        )
    fitted = PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)
    depth = np.full(width * height, np.nan, dtype=np.float32)
    depth[seen.number] = seen.depth
    rgb = black(height, width) if cloud.rgb is None else cloud.rgb.reshape(height, width, 3)
    frame = RgbdFrame(t_s=cloud.t_s, rgb=rgb, depth_m=depth.reshape(height, width), camera=_mounted(fitted, camera))
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


def _projected(cloud: PointCloud, seen: _Seen, camera: PinholeCamera | None) -> CloudImage:
    x, y = seen.x.astype(float), seen.y.astype(float)
    grid = _pixel_grid(x, y) if camera is None else None
    used = camera or grid or _virtual_camera(x, y)
    kept, pixel = _front_points(x * used.fx_px + used.cx_px, y * used.fy_px + used.cy_px, seen.depth, used)
    depth = np.full(used.height_px * used.width_px, np.nan, dtype=np.float32)
    depth[pixel] = seen.depth[kept]
    rgb = black(used.height_px, used.width_px)
    if cloud.rgb is not None:
        rgb.reshape(-1, 3)[pixel] = cloud.rgb[seen.number[kept]]
    warning = None
    if camera is None and grid is None:
        warning = (
            f"unorganised cloud of {len(x)} points: seen through a virtual camera of {used.width_px}×{used.height_px} pixels, "
            f"fx = {used.fx_px:.1f} px, at the origin of the cloud; an organised cloud, or --camera, keeps the pixels as measured"
        )
    frame = RgbdFrame(t_s=cloud.t_s, rgb=rgb, depth_m=depth.reshape(used.height_px, used.width_px), camera=used)
    return CloudImage(frame=frame, has_colour=cloud.rgb is not None, warning=warning)


def _front_points(
    u: Float64[np.ndarray, " n"], v: Float64[np.ndarray, " n"], depth: Float32[np.ndarray, " n"], camera: PinholeCamera
) -> tuple[Int64[np.ndarray, " m"], Int64[np.ndarray, " m"]]:
    """Return the points that a camera sees, one per pixel, and their pixels.

    In each pixel the nearest surface counts, and of its points the one next to the pixel's centre: the nearest point alone would
    pull a sloping surface towards the camera.
    """
    column, row = np.rint(u), np.rint(v)
    inside = np.flatnonzero((column >= 0.0) & (column < camera.width_px) & (row >= 0.0) & (row < camera.height_px))
    pixel, z = (row[inside] * camera.width_px + column[inside]).astype(np.int64), depth[inside]
    nearest = np.full(camera.width_px * camera.height_px, np.inf, dtype=np.float32)
    np.minimum.at(nearest, pixel, z)
    front = z <= (1.0 + SURFACE) * nearest[pixel]
    inside, pixel = inside[front], pixel[front]
    # The last point written to a pixel remains.
    order = np.argsort(-((u[inside] - column[inside]) ** 2 + (v[inside] - row[inside]) ** 2), kind="stable")
    chosen = np.full(len(nearest), -1, dtype=np.int64)
    chosen[pixel[order]] = inside[order]
    filled = np.flatnonzero(chosen >= 0)
    return chosen[filled], filled


def _pixel_grid(x: Float64[np.ndarray, " n"], y: Float64[np.ndarray, " n"]) -> PinholeCamera | None:
    """Return the camera of points that are pixels of a depth image; None if x/z or y/z does not lie on a regular grid."""
    horizontal, vertical = _regular(x), _regular(y)
    if horizontal is None or vertical is None:
        return None
    (fx, cx, width), (fy, cy, height) = horizontal, vertical
    if len(x) > width * height:
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
    if number[-1] >= 4 * LARGEST_PX:
        return None
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
