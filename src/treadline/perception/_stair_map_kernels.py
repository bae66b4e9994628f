"""Points of a depth image: those above a flight, and at the places of a next step; compiled.

``pinhole`` is fx, fy, cx, cy in pixels.
"""

from typing import no_type_check

import numpy as np

from treadline.core.fma import fused
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
