"""Stages (d) to (f) of Algorithm 1: line segments, merging of collinear ones, most frequent slope, bounding box.

Paper: Algorithm 1, steps 4 to 6, Fig. 5(d) to (f), [14]: the progressive probabilistic Hough transform, near-level lines kept. The
printed rule for merging compares slopes in pixels, interpreted as the rise over the image width.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

VOTES = 30
"""Accumulator threshold of the Hough transform."""
LENGTH_SHARE = 0.12
"""Least length of a segment as a fraction of the image width."""
GAP_PX = 6
"""Largest gap within a segment [px]."""
LARGEST_SLOPE = 0.35
"""Largest slope "near zero", which the paper leaves open: 19°."""
SLOPE_PX = 2.0
"""Largest slope difference of merged segments, in rows per hundred columns."""
OFFSET_PX = 10.0
"""Largest difference between the rows of two merged segments at the middle of the image [px]."""
SLOPE_BIN = 0.05
"""Width of a slope bin: 2.9°."""


def segments(edges: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "n 4"]:
    """Return line segments u1, v1, u2, v2, left end first.

    Paper: Algorithm 1, step 4.
    """
    found = cv2.HoughLinesP(
        edges.astype(np.uint8) * 255,
        1.0,
        np.pi / 180.0,
        VOTES,
        minLineLength=LENGTH_SHARE * edges.shape[1],
        maxLineGap=GAP_PX,
    )
    if found is None:
        return np.zeros((0, 4))
    lines = np.asarray(found, dtype=float).reshape(-1, 4)
    turned = lines[:, 0] > lines[:, 2]
    lines[turned] = lines[turned][:, [2, 3, 0, 1]]
    return lines


def slopes(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """Return the slope of each segment, rows per column."""
    return np.asarray((lines[:, 3] - lines[:, 1]) / np.maximum(lines[:, 2] - lines[:, 0], 1e-9))


def near_level(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "k 4"]:
    """Return the segments with a slope near zero.

    Paper: Algorithm 1, step 4.
    """
    return lines[np.abs(slopes(lines)) <= LARGEST_SLOPE]


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
