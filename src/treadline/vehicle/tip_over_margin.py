"""Static tip-over margins: the angle by which gravity can rotate before the chair tips over an edge of its support polygon.

The chair stands on nosings, and the set of nosings changes during a climb. At the worst phase of this cycle the rearmost nosing is
nearly one pitch ahead of the track's rear end, and the foremost one pitch behind its front end: the support is shorter than the
track by a pitch at either end. A flipper lies in line with the flat run, so its belt touches the same nosing plane and lengthens
the track at its front, as far as its motor carries.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.scenario.chair import ChairDescription, Point
from treadline.vehicle.tracks import in_line_m

MARGIN_LIMIT_RAD = 7.0 * DEG
"""Least accepted tip-over margin [rad]: the value of ISO 7176-24; conformity with the standard is not claimed."""
ROCKING_M = 0.015
"""Largest gap between a nosing and the belts for the nosing to count as support [m]: the chair tips onto it within 1.5°."""
TIP_GAP_M = 0.010
"""Largest gap between the front tip and the ground for the tip to count as support [m]: the tip is 0.4 m ahead of the front pulley,
so the chair tips onto it within 1.5°, as for ``ROCKING_M``. The capacity of the flipper motor is not considered."""
FLIPPER_PHASES = 400
"""Number of intervals of one nosing cycle in the search for its worst phase. Its usual phases are exact: the foremost nosing
has just left the track, or a nosing lies at the flipper's axis or √(pitch · torque / weight) ahead of it."""
NEAR_M = 1e-9
"""Rounding of positions along the track [m]."""


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
    front_m = half_length_m if weight_n is None else _front_support_m(chair, pitch_m, weight_n)
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


def _front_support_m(chair: ChairDescription, pitch_m: float, weight_n: float) -> float:
    """Return the distance from mid-track to the front edge of the support that holds at every phase of the nosing cycle [m].

    The flat run carries any load; nosings under the flipper, x ahead of its axis, carry loads N with Σ N x ≤ torque. The edge is
    the furthest centre of pressure under this limit: with the last nosing under the flat run at r and one under the flipper at f,
    it is r + (f - r) · torque / (x · weight), at most f.

    Args:
        pitch_m: Largest distance between neighbouring nosings [m].
        weight_n: Weight of chair and payload [N]; the normal force never exceeds it.
    """
    half_m = 0.5 * chair.tracks.flat_run_m
    section_m = in_line_m(chair)
    if section_m == 0.0:
        return half_m - pitch_m
    full_load_lever_m = math.inf if chair.flipper is None else chair.flipper.torque_n_m / weight_n
    foremost_m = half_m + section_m - pitch_m * np.linspace(0.0, 1.0, FLIPPER_PHASES + 1)
    # One nosing at d ahead of the axis supports up to d - pitch + pitch · lever / d; this is smallest at d² = pitch · lever.
    exact_m = [ahead for ahead in (0.0, math.sqrt(pitch_m * full_load_lever_m)) if ahead <= section_m]
    exact_m = [half_m + ahead + pitch_m * math.floor((section_m - ahead) / pitch_m) for ahead in exact_m]
    foremost_m = np.append(foremost_m, exact_m)
    return float(_front_edges_m(foremost_m, half_m, section_m, pitch_m, full_load_lever_m).min())


def _front_edges_m(
    foremost_m: Float[np.ndarray, " n"], half_m: float, section_m: float, pitch_m: float, full_load_lever_m: float
) -> Float[np.ndarray, " n"]:
    """Return the front edge of the support at each phase [m].

    The optimum of a linear programme with two constraints (weight, torque) loads at most two nosings.

    Args:
        foremost_m: Position of the foremost nosing under the track, one per phase.
        full_load_lever_m: Motor torque divided by the weight: the distance from its axis at which a flipper carries the chair.
    """
    # The foremost nosings, down to one that is under the flat run at each phase or behind it.
    places = [foremost_m - pitch_m * k for k in range(math.ceil(section_m / pitch_m) + 2)]
    levers = [np.maximum(place - half_m, 0.0) for place in places]
    # Without a nosing under the flat run the chair stands on its flipper alone, and tips back onto the rear end.
    edges_m = np.full(len(foremost_m), -half_m)
    for near, (place, lever) in enumerate(zip(places, levers, strict=True)):
        carries = (lever <= full_load_lever_m) & (place >= -half_m - NEAR_M)
        edges_m = np.where(carries, np.maximum(edges_m, place), edges_m)
        for further in range(near):
            apart = np.maximum(levers[further] - lever, NEAR_M)
            share = np.minimum(1.0, (full_load_lever_m - lever) / apart)
            edges_m = np.where(carries, np.maximum(edges_m, place + share * (places[further] - place)), edges_m)
    return edges_m
