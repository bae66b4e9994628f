"""Column loops over matched surfaces, compiled: what follows at their sides, and the curvature of their edges."""

import math
from typing import no_type_check

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.perception._plane_segmentation_kernels import BEFORE, BORDER_PX

CUT, WALL, OPEN = 0, 1, 2
"""Codes for the side of a surface: cut off by the image or unknown, a nearer surface, a further one or nothing."""
ROWS = 9
"""Number of rows in which the side of a surface is looked at."""
LEAST = 16
"""Least number of columns of a profile."""
RAGGED_PX, RAGGED_SHARE = 3, 20
"""Least number of columns at either side of a surface that do not belong to its profile, and ratio of all columns to it: depth is
ragged where the surface ends."""
KEPT_SIGMAS = 2.5
"""Largest residual of a point of a profile, in median deviations of a normal error."""
MEDIAN_SIGMA = 1.4826
"""Ratio of the standard deviation of a normal error to its median absolute value."""


@njit(cache=True, error_model="numpy")
@no_type_check
def side_of(nearness, columns, upper, lower, plane, right, way, look, jump, baseline, pinhole):
    """Return the lateral place of a surface's first or last column and the code of what follows.

    Args:
        nearness: Inverse depth, one row per column of the image.
        columns, upper, lower: Columns of the surface and its first and last row there.
        way: -1 for the left side, 1 for the right one.
        look: Largest number of columns past the end.
        jump: Least difference of another surface [1/m].
        baseline: Distance between two imagers, or imager and projector [m]: one of them does not see a band at the image border.
    """
    fx, fy, cx, cy = pinhole
    width, count = nearness.shape[0], columns.size
    if count == 0:
        return np.nan, CUT
    at = 0 if way < 0 else count - 1
    u, middle = columns[at], 0.5 * (upper[at] + lower[at])
    x, y = (u - cx) / fx, (middle - cy) / fy
    there = plane[0] * x + plane[1] * y + plane[2]
    place = (right[0] * x + right[1] * y + right[2]) / there
    if u < BORDER_PX or u >= width - BORDER_PX:
        return place, CUT
    in_band = (u if way < 0 else width - 1 - u) < BORDER_PX + fx * baseline * there
    nearer = further = on_plane = empty = 0
    first, last = upper[at] + 0.5, lower[at] - 0.5
    for i in range(ROWS):
        row = int(round(first + (i + 1.0) / (ROWS + 1.0) * (last - first)))
        y = (row - cy) / fy
        code = 0
        for k in range(2, look + 1):
            column = u + way * k
            if not 0 <= column < width:
                break
            w = nearness[column, row]
            if w != w:
                continue
            off = w - (plane[0] * (column - cx) / fx + plane[1] * y + plane[2])
            if off > jump:
                code = 1
                break
            if off < -jump:
                code = 2
                break
            code = 3
        if code == 1:
            nearer += 1
        elif code == 2:
            further += 1
        elif code == 3:
            on_plane += 1
        elif not in_band:
            empty += 1
    # No depth at all past a surface is a drop out of range; a shadow falls on one side of a sensor alone.
    away = further + empty
    if nearer > max(away, on_plane):
        return place, WALL
    if away > on_plane:
        return place, OPEN
    return place, CUT


@njit(cache=True, error_model="numpy")
@no_type_check
def curvature_of(
    nearness, columns, upper, lower, rows, follows, plane, ahead, right, is_riser, parts, bin_m, pinhole, profile, held_by
):
    """Return the curvature of a surface's edge, its standard deviation, mean lateral position and width; NaN without a profile.

    Args:
        rows, follows: End of a tread at its nosing, and the codes of its surroundings.
        ahead, right: Directions in C.
        is_riser: Whether the profile is the face of a riser; otherwise the end of a tread.
        profile: Filled with the mean residual in bins of ``bin_m`` across, the middle one at the camera; ``held_by`` with the
            inverse of its variance for white noise, zero without points.
    """
    fx, fy, cx, cy = pinhole
    profile[:], held_by[:] = 0.0, 0.0
    x, y = np.empty(columns.size), np.empty(columns.size)
    count, ragged = 0, max(RAGGED_PX, columns.size // RAGGED_SHARE)
    for k in range(ragged, columns.size - ragged):
        a = (columns[k] - cx) / fx
        if is_riser:
            total, held = 0.0, 0
            for row in range(int(upper[k] + 1.5), int(lower[k] - 0.5)):
                w = nearness[columns[k], row]
                if w == w:
                    total += w - plane[0] * a - plane[1] * (row - cy) / fy - plane[2]
                    held += 1
            if held < 3:
                continue
            b = (0.5 * (upper[k] + lower[k]) - cy) / fy
            w = plane[0] * a + plane[1] * b + plane[2] + total / held
        else:
            if follows[k] == BEFORE or not BORDER_PX <= rows[k] < nearness.shape[1] - BORDER_PX:
                continue
            b = (rows[k] - cy) / fy
            w = plane[0] * a + plane[1] * b + plane[2]
        y[count] = (ahead[0] * a + ahead[1] * b + ahead[2]) / w
        x[count] = (right[0] * a + right[1] * b + right[2]) / w
        count += 1
    if count < LEAST:
        return np.nan, np.inf, 0.0, 0.0
    x, y = x[:count], y[:count]
    middle = x.mean()
    kept = np.ones(count, dtype=np.bool_)
    normal, moment, solution, off = np.empty((3, 3)), np.empty(3), np.zeros(3), np.empty(count)
    for _ in range(3):
        normal[:], moment[:], held = 0.0, 0.0, 0
        for k in range(count):
            if kept[k]:
                t = x[k] - middle
                row = (1.0, t, 0.5 * t * t)
                for i in range(3):
                    moment[i] += row[i] * y[k]
                    for j in range(3):
                        normal[i, j] += row[i] * row[j]
                held += 1
        if held < LEAST:
            return np.nan, np.inf, 0.0, 0.0
        solution = np.linalg.solve(normal, moment)
        for k in range(count):
            t = x[k] - middle
            off[k] = y[k] - solution[0] - solution[1] * t - 0.5 * solution[2] * t * t
        near = KEPT_SIGMAS * MEDIAN_SIGMA * np.median(np.abs(off))
        for k in range(count):
            kept[k] = abs(off[k]) <= near
    # Errors of adjacent columns are correlated: the means of parts give the variance of the curvature.
    sums, held_in, index = np.zeros(parts), np.zeros(parts), 0
    total = 0
    for k in range(count):
        total += kept[k]
    for k in range(count):
        if kept[k]:
            part = min(parts * index // total, parts - 1)
            sums[part] += off[k]
            held_in[part] += 1.0
            index += 1
    spread, filled = 0.0, 0
    for part in range(parts):
        if held_in[part] > 0.0:
            spread += sums[part] ** 2 / held_in[part]
            filled += 1
    variance = spread / max(filled - 3, 1)
    for k in range(count):
        place = int(math.floor(x[k] / bin_m + 0.5)) + profile.size // 2
        # A strip next to the flight's own surface, not another object.
        if abs(off[k]) <= 3.0 * near and 0 <= place < profile.size:
            profile[place] += off[k]
            held_by[place] += 1.0
    for place in range(profile.size):
        if held_by[place] > 0.0:
            profile[place] /= held_by[place]
            held_by[place] /= max(variance, 1e-12)
    return solution[2], math.sqrt(variance * np.linalg.inv(normal)[2, 2]), middle, x.max() - x.min()


@njit(cache=True, error_model="numpy")
@no_type_check
def common_square(profiles, weights):
    """Return the mean square of what profiles have in common, beyond their scatter about it; zero for a single profile.

    Args:
        profiles: One row per surface, ``weights`` the inverse variance of each value.
    """
    total, own, expected, bins = 0.0, 0.0, 0.0, 0
    for place in range(profiles.shape[1]):
        weight, mean, held = 0.0, 0.0, 0
        for k in range(profiles.shape[0]):
            if weights[k, place] > 0.0:
                weight += weights[k, place]
                mean += weights[k, place] * profiles[k, place]
                held += 1
        if held < 2:
            continue
        mean /= weight
        scatter = 0.0
        for k in range(profiles.shape[0]):
            scatter += weights[k, place] * (profiles[k, place] - mean) ** 2
        total += mean * mean
        own += weight * mean * mean
        expected += scatter / (held - 1)
        bins += 1
    if bins == 0:
        return 0.0, 0.0
    return total / bins, own / max(expected, 1e-12)
