"""What a warp of the camera's depth does to the planes that depth shows.

A calibration leaves a smooth error across the image, its own in every camera and the same in every frame. It is taken for
Legendre terms up to third order in the image's coordinates, the slower ones the larger. Each term turns a surface's normal as the
plane that fits it best over the surface's pixels would have it; no line in the image is turned.
"""

import numpy as np
from jaxtyping import Float

from treadline.perception.planes import DISPARITY_PX_M, Surface
from treadline.perception.unknowns import kernels
from treadline.signals import PinholeCamera

ORDER = 3
POWERS = tuple((i, j) for i in range(ORDER + 1) for j in range(ORDER + 1) if 0 < i + j <= ORDER)
"""Orders down and across the image; what is alike everywhere is no warp."""
TERMS = len(POWERS)
_SIZES = np.array([1.0 / (1.0 + i + j) for i, j in POWERS])
_SQUARES = np.array([1.0 / ((2.0 * i + 1.0) * (2.0 * j + 1.0)) for i, j in POWERS])
SIZES = _SIZES / np.sqrt(_SIZES**2 @ _SQUARES) / DISPARITY_PX_M
"""Of each term in 1/m, one sigma, for a warp of 1 px of a Kinect's disparity over the image."""
POINTS = 16
"""Columns of a surface that stand for all."""


def turns_of(surface: Surface, camera: PinholeCamera) -> Float[np.ndarray, "3 t"]:
    """Return by how much each term of a warp of 1 px changes a surface's n, one sigma."""
    columns, top, bottom = surface.upper.columns, surface.upper.rows, surface.lower.rows
    if columns.size < 2:  # where its ends are not known, it is taken to fill the image
        columns, top, bottom = np.array([0, camera.width_px - 1]), np.zeros(2), np.full(2, camera.height_px - 1.0)
    turns = np.empty((3, TERMS))
    size, pinhole = (camera.width_px, camera.height_px), (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    kernels.fitted_terms(columns, top, bottom, POINTS, *size, *pinhole, turns)
    return turns * SIZES
