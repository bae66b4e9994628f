"""Static tip-over margins: the angle by which gravity can rotate before the chair tips over an edge of its support polygon.

Where the chair stands, and with it the edges to front and rear, follows from its rest pose (``rest_poses``) or, of a recorded run,
from the ground truth; sideways the chair stands on its belts' outer edges.
"""

import math
from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.scenario.chair import Point, Tracks
from treadline.vehicle.rest_pose_kernels import SUPPORT_RAD

MARGIN_LIMIT_RAD = 7.0 * DEG
"""Least accepted tip-over margin [rad]: the value of ISO 7176-24; conformity with the standard is not claimed."""
UNKNOWN_RAD = 5.0 * DEG
"""Reserve of the tip-over margin for quantities that are not measured [rad]: a passenger 5 cm further back than assumed costs four
degrees. What is left of the limit with it must remain on the whole way."""
ROCKING = math.tan(SUPPORT_RAD)
"""Largest gap between the chair and ground over the distance of that ground from the contact about which the chair turns, for the
ground to count as support: as of a rest pose (``rest_pose_kernels.SUPPORT_RAD``)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Tip-over margins [rad]; negative after tipping."""

    uphill: float
    downhill: float
    left: float
    right: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Support:
    """Support polygon as distances from B's origin [m], in B."""

    front_m: float
    rear_m: float
    """Distance to the rear edge, positive to the rear [m]."""
    left_m: float
    right_m: float
    """Distance to the right edge, positive to the right [m]."""


def sideways_margins(tracks: Tracks, com_B: Point, up_B: Point) -> tuple[float, float]:
    """Return the margins to the left and to the right of a chair on its belts [rad]; arguments as of ``tipping_margins``."""
    half_m = 0.5 * (tracks.gauge_m + tracks.belt_width_m)
    margins = tipping_margins(com_B, up_B, Support(front_m=math.inf, rear_m=math.inf, left_m=half_m, right_m=half_m))
    return margins.left, margins.right


def tipping_margins(com_B: Point, up_B: Point, support: Support) -> Margins:
    """Return the angles by which gravity can rotate before the chair tips over each edge of its support [rad].

    Args:
        com_B: Centre of mass in B [m].
        up_B: Unit vector against gravity, in B.
    """
    x, y, z = com_B
    ux, uy, uz = up_B
    lengthwise, sidewise = math.atan2(ux, uz), math.atan2(uy, uz)
    return Margins(
        # Nose up (ux > 0) leans the plumb line to the rear.
        uphill=math.atan2(support.front_m - x, z) + lengthwise,
        downhill=math.atan2(support.rear_m + x, z) - lengthwise,
        left=math.atan2(support.left_m - y, z) + sidewise,
        right=math.atan2(support.right_m + y, z) - sidewise,
    )
