"""Effect of a depth warp of the camera on planes fitted to depth.

A calibration leaves a smooth error across the image, specific to the camera and constant over frames. It is modelled by Legendre
terms up to third order in the image coordinates, with decreasing sizes. Each term rotates a surface's normal as given by the
best-fitting plane over the surface's pixels; image lines are unaffected.
"""

import numpy as np
from jaxtyping import Float

from treadline.perception.nuisance import kernels
from treadline.perception.surfaces import DISPARITY_PX_M, Surface
from treadline.signals import PinholeCamera

ORDER = 3
"""Largest order of the Legendre terms."""
POWERS = tuple((i, j) for i in range(ORDER + 1) for j in range(ORDER + 1) if 0 < i + j <= ORDER)
"""Orders down and across the image; the constant term is excluded."""
TERMS = len(POWERS)
"""Number of terms."""
_SIZES = np.array([1.0 / (1.0 + i + j) for i, j in POWERS])
_SQUARES = np.array([1.0 / ((2.0 * i + 1.0) * (2.0 * j + 1.0)) for i, j in POWERS])
SIZES = _SIZES / np.sqrt(_SIZES**2 @ _SQUARES) / DISPARITY_PX_M
"""Standard deviation of each term [1/m] for a warp of 1 px of Kinect disparity over the image."""
POINTS = 16
"""Number of columns used to represent a surface."""


def turns_of(surface: Surface, camera: PinholeCamera) -> Float[np.ndarray, "3 t"]:
    """Return the derivative of a surface's n with respect to each term of a warp of 1 px (one sigma)."""
    columns, top, bottom = surface.upper.columns, surface.upper.rows, surface.lower.rows
    if columns.size < 2:  # with unknown ends the surface is assumed to fill the image
        columns, top, bottom = np.array([0, camera.width_px - 1]), np.zeros(2), np.full(2, camera.height_px - 1.0)
    turns = np.empty((3, TERMS))
    size, pinhole = (camera.width_px, camera.height_px), (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    kernels.fitted_terms(columns, top, bottom, POINTS, *size, *pinhole, turns)
    return turns * SIZES
