"""Geometry of the tracks: belt outline over three pulleys, and minimum track length.

Paper: Section II.A, Fig. 3(b). "Wheelchair tracks must be in contact with at least two stair edges": L > 2√(h² + w²).
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import Tracks


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


def pulley_centres(tracks: Tracks) -> Float[np.ndarray, "3 2"]:
    """Return the centres (x, z) in B of rear, front and nose pulley."""
    half, radius = 0.5 * tracks.flat_run_m, tracks.pulley_radius_m
    angle = math.radians(tracks.approach_angle_deg)
    nose = (half + tracks.approach_m * math.cos(angle), radius + tracks.approach_m * math.sin(angle))
    return np.array([(-half, radius), (half, radius), nose])


def outline(tracks: Tracks, points_per_arc: int = 24) -> Float[np.ndarray, "n 2"]:
    """Return the closed outline of the belt (x, z) in B, anticlockwise from the rear end of the flat run.

    The belt wraps three equal pulleys: straight between tangent points, an arc around each pulley.
    """
    centres, radius = pulley_centres(tracks), tracks.pulley_radius_m
    points: list[tuple[float, float]] = []
    for i in range(3):
        before, here, after = centres[i - 1], centres[i], centres[(i + 1) % 3]
        # Outward normals of the straight parts before and after this pulley, for an anticlockwise path.
        start = _normal_angle(before, here)
        end = _normal_angle(here, after)
        turn = (end - start) % (2.0 * math.pi)
        for k in range(points_per_arc):
            angle = start + turn * k / (points_per_arc - 1)
            points.append((here[0] + radius * math.cos(angle), here[1] + radius * math.sin(angle)))
    return np.array(points)


def belt_length(tracks: Tracks) -> float:
    """Return the belt length [m]: the triangle of the pulley centres plus one full turn around a pulley."""
    centres = pulley_centres(tracks)
    sides = np.linalg.norm(centres - np.roll(centres, -1, axis=0), axis=1)
    return float(sides.sum()) + 2.0 * math.pi * tracks.pulley_radius_m


def _normal_angle(start: Float[np.ndarray, " 2"], end: Float[np.ndarray, " 2"]) -> float:
    along = end - start
    return math.atan2(-along[0], along[1])
