"""Column loops over matched surfaces, compiled: what follows at their sides."""

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.perception._plane_segmentation_kernels import BORDER_PX

ROWS = 9
"""Number of rows in which the side of a surface is looked at."""


@njit(cache=True, error_model="numpy")
def lateral_ends(nearness, columns, upper, lower, stops, planes, right, look, jump, baseline, pinhole):
    """Return the lateral place of the first and last column of each surface, and what follows: 0 unknown, 1 a wall, 2 nothing near.

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
    places, kinds = np.full((stops.size, 2), np.nan), np.zeros((stops.size, 2), dtype=np.int64)
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
            is_wall = nearer > max(further + empty, on_plane)
            kinds[s, side] = 1 if is_wall else 2 * (further + empty > on_plane)
    return places, kinds
