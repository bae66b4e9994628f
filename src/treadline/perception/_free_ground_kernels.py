"""Points of a depth image: those above a flight, at the places of a next step, and on level ground; compiled.

``pinhole`` is fx, fy, cx, cy in pixels.
"""

import math
from typing import no_type_check

import numpy as np

from treadline.core.fma import dot, fused
from treadline.core.kernel_cache import njit


@njit(cache=True, error_model="numpy")
@no_type_check
def points_above(depth, stride, pinhole, axes, level, foot, low, blur, high, begin, start, end):
    """Return the points of every ``stride``-th pixel above a flight.

    Args:
        axes: Rows: ahead, normal of the nosing plane, up.
        level: Height of the nosing plane along its normal; ``foot``: height of the ground before it along up.
        low: Least height above these for a point, ``blur`` times its depth if larger, and largest height ``high``.
        begin: Range along ahead: the foot from ``begin`` to ``start``, the nosing plane from there to ``end``.
    """
    fx, fy, cx, cy = pinhole
    rows, columns = depth.shape
    found = np.empty((((rows + stride - 1) // stride) * ((columns + stride - 1) // stride), 3))
    count = 0
    for v in range(0, rows, stride):
        y = (v - cy) / fy
        for u in range(0, columns, stride):
            z = depth[v, u]
            if not (z > 0.0 and z < 1e6):
                continue
            x = (u - cx) / fx
            ahead = z * (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2])
            if not (begin < ahead < end):
                continue
            if ahead < start:
                above = z * (axes[2, 0] * x + axes[2, 1] * y + axes[2, 2]) - foot
            else:
                above = z * (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2]) - level
            if not (max(low, blur * z) < above < high):
                continue
            found[count, 0], found[count, 1], found[count, 2] = x * z, y * z, z
            count += 1
    return found[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def depths_at(depth, aheads, asides, heights, axes, pinhole):
    """Return the measured depth at the points of a grid and their geometric depth, where both exist.

    Args:
        axes: Rows: the directions in C of ``aheads``, ``asides`` and ``heights``.
    """
    fx, fy, cx, cy = pinhole
    seen, expected = np.empty(aheads.size * asides.size * heights.size), np.empty(aheads.size * asides.size * heights.size)
    count, point = 0, np.empty(3)
    for ahead in aheads:
        for height in heights:
            for aside in asides:
                for i in range(3):
                    point[i] = fused(height, axes[2, i], fused(aside, axes[1, i], ahead * axes[0, i]))
                if not point[2] > 0.1:
                    continue
                u, v = np.rint(fx * point[0] / point[2] + cx), np.rint(fy * point[1] / point[2] + cy)
                if not (0 <= u < depth.shape[1] and 0 <= v < depth.shape[0]):
                    continue
                z = depth[int(v), int(u)]
                if np.isfinite(z) and z > 0.0:
                    seen[count], expected[count] = z, point[2]
                    count += 1
    return seen[:count].copy(), expected[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def places_of(depth, stride, pinhole, origin, axes):
    """Return pixels as points in C, NaN without depth, and their coordinates along some directions.

    Args:
        depth: Depth of every ``stride``-th pixel of every ``stride``-th row.
        origin: Added to each point.
        axes: Rows: the directions of the coordinates.
    """
    fx, fy, cx, cy = pinhole
    rows, columns = depth.shape
    points, places = np.empty((rows, columns, 3)), np.empty((axes.shape[0], rows, columns))
    for i in range(rows):
        y = (i * stride - cy) / fy
        for j in range(columns):
            z = depth[i, j] if depth[i, j] > 0.0 else np.nan
            point = points[i, j]
            point[0], point[1], point[2] = (j * stride - cx) / fx * z + origin[0], y * z + origin[1], z + origin[2]
            for k in range(axes.shape[0]):
                places[k, i, j] = dot(point, axes[k])
    return points, places


@njit(cache=True, error_model="numpy")
@no_type_check
def level_patches(points, up, level):
    """Return the mask of grid points in horizontal patches of five points.

    Args:
        points: Rows and columns of points, NaN without depth.
        level: Cosine of the largest angle between a patch's normal and ``up``.
    """
    rows, columns = points.shape[0], points.shape[1]
    found = np.zeros((rows, columns), dtype=np.bool_)
    for i in range(2, rows - 2):
        for j in range(2, columns - 2):
            top, bottom, left, right = points[i - 2, j], points[i + 2, j], points[i, j - 2], points[i, j + 2]
            ax, ay, az = bottom[0] - top[0], bottom[1] - top[1], bottom[2] - top[2]
            bx, by, bz = right[0] - left[0], right[1] - left[1], right[2] - left[2]
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            rise = abs(nx * up[0] + ny * up[1] + nz * up[2])
            found[i, j] = rise > level * math.sqrt(nx * nx + ny * ny + nz * nz)
    return found


@njit(cache=True, error_model="numpy")
@no_type_check
def ground_level(points, up, level, far, aside, height, furthest, bin_size, least, width, highest):
    """Return the height of the highest or lowest level in a grid of points wide enough to drive on; NaN without one.

    Args:
        points: Rows and columns of points, NaN without depth.
        level: Cosine of the largest angle between a patch's normal and ``up``.
        far: Coordinate of each point ahead, ``aside`` and ``height`` likewise.
        furthest: Largest distance of a patch.
        bin_size: Height range of patches on one level.
        least: Least number of patches of a level in its own and the next bin.
        width: Lateral extent exceeded by a level.
        highest: Whether to return the highest level, else the lowest.
    """
    patches = level_patches(points, up, level)
    heights, sides, bins = np.empty(patches.size), np.empty(patches.size), np.empty(patches.size, dtype=np.int64)
    count = 0
    for i in range(patches.shape[0]):
        for j in range(patches.shape[1]):
            if patches[i, j] and far[i, j] < furthest:
                heights[count], sides[count] = height[i, j], aside[i, j]
                bins[count] = np.int64(math.floor(height[i, j] / bin_size))
                count += 1
    order = np.sort(bins[:count])
    within = np.empty(count)
    last = count if highest else -1
    while True:
        # The next bin in the order in which levels are tried.
        following = last - 1 if highest else last + 1
        if not 0 <= following < count:
            return np.nan
        place = order[following]
        first, stop = np.searchsorted(order, place), np.searchsorted(order, place, side="right")
        last = first if highest else stop - 1
        beside = place - 1 if highest else place + 1
        together = stop - first + np.searchsorted(order, beside, side="right") - np.searchsorted(order, beside)
        if together < least:
            continue
        low, high, held = np.inf, -np.inf, 0
        for k in range(count):
            if bins[k] == place or bins[k] == beside:
                low, high = min(low, sides[k]), max(high, sides[k])
                within[held] = heights[k]
                held += 1
        if high - low > width:
            return np.median(within[:held])
