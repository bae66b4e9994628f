"""First faces that the rays of a camera meet in an elevation map; compiled. Lengths are in cells of the map."""

import numpy as np

from treadline.core.kernel_cache import njit


@njit(cache=True, error_model="numpy")
def cast(heights, eye, rotation, pinhole, depth):
    """Fill the depth image of a grid.

    Args:
        heights: Height of each cell; not finite where it is unknown.
        eye: Position of the camera; the corner of the grid is the origin.
        rotation: Rotation of the camera in the axes of the grid.
        pinhole: Focal lengths and principal point fx, fy, cx, cy [px].
        depth: Depth image; NaN where a ray meets nothing that is known.
    """
    fx, fy, cx, cy = pinhole
    ray = np.empty(3)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            for axis in range(3):
                ray[axis] = rotation[axis, 0] * (u - cx) / fx + rotation[axis, 1] * (v - cy) / fy + rotation[axis, 2]
            depth[v, u] = _first_face(heights, eye, ray)


@njit(cache=True, error_model="numpy")
def _first_face(heights, eye, ray):
    """Return the depth of the first face on a ray, from cell to cell.

    A ray that enters a column below its top has met the upright face between two cells; between a known and an unknown one, and at
    the border of the map, no face is known.
    """
    depth, far = 0.0, np.inf
    for axis in range(2):
        first, last = -eye[axis] / ray[axis], (heights.shape[axis] - eye[axis]) / ray[axis]
        depth, far = max(depth, min(first, last)), min(far, max(first, last))
    if not far > depth:
        return np.nan
    row = min(max(int(np.floor(eye[0] + depth * ray[0])), 0), heights.shape[0] - 1)
    column = min(max(int(np.floor(eye[1] + depth * ray[1])), 0), heights.shape[1] - 1)
    was_known = False
    while 0 <= row < heights.shape[0] and 0 <= column < heights.shape[1]:
        top = heights[row, column]
        if eye[2] + depth * ray[2] < top:
            return depth if was_known else np.nan
        along = (row + (ray[0] > 0.0) - eye[0]) / ray[0]
        across = (column + (ray[1] > 0.0) - eye[1]) / ray[1]
        if eye[2] + min(along, across) * ray[2] <= top:
            return (top - eye[2]) / ray[2]
        if along < across:
            row += 1 if ray[0] > 0.0 else -1
        else:
            column += 1 if ray[1] > 0.0 else -1
        depth, was_known = min(along, across), np.isfinite(top)
    return np.nan
