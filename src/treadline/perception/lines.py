"""Nosings as lines: image lines at the end of a tread or riser with a larger depth behind.

A line in the image and the camera centre span a plane that contains the edge, so its normal m satisfies m·e = 0, like the normal of
a tread. Depth along the edge, where it is least accurate, is not needed.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.perception import kernels
from treadline.perception.surfaces import Ends, Surface
from treadline.signals import PinholeCamera

NEAR_AT_240 = 1.5
"""Largest distance of a point from a line at 240 rows [rows]: depth is ragged at edges."""
ALIASING_PX = 0.15
"""Lower limit of the relative error of a line's ends, for any number of points [px]: rows are integers."""
LEAST_SHARE = 0.08
"""Least length of a line as a fraction of the image width."""
BEYOND_SHARE = 0.5
"""Least fraction of a surface's end with a larger depth behind; otherwise it is a corner, or occluded."""


LineKind = Literal["edge", "corner", "vague"]
"""Kind of a line by what is measured past it."""
End = Literal["upper", "lower"]
"""End of a surface in the image."""
_KINDS: dict[int, LineKind] = {kernels.BEYOND: "edge", kernels.CREASE: "corner", kernels.UNKNOWN: "vague"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Image line of one nosing."""

    normal: Float[np.ndarray, " 3"]
    """Unit normal m of the plane through the line and the camera centre, in C."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of m, from the scatter of the points about the line."""
    middle: Float[np.ndarray, " 3"]
    """Middle of the line on its surface, in C [m]."""
    ends_m: Float[np.ndarray, "2 3"]
    """Ends of the line on its surface, left end first, in C [m]."""
    ends_px: Float[np.ndarray, " 4"]
    """Ends of the line u1, v1, u2, v2, left end first [px]."""
    kind: LineKind
    """Surroundings of the line: a larger depth (``edge``), an adjacent surface (``corner``), or nothing known (``vague``)."""
    count: int
    """Number of columns."""
    end: End
    """End of the surface in the image."""


def nosing_line(surface: Surface, end: End, camera: PinholeCamera) -> Line | None:
    """Return the line at the end of a surface, or None; the image border and objects in front give no line.

    A corner belongs to a riser too low in the image to be a separate surface. The end of the surface has a constant offset along a
    corner, so that the direction of the line is correct.
    """
    ends: Ends = surface.upper if end == "upper" else surface.lower
    count, kind, normal, covariance, points, ends_px = kernels.nosing_line(
        ends.columns,
        ends.rows,
        ends.follows,
        surface.normal,
        camera.height_px,
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
        kind=_KINDS[kind],
        count=count,
        end=end,
    )
