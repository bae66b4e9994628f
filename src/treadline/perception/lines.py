"""Nosings as lines: where a tread or riser ends in the image and what lies behind is further away.

A line in the image and the camera's centre span a plane that holds the edge itself, so its normal m says m·e = 0, as the
normal of a tread does. No depth along the edge is needed, where depth is at its worst.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.perception import kernels
from treadline.perception.planes import Ends, Surface
from treadline.signals import PinholeCamera

NEAR_AT_240 = 1.5
"""Rows within which a point lies on a line, for an image of 240 rows: depth is ragged at its edges."""
ALIASING_PX = 0.15
"""By which a line's ends may be off against each other in the same sense however many points it has: rows are whole numbers."""
LEAST_SHARE = 0.08
"""Of the image's width that a line must have."""
BEYOND_SHARE = 0.5
"""Of a surface's end at which what follows must lie further away: else it is a corner, or something stands before it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """One nosing in the image."""

    normal: Float[np.ndarray, " 3"]
    """Unit normal m of the plane through the line and the camera's centre, in C."""
    covariance: Float[np.ndarray, "3 3"]
    """Of m, from the scatter of the points about the line."""
    middle: Float[np.ndarray, " 3"]
    """The line's middle on its surface, in C [m]."""
    ends_m: Float[np.ndarray, "2 3"]
    """Its ends on its surface, in C, left end first."""
    ends_px: Float[np.ndarray, " 4"]
    """u1, v1, u2, v2, left end first."""
    is_corner: bool
    """Whether a riser starts there, and not something further away."""
    count: int
    """Columns in which it was seen."""


def nosing_line(surface: Surface, end: Literal["upper", "lower"], camera: PinholeCamera) -> Line | None:
    """Return the line at which a surface ends before something further away, or at a corner, or None.

    A corner is a riser too low in the image to be a surface of its own. Where a surface is left is off by the same everywhere
    along a corner, so that the line's direction is not.
    """
    ends: Ends = surface.upper if end == "upper" else surface.lower
    apart = ends.follows == kernels.BEYOND
    share = BEYOND_SHARE * np.count_nonzero(ends.follows != kernels.UNKNOWN)
    least = LEAST_SHARE * camera.width_px
    is_corner = bool(np.count_nonzero(apart) < share)
    if is_corner:
        apart = ends.follows == kernels.CREASE
    if np.count_nonzero(apart) < max(least, share):
        return None
    columns, rows = ends.columns[apart].astype(float), ends.rows[apart]
    fitted = np.empty(5)
    count = kernels.fit_line(columns, rows, NEAR_AT_240 * camera.height_px / 240, fitted)
    if count < least:
        return None
    a, v0, u0, var_a, var_v = fitted.tolist()
    left, right = float(columns[0]), float(columns[-1])
    pixels = np.array([[u, v0 + a * (u - u0)] for u in (u0, left, right)])
    points = _on_surface(surface, pixels, camera)
    if points is None:
        return None
    normal, covariance = _plane_through(a, v0, u0, var_a + (ALIASING_PX / (right - left)) ** 2, var_v, camera)
    return Line(
        normal=normal,
        covariance=covariance,
        middle=points[0],
        ends_m=points[1:],
        ends_px=pixels[1:].ravel(),
        is_corner=is_corner,
        count=count,
    )


def _on_surface(surface: Surface, pixels: Float[np.ndarray, "k 2"], camera: PinholeCamera) -> Float[np.ndarray, "k 3"] | None:
    """Return the points of C at which pixels show a surface, or None where one would lie behind the camera."""
    rays = np.ones((len(pixels), 3))
    rays[:, 0] = (pixels[:, 0] - camera.cx_px) / camera.fx_px
    rays[:, 1] = (pixels[:, 1] - camera.cy_px) / camera.fy_px
    nearness = rays @ surface.normal
    return None if float(nearness.min()) <= 0.0 else rays / nearness[:, None]


def _plane_through(
    a: float, v0: float, u0: float, var_a: float, var_v: float, camera: PinholeCamera
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """Return the unit normal of the plane through the eye and the line v = v0 + a (u - u0), and its covariance."""
    # y = A x + B in the coordinates of rays.
    A = a * camera.fx_px / camera.fy_px
    B = (v0 + a * (camera.cx_px - u0) - camera.cy_px) / camera.fy_px
    length = math.sqrt(A * A + 1.0 + B * B)
    m = np.array([A, -1.0, B]) / length
    by_a = np.array([camera.fx_px / camera.fy_px, 0.0, (camera.cx_px - u0) / camera.fy_px]) / length
    by_v = np.array([0.0, 0.0, 1.0 / camera.fy_px]) / length
    by_a, by_v = by_a - float(m @ by_a) * m, by_v - float(m @ by_v) * m
    return m, var_a * (by_a[:, None] * by_a) + var_v * (by_v[:, None] * by_v)
