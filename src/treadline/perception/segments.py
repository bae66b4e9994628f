"""Line segments by the probabilistic Hough transform, and those near zero slope.

Paper: Algorithm 1, step 4; Fig. 5(d).
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

NEAR_ZERO = 0.6
"""|slope| that still counts as near zero: edges seen 30° askew have 0.58."""
VOTES_AT_320 = 40
LENGTH_AT_320_PX = 40
GAP_AT_320_PX = 6


def hough_segments(edges: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "n 4"]:
    """Return segments as u1, v1, u2, v2, the left end first."""
    scale = edges.shape[1] / 320.0
    found = cv2.HoughLinesP(
        edges,
        1.0,
        np.pi / 180.0,
        round(VOTES_AT_320 * scale),
        minLineLength=LENGTH_AT_320_PX * scale,
        maxLineGap=GAP_AT_320_PX * scale,
    )
    if found is None:
        return np.empty((0, 4))
    lines = np.asarray(found, dtype=float).reshape(-1, 4)
    turned = lines[:, 0] > lines[:, 2]
    lines[turned] = lines[turned][:, [2, 3, 0, 1]]
    return lines


def slopes(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """Return Δv/Δu of each segment; infinite for an upright one."""
    du, dv = lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]
    return np.where(du > 0.0, dv / np.where(du > 0.0, du, 1.0), np.inf)


def near_zero(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "m 4"]:
    """Return the segments near zero slope."""
    return lines[np.abs(slopes(lines)) < NEAR_ZERO]
