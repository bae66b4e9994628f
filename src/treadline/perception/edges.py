"""Stage (b) and (c) of Algorithm 1: adaptive Canny on colour and depth, then the removal of abrupt depths.

Paper: Algorithm 1, steps 2 and 3, Fig. 5(b), (c). The paper's rule for the thresholds ([13]) is not in its text; the
median rule is the usual one and stands for it.
"""

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

ThresholdRule = Literal["median", "otsu"]
MEDIAN_SPREAD = 0.33
"""Thresholds at ± a third of the median grey value."""
DEPTH_SPAN_M = 4.0
"""Depth that maps to white: the Kinect's useful range on a stair."""


def grey_of(rgb: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w"]:
    """Return the luminance of a colour image, lightly blurred against sensor noise."""
    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (5, 5), 1.2))


def depth_image(depth_m: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Return depth as an 8-bit picture, holes black (Fig. 5a)."""
    return np.asarray(np.clip(np.nan_to_num(depth_m, nan=0.0) / DEPTH_SPAN_M, 0.0, 1.0) * 255.0).astype(np.uint8)


def thresholds(grey: UInt8[np.ndarray, "h w"], rule: ThresholdRule) -> tuple[float, float]:
    """Return Canny's lower and upper threshold for a picture.

    Paper: Algorithm 1, step 2.
    """
    if rule == "otsu":
        upper = float(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0])
        return 0.5 * upper, upper
    middle = float(np.median(grey[grey > 0])) if np.any(grey > 0) else 0.0
    return max(0.0, (1.0 - MEDIAN_SPREAD) * middle), min(255.0, (1.0 + MEDIAN_SPREAD) * middle)


def canny(grey: UInt8[np.ndarray, "h w"], rule: ThresholdRule) -> Bool[np.ndarray, "h w"]:
    """Return the edge pixels of a picture.

    Paper: Algorithm 1, step 2.
    """
    lower, upper = thresholds(grey, rule)
    return np.asarray(cv2.Canny(grey, lower, upper)) > 0


def without_abrupt_depth(
    edges: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"], abrupt_m: float
) -> Bool[np.ndarray, "h w"]:
    """Return the edge pixels whose neighbourhood has a depth and no jump.

    Paper: Algorithm 1, step 3.
    """
    known = np.nan_to_num(depth_m, nan=0.0).astype(np.float32)
    kernel = np.ones((3, 3), dtype=np.uint8)
    jump = cv2.dilate(known, kernel) - cv2.erode(known, kernel)
    return edges & (known > 0.0) & (jump < abrupt_m)
