"""Column loops over matched surfaces, compiled: what follows at their sides, and the profiles of their edges."""

import math

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.perception._plane_segmentation_kernels import BEFORE, BORDER_PX

ROWS = 9
"""Number of rows in which the side of a surface is looked at."""


@njit(cache=True, error_model="numpy")
def sides_of(nearness, columns, upper, lower, stops, planes, right, look, jump, baseline, pinhole):
    """Return the lateral place of the first and last column of each surface, and whether it ends at a wall or openly there.

    Args:
        nearness: Inverse depth, one row per column of the image.
        columns, upper, lower: Columns of the surfaces, one after the other, and their first and last row there.
        stops: Number of columns up to the end of each surface.
        look: Largest number of columns past the end.
        jump: Least difference of another surface [1/m].
        baseline: Distance between two imagers, or imager and projector [m]: one of them does not see a band at the image border.
    """
    fx, fy, cx, cy = pinhole
    width = nearness.shape[0]
    places, walls, opens = np.full((stops.size, 2), np.nan), np.zeros((stops.size, 2)) > 0.0, np.zeros((stops.size, 2)) > 0.0
    for s in range(stops.size):
        start = stops[s - 1] if s else 0
        if stops[s] == start:
            continue
        plane = planes[s]
        for side in range(2):
            way, at = 2 * side - 1, (stops[s] - 1 if side else start)
            u = columns[at]
            x, y = (u - cx) / fx, (0.5 * (upper[at] + lower[at]) - cy) / fy
            there = plane[0] * x + plane[1] * y + plane[2]
            places[s, side] = (right[0] * x + right[1] * y + right[2]) / there
            if u < BORDER_PX or u >= width - BORDER_PX:
                continue
            nearer = further = on_plane = empty = 0
            for i in range(ROWS):
                row = int(round(upper[at] + 0.5 + (i + 1.0) / (ROWS + 1.0) * (lower[at] - upper[at] - 1.0)))
                found = 0
                for k in range(2, look + 1):
                    column = u + way * k
                    if not 0 <= column < width:
                        break
                    w = nearness[column, row]
                    if w == w:
                        off = w - (plane[0] * (column - cx) / fx + plane[1] * (row - cy) / fy + plane[2])
                        found = 1 if off > jump else 2 if off < -jump else 3
                        if found != 3:
                            break
                nearer += found == 1
                further += found == 2
                on_plane += found == 3
                empty += found == 0
            # No depth at all past a surface is a drop out of range; a shadow falls on one side of a sensor alone.
            if (u if way < 0 else width - 1 - u) < BORDER_PX + fx * baseline * there:
                empty = 0
            walls[s, side] = nearer > max(further + empty, on_plane)
            opens[s, side] = not walls[s, side] and further + empty > on_plane
    return places, walls, opens


@njit(cache=True, error_model="numpy")
def profiles_of(nearness, columns, upper, lower, ends, follows, stops, planes, faces, ahead, right, bin_m, bins, pinhole):
    """Return how far ahead the edge of each surface lies in bins across the flight, and the number of columns in each.

    Args:
        ends, follows: Rows of each surface's edge, and the codes of its surroundings.
        faces: Whether the edge is the face of a riser, whose columns are averaged; otherwise it is the end of a tread.
        ahead, right: Directions in C.
        bins: Number of bins of ``bin_m``; the middle one is at the camera.
    """
    fx, fy, cx, cy = pinhole
    places, counts = np.zeros((stops.size, bins)), np.zeros((stops.size, bins))
    for s in range(stops.size):
        plane = planes[s]
        for k in range(stops[s - 1] if s else 0, stops[s]):
            a, row, off, held = (columns[k] - cx) / fx, ends[k], 0.0, 0
            if faces[s]:
                for v in range(int(upper[k] + 1.5), int(lower[k] - 0.5)):
                    w = nearness[columns[k], v]
                    if w == w:
                        off += w - plane[0] * a - plane[1] * (v - cy) / fy - plane[2]
                        held += 1
                if held < 3:
                    continue
                row, off = 0.5 * (upper[k] + lower[k]), off / held
            elif follows[k] == BEFORE or not BORDER_PX <= row < nearness.shape[1] - BORDER_PX:
                continue
            b = (row - cy) / fy
            w = plane[0] * a + plane[1] * b + plane[2] + off
            place = int(math.floor((right[0] * a + right[1] * b + right[2]) / w / bin_m + 0.5)) + bins // 2
            if 0 <= place < bins:
                places[s, place] += (ahead[0] * a + ahead[1] * b + ahead[2]) / w
                counts[s, place] += 1.0
    return places / np.maximum(counts, 1.0), counts
