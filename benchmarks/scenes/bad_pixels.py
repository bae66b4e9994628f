"""Depth images as drivers deliver them: pixels missing at random, holes filled, and mixed depths at edges."""

import cv2
import numpy as np
from jaxtyping import Float32

HOLE_FILLINGS = ("", "left", "nearest", "furthest")
"""Ways to fill holes, as the hole-filling filter of librealsense: from the left neighbour, or from the nearest or the furthest of
the pixels around the hole; the first is none."""
JUMP_RATIO = 1.05
"""Least ratio of two adjacent depths at which pixels mix: 5 % are 5 cm at 1 m, more than a tread seen from a chair's height has
between two pixels."""


def lose_pixels(depth_m: Float32[np.ndarray, "h w"], share: float, rng: np.random.Generator) -> None:
    """Take the depth of a fraction of the pixels, each independent of its neighbours, in place."""
    depth_m[rng.random(depth_m.shape) < share] = np.nan


def mix_at_edges(depth_m: Float32[np.ndarray, "h w"], share: float, rng: np.random.Generator) -> None:
    """Give a fraction of the pixels next to a jump a depth between both sides, in place: flying pixels of time of flight."""
    known = np.nan_to_num(depth_m)
    far = cv2.dilate(known, np.ones((3, 3)))
    near = np.minimum(cv2.erode(np.where(known > 0.0, known, far.max()), np.ones((3, 3))), far)
    mixed = (known > 0.0) & (far > JUMP_RATIO * near) & (rng.random(depth_m.shape) < share)
    depth_m[mixed] = (near + rng.random(depth_m.shape).astype(np.float32) * (far - near))[mixed]


def fill_holes(depth_m: Float32[np.ndarray, "h w"], filling: str) -> Float32[np.ndarray, "h w"]:
    """Return a depth image without holes.

    Args:
        filling: One of ``HOLE_FILLINGS``.
    """
    known = np.isfinite(depth_m) & (depth_m > 0.0)
    if filling == "left":
        columns = np.where(known, np.arange(depth_m.shape[1]), 0)
        return np.take_along_axis(depth_m, np.maximum.accumulate(columns, axis=1), axis=1)
    filled, square = np.where(known, depth_m, 0.0).astype(np.float32), np.ones((3, 3))
    while filling and not known.all() and known.any():
        if filling == "nearest":
            around = cv2.erode(np.where(known, filled, np.float32(1e6)), square)
        else:
            around = cv2.dilate(filled, square)
        grown = cv2.dilate(known.astype(np.uint8), square) > 0
        filled, known = np.where(known, filled, np.where(grown, around, 0.0)).astype(np.float32), grown
    return filled if filling else depth_m
