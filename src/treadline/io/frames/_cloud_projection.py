"""Projection of the points of a cloud into a depth image.

An organised cloud (one point per pixel, row by row) is a depth image already. Its camera follows from the points: in the axes of
the camera ``u = fx·x/z + cx`` and ``v = fy·y/z + cy``; in other axes a direct linear transform gives the 3×4 projection of points
to pixels, and its RQ decomposition the pose of the camera. So are the points of a depth image whose holes were left out, if x/z and
y/z lie on a regular grid. Other clouds are projected into a virtual pinhole camera that looks along z, with the finest pixels that
the cloud fills; in each pixel the points of the nearest surface are averaged.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8
from scipy.linalg import rq

from treadline.core.camera_images import PinholeCamera, black
from treadline.core.errors import ImageError
from treadline.core.rotations import Rotation, Vector3
from treadline.scenario.camera_file import INTRINSICS, SQUARE

FIT_PX = 0.5
"""Largest median residual of the projection [px]: coordinates rounded to a millimetre at 0.5 m give 0.3 px at fx = 600."""
ROUNDS = 8
"""Number of times that the projection is fitted without the points that lie off: 8 % of a Kinect 2's do, and the medians of six
fits to them are 0.82, 0.22, 0.07, 0.03, 0.03 and 0.03 px."""
KEPT = 3.0
"""Largest residual of a point that belongs to its pixel, in medians; below ``FIT_PX``, half a pixel, it is never too large."""
FLAT = 1e-3
"""Least ratio of the second singular value of the projection's equations to the largest: points on a plane, or on a line, have many
projections. A Kinect 2's view of a stair has 0.1; depths rounded to a millimetre at 1 m give a wall 1e-3."""
SAMPLE = 20_000
"""Number of points from which unit, axes and camera follow; the camera of exact points is exact from six of them."""
GRID_GAP = 1e-4
"""Smallest gap between columns of a pixel grid in x/z: a tenth of a pixel at fx = 1000; single precision is 1e-7."""
GRID_PX = 0.1
"""Largest deviation of x/z from a regular grid [px]."""
SURFACE = 0.05
"""Depth range of one surface in a pixel, relative to its depth: a tread seen at 6° to its plane, 1/(200 px · tan 6°) = 4.8 %."""
SECTOR_TAN = 3.0**0.5
"""Largest x/z and y/z of the virtual camera: a field of view of 120°, the widest of a depth camera (Azure Kinect, wide)."""
POINTS_PER_PIXEL = 1.6
"""Mean number of points in a pixel of the virtual camera: of points at random, 80 % of the pixels hold one."""
COARSEST_PX, LARGEST_PX = 40, 1280
"""Smallest and largest longer side of the virtual camera's image [px]."""

Colours = UInt8[np.ndarray, "n 3"]
Points = Float64[np.ndarray, "n 3"]
Pixels = Float64[np.ndarray, "n 2"]
Numbers = Int64[np.ndarray, " n"]


class Rays(NamedTuple):
    """Points in front of the camera: number in the cloud, depth [m], x/z and y/z."""

    number: Numbers
    depth: Float32[np.ndarray, " n"]
    x: Float32[np.ndarray, " n"]
    y: Float32[np.ndarray, " n"]


class Projection(NamedTuple):
    """Camera, depth image [m], colours, and what a user has to know of the conversion."""

    camera: PinholeCamera
    depth_m: Float32[np.ndarray, "h w"]
    rgb: UInt8[np.ndarray, "h w 3"]
    warning: str | None


def rays_of(points_C: Float32[np.ndarray, "n 3"], number: Numbers) -> Rays:
    """Return the points in front of the camera; ``number`` counts them in their cloud."""
    ahead = points_C[:, 2] > 1e-6
    x, y, z = points_C[ahead].T
    return Rays(number=number[ahead], depth=z, x=x / z, y=y / z)


def organised(
    where: object,
    size_px: tuple[int, int],
    points_F: Points,
    number: Numbers,
    camera: PinholeCamera | None,
    colours: Colours | None,
) -> tuple[Projection, Rotation, Vector3]:
    """Return the depth image that an organised cloud is, and the pose R_CF, p_FC of its camera in the frame F of the points.

    A point that does not belong to its pixel is left out: it lies off by more than half a pixel and by more than usual.

    Args:
        number: Place of each point in the cloud, row by row.
        camera: Camera whose mount the image has.

    Raises:
        ImageError: If the size is not the camera's, if the cloud is no pinhole image, or a mirrored one, or if its points do not
            determine a camera.
    """
    width, height = size_px
    if camera is not None and (camera.width_px, camera.height_px) != size_px:
        raise ImageError(f"{where}: {width}×{height} points, the calibration is for {camera.width_px}×{camera.height_px}")
    pixels = np.stack([number % width, number // width], axis=1).astype(float)
    some = slice(None, None, max(1, len(number) // SAMPLE))
    R_CF, p_FC, (fx, cx, fy, cy), residual_px = _view(where, points_F[some], pixels[some])
    lens = PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)
    seen = rays_of(((points_F - p_FC) @ R_CF.T).astype(np.float32), np.arange(len(number)))
    off_px = np.hypot(seen.x * fx + cx - pixels[seen.number, 0], seen.y * fy + cy - pixels[seen.number, 1])
    kept = off_px <= max(FIT_PX, KEPT * residual_px)
    depth = np.full(width * height, np.nan, dtype=np.float32)
    depth[number[seen.number[kept]]] = seen.depth[kept]
    rgb = black(height, width) if colours is None else colours.reshape(height, width, 3)
    calibrated = lens if camera is None else replace(camera, **{name: getattr(lens, name) for name in INTRINSICS})
    warning = None
    if not np.array_equal(R_CF, np.eye(3)):
        at, right, down, ahead = (np.round(vector, 3).tolist() for vector in (p_FC, *R_CF))
        warning = f"the camera was found in the cloud at {at} m, right {right}, down {down}, forward {ahead}, fx = {fx:.1f} px"
    return Projection(calibrated, depth.reshape(height, width), rgb, warning), R_CF, p_FC


def _view(where: object, points_F: Points, pixels: Pixels) -> tuple[Rotation, Vector3, tuple[float, ...], float]:
    """Return rotation, position, (fx, cx, fy, cy) and residual of the camera: in the cloud's axes, at its origin, or anywhere."""
    least_px, aspect = np.inf, 1.0
    for unknowns in (0, 9, 12):
        R_CF, p_FC, kept = _pose(points_F, pixels, unknowns)
        points_C = (points_F - p_FC) @ R_CF.T
        known = kept & (points_C[:, 2] > 0.0)
        if not known.any():
            continue
        x, y = (points_C[known, :2] / points_C[known, 2:]).T
        (fx, cx, off_u), (fy, cy, off_v) = _line(x, pixels[known, 0]), _line(y, pixels[known, 1])
        residual_px = float(np.median(np.hypot(off_u, off_v)))
        ratio = fx / fy if fy else np.inf
        least_px, aspect = min((least_px, aspect), (residual_px, ratio))
        if residual_px <= FIT_PX and SQUARE[0] <= ratio <= SQUARE[1] and fx > 0.0:
            if np.linalg.det(R_CF) > 0.0:
                return R_CF, p_FC, (fx, cx, fy, cy), residual_px
            raise ImageError(f"{where}: mirrored: x, y, z are left-handed in the image; reverse its rows or columns, or one axis")
    if not kept.any():
        raise ImageError(f"{where}: the points lie on a plane or on a line, which many cameras see alike; show more of the place")
    raise ImageError(
        f"{where}: not a pinhole image: residual {least_px:.2g} px, at most {FIT_PX:g}, fx / fy = {aspect:.2f} (lens distortion, a "
        "spinning lidar, or points in another order than their pixels); remove the distortion, or export it unorganised"
    )


def _pose(points: Points, pixels: Pixels, unknowns: int) -> tuple[Rotation, Vector3, Bool[np.ndarray, " n"]]:
    """Return rotation and position of the camera that projects points to pixels, and the points that fit (direct linear transform).

    No point fits if the points lie on a plane or on a line, or for a camera at the origin if they all lie in one direction.
    Each point gives two homogeneous equations; after the first fit they are divided by the depth, which makes their residuals
    distances in the image. The rotation is an improper one if the image is mirrored.

    Args:
        unknowns: Number of elements of the projection: 12, 9 for a camera at the origin, or 0 for one with the points' axes.
    """
    weight, kept = np.ones(len(points)), np.ones(len(points), dtype=bool)
    if not unknowns:
        return np.eye(3), np.zeros(3), kept
    middle = points.mean(axis=0) if unknowns == 12 else np.zeros(3)
    q = (pixels - pixels.mean(axis=0)) / pixels.std()
    X = np.column_stack([(points - middle) / np.abs(points - middle).mean(), np.ones(len(points))])[:, : unknowns // 3]
    rows = np.concatenate([np.hstack([X, 0.0 * X, -q[:, :1] * X]), np.hstack([0.0 * X, X, -q[:, 1:] * X])])
    for _ in range(ROUNDS):
        equations = np.tile(weight, 2)[:, None] * rows
        squares, vectors = np.linalg.eigh(equations.T @ equations)
        if not squares[1] > FLAT**2 * squares[-1]:
            return np.eye(3), middle, np.zeros(len(points), dtype=bool)
        P = vectors[:, 0].reshape(3, -1)
        seen = X @ P.T
        off = np.hypot(*(seen[:, :2] / seen[:, 2:] - q).T)
        kept = off <= KEPT * max(float(np.median(off)), 1e-9)
        weight = kept / np.abs(seen[:, 2])
    K, R = rq(np.sign(np.median(seen[:, 2])) * P[:, :3])
    offset = np.linalg.solve(P[:, :3], P[:, 3]) * np.abs(points - middle).mean() if unknowns == 12 else np.zeros(3)
    return np.sign(np.diag(K))[:, None] * R, middle - offset, kept


def _line(ratio: Float64[np.ndarray, " n"], pixel: Float64[np.ndarray, " n"]) -> tuple[float, float, Float64[np.ndarray, " n"]]:
    """Return focal length, centre and residuals of ``pixel = focal·ratio + centre``."""
    spread = ratio - ratio.mean()
    variance = float(spread @ spread)
    focal = float(spread @ pixel) / variance if variance > 0.0 else 0.0
    centre = float(pixel.mean() - focal * ratio.mean())
    return focal, centre, pixel - focal * ratio - centre


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
    focal, centre, _ = _line(lines, number)
    off_px = np.abs(focal * ratio + centre - np.round(focal * ratio + centre))
    if focal <= 0.0 or number[-1] >= 4 * LARGEST_PX or float(np.percentile(off_px, 99.0)) > GRID_PX:
        return None
    return focal, centre, int(number[-1]) + 1


def _virtual_camera(x: Float64[np.ndarray, " n"], y: Float64[np.ndarray, " n"]) -> PinholeCamera:
    """Return the camera that holds the cloud without its outermost half percent on each side, as fine as the cloud fills it."""
    (left, right), (top, bottom) = (np.percentile(ratio, (0.5, 99.5)) for ratio in (x, y))
    wide, high = max(float(right - left), 1e-3), max(float(bottom - top), 1e-3)
    coarse, largest = COARSEST_PX / max(wide, high), LARGEST_PX / max(wide, high)
    held = np.unique(np.floor(np.stack([x, y]) * coarse), axis=1).shape[1]
    focal = float(np.clip(coarse * np.sqrt(len(x) / (POINTS_PER_PIXEL * held)), coarse, largest))
    width, height = (max(16, int(np.ceil(focal * side))) for side in (wide, high))
    cx, cy = float(-focal * left), float(-focal * top)
    return PinholeCamera(width_px=width, height_px=height, fx_px=focal, fy_px=focal, cx_px=cx, cy_px=cy)
