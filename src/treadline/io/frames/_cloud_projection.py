"""Projection of the points of a cloud into a depth image.

An organised cloud (one point per pixel, row by row) is a depth image already; its intrinsics follow from the points, because
``u = fx·x/z + cx`` and ``v = fy·y/z + cy``. So are the points of a depth image whose holes were left out, if x/z and y/z lie on a
regular grid. Other clouds are projected into a virtual pinhole camera that looks along z, with the finest pixels that the cloud
fills; in each pixel the points of the nearest surface are averaged.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8

from treadline.core.camera_images import PinholeCamera, black
from treadline.core.errors import ImageError
from treadline.scenario.camera_file import INTRINSICS

FIT_PX = 0.5
"""Largest RMS residual of the intrinsics [px]: coordinates rounded to a millimetre at 0.5 m give 0.3 px at fx = 600."""
SAMPLE = 20_000
"""Number of points from which unit, axes and intrinsics follow; the intrinsics of exact points are exact from two of them."""
GRID_GAP = 1e-4
"""Smallest gap between columns of a pixel grid in x/z: a tenth of a pixel at fx = 1000; single precision is 1e-7."""
GRID_PX = 0.1
"""Largest deviation of x/z from a regular grid [px]."""
SURFACE = 0.05
"""Depth range of one surface in a pixel, relative to its depth: a tread seen at 6° to its plane, 1/(200 px · tan 6°) = 4.8 %."""
SECTOR_TAN = 3.0**0.5
"""Largest x/z and y/z of the virtual camera: a field of view of 120°, the widest of a depth camera (Azure Kinect, wide)."""
FILLED, FINER = 0.8, 2.0**0.25
"""Least share of pixels with a point among those between points, and step of the focal length towards it: with points at random,
0.8 is a mean of 1.6 points per pixel; rows of a spinning lidar fill it at one row per pixel."""
COARSEST_PX, LARGEST_PX = 40, 1280
"""Smallest and largest longer side of the virtual camera's image [px]."""


class Rays(NamedTuple):
    """Points in front of the camera: number in the cloud, depth [m], x/z and y/z."""

    number: Int64[np.ndarray, " n"]
    depth: Float32[np.ndarray, " n"]
    x: Float32[np.ndarray, " n"]
    y: Float32[np.ndarray, " n"]


class Projection(NamedTuple):
    """Camera, depth image [m], colours, and what a user has to know of the conversion."""

    camera: PinholeCamera
    depth_m: Float32[np.ndarray, "h w"]
    rgb: UInt8[np.ndarray, "h w 3"]
    warning: str | None


Colours = UInt8[np.ndarray, "n 3"]


def rays_of(points_C: Float32[np.ndarray, "n 3"], number: Int64[np.ndarray, " n"]) -> Rays:
    """Return the points in front of the camera; ``number`` counts them in their cloud."""
    ahead = points_C[:, 2] > 1e-6
    x, y, z = points_C[ahead].T
    return Rays(number=number[ahead], depth=z, x=x / z, y=y / z)


def organised(
    where: object, size_px: tuple[int, int], seen: Rays, camera: PinholeCamera | None, colours: Colours | None
) -> Projection:
    """Return the depth image that an organised cloud is; the projection of one that is none.

    Raises:
        ImageError: If the size is not the camera's.
    """
    width, height = size_px
    if camera is not None and (camera.width_px, camera.height_px) != (width, height):
        raise ImageError(f"{where}: {width}×{height} points, the calibration is for {camera.width_px}×{camera.height_px}")
    some = slice(None, None, max(1, len(seen.number) // SAMPLE))
    fx, cx, rms_u = _line(seen.x[some].astype(float), seen.number[some] % width)
    fy, cy, rms_v = _line(seen.y[some].astype(float), seen.number[some] // width)
    residual = float(np.hypot(rms_u, rms_v))
    if not (residual <= FIT_PX and fx > 0.0 and fy > 0.0):
        image = projected(seen, camera, colours)
        size = f"{image.camera.width_px}×{image.camera.height_px}"
        return image._replace(
            warning=f"the organised cloud is not a pinhole image (residual {residual:.1f} px, at most {FIT_PX:g}: lens "
            f"distortion, a spinning lidar, or another frame than its camera's); seen through a virtual camera of {size} pixels"
        )
    fitted = PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)
    depth = np.full(width * height, np.nan, dtype=np.float32)
    depth[seen.number] = seen.depth
    rgb = black(height, width) if colours is None else colours.reshape(height, width, 3)
    calibrated = fitted if camera is None else replace(camera, **{name: getattr(fitted, name) for name in INTRINSICS})
    return Projection(calibrated, depth.reshape(height, width), rgb, None)


def _line(ratio: Float64[np.ndarray, " n"], pixel: Int64[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Return focal length, centre and RMS residual of ``pixel = focal·ratio + centre``."""
    spread = ratio - ratio.mean()
    variance = float(spread @ spread)
    if variance == 0.0:
        return 0.0, 0.0, np.inf
    focal = float(spread @ pixel) / variance
    centre = float(pixel.mean() - focal * ratio.mean())
    return focal, centre, float(np.sqrt(np.mean((pixel - focal * ratio - centre) ** 2)))


def projected(seen: Rays, camera: PinholeCamera | None, colours: Colours | None) -> Projection:
    """Return the image of points in a camera: the given one, the one of their pixel grid, or a virtual one."""
    grid = _pixel_grid(seen.x.astype(float), seen.y.astype(float)) if camera is None else None
    warning, used = None, camera or grid
    if used is None:
        inside = np.flatnonzero((np.abs(seen.x) <= SECTOR_TAN) & (np.abs(seen.y) <= SECTOR_TAN))
        seen = Rays(*(part[inside] for part in seen))
        used = _virtual_camera(seen.x.astype(float), seen.y.astype(float))
        warning = (
            f"unorganised cloud of {len(inside)} points: seen through a virtual camera of {used.width_px}×{used.height_px} pixels, "
            f"fx = {used.fx_px:.1f} px; an organised cloud, or --camera, keeps the pixels as measured"
        )
    depth, front, pixel = _front_surface(seen, used, is_centred=warning is None)
    rgb = black(used.height_px, used.width_px)
    if colours is not None:
        rgb.reshape(-1, 3)[pixel] = colours[seen.number[front]]
    return Projection(used, depth, rgb, warning)


def _front_surface(
    seen: Rays, camera: PinholeCamera, *, is_centred: bool
) -> tuple[Float32[np.ndarray, "h w"], Int64[np.ndarray, " m"], Int64[np.ndarray, " m"]]:
    """Return the depth of the nearest surface of each pixel, and the points on it with their pixels.

    Inverse depths are averaged, because they are linear in the image on a plane: the nearest point alone would pull a sloping
    surface towards the camera.

    Args:
        is_centred: Whether points are pixels of the camera; others are moved to the centres of their pixels along their surface.
    """
    u, v = seen.x * camera.fx_px + camera.cx_px, seen.y * camera.fy_px + camera.cy_px
    column, row = np.rint(u), np.rint(v)
    inside = np.flatnonzero((column >= 0.0) & (column < camera.width_px) & (row >= 0.0) & (row < camera.height_px))
    pixel, z = (row[inside] * camera.width_px + column[inside]).astype(np.int64), seen.depth[inside]
    nearest = np.full(camera.width_px * camera.height_px, np.inf, dtype=np.float32)
    np.minimum.at(nearest, pixel, z)
    front = z <= (1.0 + SURFACE) * nearest[pixel]
    inside, pixel = inside[front], pixel[front]
    count = np.bincount(pixel, minlength=len(nearest))

    def mean(values: np.ndarray) -> np.ndarray:
        sums = np.bincount(pixel, values[inside], minlength=len(nearest))
        return np.divide(sums, count, out=np.full(len(nearest), np.nan), where=count > 0).reshape(camera.height_px, -1)

    nearness = mean(1.0 / seen.depth)
    if not is_centred:
        right, down = mean(u - column), mean(v - row)
        nearness = nearness - _slope(nearness, right, axis=1) * right - _slope(nearness, down, axis=0) * down
    return (1.0 / nearness).astype(np.float32), inside, pixel


def _slope(nearness: Float64[np.ndarray, "h w"], offset_px: Float64[np.ndarray, "h w"], axis: int) -> Float64[np.ndarray, "h w"]:
    """Return the slope of a surface in the image [1/m per px]: the smaller of those to both neighbours, zero without any.

    Args:
        offset_px: Distance of the points' mean from the pixel's centre, along ``axis``.
    """
    steps = np.diff(nearness, axis=axis) / np.maximum(1.0 + np.diff(offset_px, axis=axis), 0.5)
    unknown = np.full_like(np.take(nearness, [0], axis=axis), np.nan)
    before, after = np.concatenate([unknown, steps], axis=axis), np.concatenate([steps, unknown], axis=axis)
    smaller = np.where(np.abs(before) <= np.abs(after), before, after)
    return np.nan_to_num(np.where(np.isnan(smaller), np.where(np.isnan(before), after, before), smaller))


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
    """Return the camera that holds the cloud without its outermost half percent on each side, as fine as the cloud fills it."""
    (left, right), (top, bottom) = (np.percentile(ratio, (0.5, 99.5)) for ratio in (x, y))
    wide, high = max(float(right - left), 1e-3), max(float(bottom - top), 1e-3)
    focal, largest = COARSEST_PX / max(wide, high), LARGEST_PX / max(wide, high)
    # Headings reach 45°; further aside a pinhole camera stretches the rows of a lidar.
    aside = np.maximum(np.abs(x), np.abs(y))
    near = aside <= max(1.0, float(np.median(aside)))
    u, v = x[near] - left, y[near] - top
    while focal * FINER <= largest and _share_filled(u * focal * FINER, v * focal * FINER) >= FILLED:
        focal *= FINER
    return PinholeCamera(
        width_px=max(16, int(np.ceil(focal * wide))),
        height_px=max(16, int(np.ceil(focal * high))),
        fx_px=focal,
        fy_px=focal,
        cx_px=float(-focal * left),
        cy_px=float(-focal * top),
    )


def _share_filled(u: Float64[np.ndarray, " n"], v: Float64[np.ndarray, " n"]) -> float:
    """Return the share of pixels with a point among those with points on both sides."""
    inside = (u >= 0.0) & (v >= 0.0) & (u <= LARGEST_PX) & (v <= LARGEST_PX)
    column, row = u[inside].astype(np.int64), v[inside].astype(np.int64)
    filled = np.zeros((int(row.max()) + 1, int(column.max()) + 1), dtype=np.uint8)
    filled[row, column] = 1
    return float(filled.sum() / cv2.morphologyEx(filled, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).sum())
