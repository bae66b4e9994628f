"""Depth bias of a time-of-flight camera by light that takes a detour over another surface."""

import cv2
import numpy as np
from jaxtyping import Float, Int

from treadline.core.images import PinholeCamera
from treadline.plant.sensors.camera import multipath_kernels

CELLS = 32
"""Number of patches along the width of the image: at 1 m a patch is 5 cm wide, a third of a rise."""


def multipath_bias(
    camera: PinholeCamera, exact_m: Float[np.ndarray, "h w"], face: Int[np.ndarray, "h w"], albedos: Float[np.ndarray, " b"]
) -> Float[np.ndarray, "h w"]:
    """Return the depth bias of each pixel [m]: interpolated between patches, zero away from concave corners."""
    height, width = exact_m.shape
    cell = max(round(width / CELLS), 1)
    coarse = np.empty((-(-height // cell), -(-width // cell)))
    multipath_kernels.bounce(exact_m, face, albedos, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, cell, coarse)
    known = np.isfinite(coarse)
    # Patches without a surface take the mean of their neighbours.
    weight = cv2.blur(known.astype(np.float64), (3, 3))
    mean = cv2.blur(np.where(known, coarse, 0.0), (3, 3)) / np.maximum(weight, 1e-9)
    filled = np.where(known, coarse, np.where(weight > 0.0, mean, 0.0))
    size = (filled.shape[1] * cell, filled.shape[0] * cell)
    range_bias = cv2.resize(filled, size, interpolation=cv2.INTER_LINEAR)[:height, :width]
    x = (np.arange(width) - camera.cx_px) / camera.fx_px
    y = (np.arange(height) - camera.cy_px) / camera.fy_px
    return np.asarray(range_bias / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2))
