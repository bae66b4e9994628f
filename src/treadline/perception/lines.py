"""Nosings as lines: where a tread or riser ends in the image and what lies behind is further away.

A line in the image and the camera's centre span a plane that holds the edge itself, so its normal m says m·e = 0, as the
normal of a tread does. No depth along the edge is needed, where depth is at its worst.
"""

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
    count, is_corner, normal, covariance, points, ends_px = kernels.nosing_line(
        ends.columns,
        ends.rows,
        ends.follows,
        surface.normal,
        NEAR_AT_240 * camera.height_px / 240,
        LEAST_SHARE * camera.width_px,
        BEYOND_SHARE,
        ALIASING_PX,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
    )
    if not count:
        return None
    return Line(
        normal=normal,
        covariance=covariance,
        middle=points[0],
        ends_m=points[1:],
        ends_px=ends_px,
        is_corner=is_corner,
        count=count,
    )
