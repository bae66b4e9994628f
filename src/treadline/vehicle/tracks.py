"""Tracks: pulleys, road wheels, length on the nosings, minimum track length.

Paper: Section II.A, Fig. 3(b). "Wheelchair tracks must be in contact with at least two stair edges": L > 2√(h² + w²).
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription, Tracks


def minimum_track_length(rise_m: float, run_m: float) -> float:
    """Return 2√(h² + w²) [m], the lower bound of the track length L on the stair.

    Paper: Section II.A, the inequality L > 2√(h² + w²). A track of one nosing pitch touches at least one nosing, a track of two
    pitches at least two at every phase.
    """
    return 2.0 * math.hypot(rise_m, run_m)


def nosings_touched(length_m: float, pitch_m: float, phase_m: float) -> int:
    """Return the number of nosings under a straight track.

    Args:
        phase_m: Distance from the track's rear end to the first nosing ahead.
    """
    if not 0.0 <= phase_m <= pitch_m:
        raise MechanicsError(f"a phase of {phase_m} m lies outside one pitch of {pitch_m} m")
    return math.floor((length_m - phase_m) / pitch_m) + 1 if phase_m <= length_m else 0


def pulley_centres(chair: ChairDescription) -> Float[np.ndarray, "3 2"]:
    """Return the centres (x, z) in B of rear, front and nose pulley."""
    half, radius = 0.5 * chair.tracks.flat_run_m, chair.tracks.pulley_radius_m
    return np.array([(-half, radius), (half, radius), chair.nose_m[::2]])


def road_wheels(tracks: Tracks) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the places of a belt's road wheels along B's x axis [m], and their stiffnesses relative to a pulley's.

    The stiffnesses are the weights of the trapezoid rule: a rigid flat run on n wheels carries like an even elastic bed. Equal
    stiffnesses load the ends too much, so that the chair turns too slowly. All wheels of a belt are as stiff as two pulleys.
    """
    half_m = 0.5 * tracks.flat_run_m
    stiffness = np.full(tracks.road_wheels, 2.0 / (tracks.road_wheels - 1))
    stiffness[[0, -1]] *= 0.5
    return np.linspace(-half_m, half_m, tracks.road_wheels), stiffness


def track_on_stair_m(chair: ChairDescription) -> float:
    """Return the length of the track in the nosing plane [m]: the flat run, and the section in line with it.

    A flipper always reaches that angle (its range includes 0°); a fixed section does only if it is built at 0°.
    """
    tracks = chair.tracks
    is_in_line = chair.flipper is not None or tracks.approach_angle_deg == 0.0
    return tracks.flat_run_m + (tracks.approach_m if is_in_line else 0.0)
