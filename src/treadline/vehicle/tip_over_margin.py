"""Tip-over margins: the angle by which gravity can rotate before the chair tips over an edge of its support polygon.

The chair stands on nosings, and the set of nosings changes during a climb. At the worst phase of this cycle the rearmost nosing is
nearly one pitch ahead of the track's rear end, and the foremost one pitch behind its front end: the support is shorter than the
track by a pitch at either end. A flipper in line with the belts lengthens the track at its front, as far as its motor carries.
"""

import math
from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.scenario.chair import ChairDescription, Point
from treadline.vehicle.flipper_support import front_support_m

MARGIN_LIMIT_RAD = 7.0 * DEG
"""Least accepted tip-over margin [rad]: the value of ISO 7176-24; conformity with the standard is not claimed."""


ROCKING_M = 0.015
"""Largest gap between a nosing and the belts for the nosing to count as support [m]: the chair tips onto it within 1.5°."""
TIP_GAP_M = 0.010
"""Largest gap between the front tip and the ground for the tip to count as support [m]: the tip is 0.4 m ahead of the front pulley,
so the chair tips onto it within 1.5°, as for ``ROCKING_M``. The capacity of the flipper motor is not considered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Tip-over margins [rad]; negative after tipping."""

    uphill: float
    downhill: float
    left: float
    right: float

    @property
    def worst(self) -> float:
        """Smallest of the four margins [rad]."""
        return min(self.uphill, self.downhill, self.left, self.right)


@dataclass(frozen=True, slots=True, kw_only=True)
class Support:
    """Support polygon as distances from B's origin [m], in B."""

    front_m: float
    rear_m: float
    """Distance to the rear edge, positive to the rear [m]."""
    left_m: float
    right_m: float
    """Distance to the right edge, positive to the right [m]."""


def worst_support(chair: ChairDescription, pitch_m: float, weight_n: float | None = None) -> Support:
    """Return the support polygon available at every phase of the nosing cycle.

    Args:
        pitch_m: Largest distance between neighbouring nosings [m].
        weight_n: Weight of chair and payload [N], which the flipper's motor has to carry; None while the flipper is lifted.
    """
    tracks = chair.tracks
    half_length_m = 0.5 * tracks.flat_run_m - pitch_m
    half_width_m = 0.5 * (tracks.gauge_m + tracks.belt_width_m)
    front_m = half_length_m if weight_n is None else front_support_m(chair, pitch_m, weight_n)
    return Support(front_m=front_m, rear_m=half_length_m, left_m=half_width_m, right_m=half_width_m)


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
