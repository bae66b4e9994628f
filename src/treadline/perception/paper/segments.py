"""Stage (d) of Algorithm 1: line segments by the progressive probabilistic Hough transform, near-horizontal ones kept.

Paper: Algorithm 1, step 4, Fig. 5(d), [14].
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


def near_level(lines: Float[np.ndarray, "n 4"], largest_slope: float) -> Float[np.ndarray, "k 4"]:
    """Return the segments with a slope near zero.

    Paper: Algorithm 1, step 4.
    """
    return lines[np.abs(slopes(lines)) <= largest_slope]
