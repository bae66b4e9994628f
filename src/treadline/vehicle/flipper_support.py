"""Flippers as a part of the track on a flight: length on the nosings, and front end of the support polygon.

A flipper lies in line with the flat run, so its belt touches the same nosing plane. Its motor limits the load on its nosings.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import ChairDescription

PHASES = 400
"""Number of intervals of one nosing cycle in the search for its worst phase. Its usual phases are exact: the foremost nosing
has just left the track, or a nosing lies at the flipper's axis or √(pitch · torque / weight) ahead of it."""
ROUNDING_M = 1e-9


def in_line_m(chair: ChairDescription) -> float:
    """Return the length of the approach section that lies in the plane of the flat run [m].

    A flipper always reaches that angle (its range includes 0°); a fixed section does only if it is built at 0°.
    """
    tracks = chair.tracks
    return tracks.approach_m if chair.flipper is not None or tracks.approach_angle_deg == 0.0 else 0.0


def track_on_stair_m(chair: ChairDescription) -> float:
    """Return the length of the track in the nosing plane [m]: the flat run, and the section in line with it."""
    return chair.tracks.flat_run_m + in_line_m(chair)


def front_support_m(chair: ChairDescription, pitch_m: float, weight_n: float) -> float:
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
    foremost_m = half_m + section_m - pitch_m * np.linspace(0.0, 1.0, PHASES + 1)
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
        carries = (lever <= full_load_lever_m) & (place >= -half_m - ROUNDING_M)
        edges_m = np.where(carries, np.maximum(edges_m, place), edges_m)
        for further in range(near):
            apart = np.maximum(levers[further] - lever, ROUNDING_M)
            share = np.minimum(1.0, (full_load_lever_m - lever) / apart)
            edges_m = np.where(carries, np.maximum(edges_m, place + share * (places[further] - place)), edges_m)
    return edges_m
