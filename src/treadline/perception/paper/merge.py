"""Stages (e) and (f) of Algorithm 1: merging of collinear segments, most frequent slope, bounding box.

Paper: Algorithm 1, steps 5 and 6, Fig. 5(e), (f). The printed rule compares slopes in pixels, interpreted as the rise over the
image width.
"""

import numpy as np
from jaxtyping import Float

from treadline.perception.paper.segments import slopes

SLOPE_PX = 2.0
"""Largest slope difference of merged segments, in rows per hundred columns."""
OFFSET_PX = 10.0
"""Largest difference between the rows of two merged segments at the middle of the image [px]."""
SLOPE_BIN = 0.05
"""Width of a slope bin: 2.9°."""


def merged(lines: Float[np.ndarray, "n 4"], width_px: int) -> Float[np.ndarray, "k 4"]:
    """Return segments with collinear ones merged.

    Paper: Algorithm 1, step 5.
    """
    slope = slopes(lines)
    offset = lines[:, 1] + slope * (0.5 * width_px - lines[:, 0])
    order = np.argsort(offset)
    groups: list[list[int]] = []
    for i in order:
        if groups:
            last = groups[-1][-1]
            near = abs(offset[i] - offset[last]) < OFFSET_PX and 100.0 * abs(slope[i] - slope[last]) < SLOPE_PX
            if near:
                groups[-1].append(int(i))
                continue
        groups.append([int(i)])
    return np.array([_joined(lines[group]) for group in groups]).reshape(-1, 4)


def _joined(lines: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, " 4"]:
    """Return the segment through all ends, from the leftmost to the rightmost."""
    u, v = lines[:, [0, 2]].ravel(), lines[:, [1, 3]].ravel()
    left, right = float(u.min()), float(u.max())
    gradient, intercept = np.polyfit(u, v, 1) if right > left else (0.0, float(v.mean()))
    return np.array([left, gradient * left + intercept, right, gradient * right + intercept])


def most_frequent_slope(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "k 4"]:
    """Return the segments with slopes in the fullest bin or the adjacent ones.

    Paper: Algorithm 1, step 5.
    """
    if len(lines) == 0:
        return lines
    bins = np.round(slopes(lines) / SLOPE_BIN).astype(int)
    values, counts = np.unique(bins, return_counts=True)
    best = values[int(np.argmax(counts))]
    return lines[np.abs(bins - best) <= 1]


def bounding_box(lines: Float[np.ndarray, "n 4"]) -> tuple[int, int, int, int]:
    """Return (u_min, v_min, u_max, v_max) of the segments' ends.

    Paper: Algorithm 1, step 6.
    """
    u, v = lines[:, [0, 2]], lines[:, [1, 3]]
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())
