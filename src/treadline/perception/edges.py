"""Edges of the colour and the depth image, with thresholds taken from the image.

Paper: Algorithm 1, steps 1-3; Fig. 5(a)-(c).
"""

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

Rule = Literal["median", "otsu", "rosin", "mad"]
SPREAD = 0.33
"""Thresholds lie this share below and above the median."""
MAD_COUNT = 5.0
ABRUPT_M = 0.30
"""A depth step over ±2 px larger than this is another surface, not the next tread."""
HALF = 0.5
"""Lower threshold over upper, where a rule gives only the upper."""


def depth_picture(depth_m: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Return inverse depth as grey, near is bright, no return is black."""
    valid = np.isfinite(depth_m) & (depth_m > 0.0)
    picture = np.zeros(depth_m.shape, dtype=np.uint8)
    if not valid.any():
        return picture
    inverse = 1.0 / depth_m[valid]
    low, high = float(inverse.min()), float(inverse.max())
    picture[valid] = np.clip(255.0 * (inverse - low) / max(high - low, 1e-9), 0.0, 255.0).astype(np.uint8)
    return picture


def thresholds(grey: UInt8[np.ndarray, "h w"], rule: Rule) -> tuple[float, float]:
    """Return Canny's lower and upper threshold for one image."""
    if rule == "median":
        median = float(np.median(grey))
        return max(0.0, (1.0 - SPREAD) * median), min(255.0, (1.0 + SPREAD) * median)
    if rule == "otsu":
        upper = float(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0])
        return HALF * upper, upper
    gradient = _gradient(grey)
    if rule == "mad":
        median = float(np.median(gradient))
        upper = median + MAD_COUNT * float(np.median(np.abs(gradient - median)))
    else:
        upper = _rosin(gradient)
    return HALF * upper, upper


def canny(grey: UInt8[np.ndarray, "h w"], rule: Rule) -> UInt8[np.ndarray, "h w"]:
    """Return the edge image (0 or 255) at adaptive thresholds."""
    lower, upper = thresholds(grey, rule)
    return np.asarray(cv2.Canny(grey, lower, upper), dtype=np.uint8)


def without_abrupt(edges: UInt8[np.ndarray, "h w"], depth_m: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Return the edge image without points where depth is missing or jumps."""
    known = np.isfinite(depth_m)
    kernel = np.ones((5, 5), dtype=np.uint8)
    nearest = cv2.erode(np.where(known, depth_m, np.float32(1e3)), kernel)
    furthest = cv2.dilate(np.where(known, depth_m, np.float32(-1e3)), kernel)
    jump = np.asarray(furthest - nearest)
    smooth = (jump >= 0.0) & (jump < ABRUPT_M)
    return np.where(smooth, edges, 0).astype(np.uint8)


def _gradient(grey: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    # The L1 norm, as Canny compares it.
    dx, dy = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    return np.abs(np.asarray(dx, dtype=float)) + np.abs(np.asarray(dy, dtype=float))


def _rosin(values: Float[np.ndarray, "h w"]) -> float:
    """Return the corner of a falling histogram: the bin furthest below the line from its peak to its end."""
    counts, limits = np.histogram(values, bins=256)
    peak, last = int(np.argmax(counts)), int(np.flatnonzero(counts)[-1])
    if last <= peak:
        return float(limits[peak])
    bins = np.arange(peak, last + 1)
    line = counts[peak] + (counts[last] - counts[peak]) * (bins - peak) / (last - peak)
    return float(limits[peak + int(np.argmax(line - counts[peak : last + 1]))])
