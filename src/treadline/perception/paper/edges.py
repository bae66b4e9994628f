"""Stages (b) and (c) of Algorithm 1: adaptive Canny on colour and depth, then removal of depth discontinuities.

Paper: Algorithm 1, steps 2 and 3, Fig. 5(b), (c). The paper does not print its rule for the thresholds ([13]); the usual median
rule is used. The other rules are for comparison: in dim light a rule on grey values fails, a rule on gradients does not.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from treadline.perception.detection import ThresholdRule

MEDIAN_SPREAD = 0.33
"""Relative distance of the thresholds from the median grey value."""
GRADIENT_BINS = 128
"""Number of bins of the gradient histogram."""
DEVIATIONS = 5.0
"""Number of median deviations above the median gradient at which the ``mad`` rule sets its threshold."""
ABRUPT_M = 0.25
"""Depth discontinuity within 3×3 pixels that removes an edge [m]: the paper leaves it open."""
DEPTH_SPAN_M = 4.0
"""Depth mapped to white [m]: the useful range of the Kinect on a stair."""


def grey_of(rgb: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w"]:
    """Return the luminance of a colour image, slightly blurred against sensor noise."""
    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (5, 5), 1.2))


def depth_image(depth_m: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Return depth as an 8-bit image, holes black (Fig. 5a)."""
    return np.asarray(np.clip(np.nan_to_num(depth_m, nan=0.0) / DEPTH_SPAN_M, 0.0, 1.0) * 255.0).astype(np.uint8)


def thresholds(grey: UInt8[np.ndarray, "h w"], rule: ThresholdRule) -> tuple[float, float]:
    """Return Canny's lower and upper threshold on the gradient of an image.

    Paper: Algorithm 1, step 2.

    Args:
        rule: ``median``: a third below and above the median grey value. ``otsu``: Otsu's threshold of the grey values, and half of
            it. ``rosin``: the corner of the gradient's histogram (Rosin, Pattern Recognition 34, 2001), and half of it. ``mad``:
            the gradient's median plus five times its median deviation, and half of that.
    """
    if rule == "otsu":
        upper = float(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0])
        return 0.5 * upper, upper
    if rule in ("rosin", "mad"):
        # |∂u| + |∂v| by Sobel's masks, the measure that Canny compares with its thresholds.
        du, dv = (cv2.Sobel(grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        gradient = np.asarray(np.abs(du) + np.abs(dv), dtype=np.float32)
        middle = float(np.median(gradient))
        far = middle + DEVIATIONS * max(float(np.median(np.abs(gradient - middle))), 1.0)
        upper = _rosin(gradient) if rule == "rosin" else far
        return 0.5 * upper, upper
    middle = float(np.median(grey[grey > 0])) if np.any(grey > 0) else 0.0
    return max(0.0, (1.0 - MEDIAN_SPREAD) * middle), min(255.0, (1.0 + MEDIAN_SPREAD) * middle)


def _rosin(gradient: Float32[np.ndarray, "h w"]) -> float:
    """Return the gradient farthest below the line from the histogram's peak to its last entry."""
    top = max(float(gradient.max()), 1.0)
    # Gradients of integer grey values are integers: narrower bins would be empty.
    counts, edges = np.histogram(gradient, bins=max(1, min(GRADIENT_BINS, int(0.25 * top))), range=(0.0, top))
    peak, last = int(np.argmax(counts)), int(np.flatnonzero(counts)[-1])
    if last <= peak + 1:
        return float(edges[-1])
    places = np.arange(peak, last + 1)
    line = counts[peak] + (counts[last] - counts[peak]) * (places - peak) / (last - peak)
    corner = int(places[int(np.argmax(line - counts[peak : last + 1]))])
    return float(0.5 * (edges[corner] + edges[corner + 1]))


def canny(grey: UInt8[np.ndarray, "h w"], rule: ThresholdRule) -> Bool[np.ndarray, "h w"]:
    """Return the edge pixels of an image.

    Paper: Algorithm 1, step 2.
    """
    lower, upper = thresholds(grey, rule)
    return np.asarray(cv2.Canny(grey, lower, upper)) > 0


def without_abrupt_depth(
    edges: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"], abrupt_m: float = ABRUPT_M
) -> Bool[np.ndarray, "h w"]:
    """Return the edge pixels with valid depth and no depth discontinuity in their neighbourhood.

    Paper: Algorithm 1, step 3.
    """
    known = np.nan_to_num(depth_m, nan=0.0).astype(np.float32)
    kernel = np.ones((3, 3), dtype=np.uint8)
    jump = cv2.dilate(known, kernel) - cv2.erode(known, kernel)
    return edges & (known > 0.0) & (jump < abrupt_m)
