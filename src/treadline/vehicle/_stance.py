"""Contact points of the belts on a flight or a floor, and the normal force at each contact.

``chair, loading, slope, heading -> Stance``. All quantities are in B, in the plane of the belts' underside: x forward, y left,
origin mid-track.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription, Tracks
from treadline.scenario.scenario import Chair
from treadline.vehicle.static_stability import centre_of_mass

PHASES = 200
"""Number of nosing phases in an average. The yaw rate jumps when a nosing enters or leaves the belts: 1 % error with 200, 12 % with
20."""
HEADING_LIMIT_RAD = math.radians(80.0)
"""Largest heading of a stance on nosings [rad]: beyond it a belt lies along a nosing or between two."""
LOAD_STEPS = 100
"""Limit of the Newton steps for the loads; none is needed if all contacts carry."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stance:
    """Contact points of both belts and their loads, one row per nosing phase, padded with points without load."""

    x_m: Float[np.ndarray, "p n"]
    y_m: Float[np.ndarray, "p n"]
    load: Float[np.ndarray, "p n"]
    """Share of each contact in the normal force; each row sums to 1."""
    wrench: Float[np.ndarray, " 3"]
    """Gravity along the plane divided by the normal force: forward, left [-], and moment about B's origin [m]."""
    uphill: Float[np.ndarray, " 2"]
    """Unit vector up the slope."""

    @property
    def on_left(self) -> Bool[np.ndarray, "p n"]:
        """Whether each contact belongs to the left belt."""
        return self.y_m > 0.0


def nosing_contacts(tracks: Tracks, pitch_m: float, heading_rad: float, phase: float) -> Float[np.ndarray, "n 2"]:
    """Return the intersections of the two edges of each belt with the nosing lines within the flat run.

    Args:
        phase: Distance of a nosing ahead of B's origin, up the slope, in pitches.

    Raises:
        MechanicsError: If the pitch is not positive, or the belts are parallel to the nosings.
    """
    if not pitch_m > 0.0:
        raise MechanicsError(f"nosings {pitch_m:g} m apart; their pitch √(rise² + run²) must be positive")
    if not abs(heading_rad) <= HEADING_LIMIT_RAD:
        raise MechanicsError(
            f"heading {math.degrees(heading_rad):.1f}°; up to ±{math.degrees(HEADING_LIMIT_RAD):.0f}° belts cross the nosings"
        )
    half_m, c, s = 0.5 * tracks.flat_run_m, math.cos(heading_rad), math.sin(heading_rad)
    edges_m = _edges(tracks)
    reach = math.ceil((half_m * c + edges_m.max() * abs(s)) / pitch_m) + 1
    lines_m = (np.arange(-reach, reach + 1) + phase) * pitch_m
    # Points (x, y) of the line at distance d up the slope: x cos ψ - y sin ψ = d.
    x = (lines_m[None, :] + edges_m[:, None] * s) / c
    points = np.stack([x, np.broadcast_to(edges_m[:, None], x.shape)], axis=-1)
    return points[np.abs(x) <= half_m]


def floor_contacts(tracks: Tracks) -> Float[np.ndarray, "8 2"]:
    """Return the corners of both belts' flat runs.

    A rigid flat run on a flat floor is statically indeterminate. The plant's box on a box carries at its corners; a uniform load
    along the edges would give 1.6 times the yaw rate at ±0.1 m/s (14.2 instead of 8.65 °/s).
    """
    half_m = 0.5 * tracks.flat_run_m
    return np.array([(x, y) for y in _edges(tracks) for x in (-half_m, half_m)])


def contact_loads(points: Float[np.ndarray, "n 2"], centre_m: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " n"]:
    """Return the normal force shares of equal springs under a rigid chair with unilateral contacts.

    The loads are max(0, c0 + c1 x + c2 y), sum to 1 and have their centre at ``centre_m``. They minimise Σ N_i²/2 under these
    conditions; a Newton method on the convex dual in (c0, c1, c2) finds the carrying contacts.

    Raises:
        MechanicsError: If the centre lies outside the contacts' convex hull: the chair tips over.
    """
    rows = np.column_stack([np.ones(len(points)), points])
    wanted = np.array([1.0, *centre_m])
    plane = np.linalg.lstsq(rows.T @ rows, wanted, rcond=None)[0]
    for _ in range(LOAD_STEPS):
        load = np.maximum(rows @ plane, 0.0)
        left = wanted - rows.T @ load
        if np.abs(left).max() < 1e-12:
            return load
        carrying = rows[load > 0.0]
        step = np.linalg.lstsq(carrying.T @ carrying + 1e-12 * np.eye(3), left, rcond=None)[0]
        share, value = 1.0, _dual(rows, wanted, plane)
        while _dual(rows, wanted, plane + share * step) > value - 0.1 * share * float(left @ step) and share > 1e-6:
            share *= 0.5
        plane = plane + share * step
    raise MechanicsError(
        f"the weight passes ({centre_m[0]:.3f}, {centre_m[1]:.3f}) m from mid-track, outside all contacts: the chair tips over"
    )


def stair_stance(
    chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float, heading_rad: float = 0.0, phases: int = PHASES
) -> Stance:
    """Return a chair's contacts on the nosings of a flight, seat level, at evenly spaced nosing phases."""
    return nosing_stance(chair, loading, slope_rad, pitch_m, heading_rad, [(k + 0.5) / phases for k in range(phases)])


def nosing_stance(
    chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float, heading_rad: float, phases: Sequence[float]
) -> Stance:
    """Return a chair's contacts on the nosings of a flight, seat level, at given nosing phases.

    Raises:
        MechanicsError: If the chair tips over in one of them.
    """
    contacts = [nosing_contacts(chair.tracks, pitch_m, heading_rad, phase) for phase in phases]
    return _stance(chair, loading, contacts, slope_rad, heading_rad)


def floor_stance(chair: ChairDescription, loading: Chair, slope_rad: float = 0.0, heading_rad: float = 0.0) -> Stance:
    """Return a chair's contacts on a floor or an even ramp."""
    return _stance(chair, loading, [floor_contacts(chair.tracks)], slope_rad, heading_rad)


def _edges(tracks: Tracks) -> Float[np.ndarray, " 4"]:
    gauge, width = 0.5 * tracks.gauge_m, 0.5 * tracks.belt_width_m
    return np.array([gauge + width, gauge - width, -gauge + width, -gauge - width])


def _stance(
    chair: ChairDescription, loading: Chair, contacts: list[Float[np.ndarray, "_ 2"]], slope_rad: float, heading_rad: float
) -> Stance:
    uphill = np.array([math.cos(heading_rad), -math.sin(heading_rad)])
    pull = -math.tan(slope_rad) * uphill
    seat_rad = math.asin(math.sin(slope_rad) * math.cos(heading_rad))
    com = np.array(centre_of_mass(chair, loading, seat_rad))
    centre = com[:2] + com[2] * pull
    padded = np.zeros((3, len(contacts), max(len(points) for points in contacts)))
    for k, points in enumerate(contacts):
        padded[:2, k, : len(points)] = points.T
        padded[2, k, : len(points)] = contact_loads(points, centre)
    wrench = np.array([pull[0], pull[1], com[0] * pull[1] - com[1] * pull[0]])
    return Stance(x_m=padded[0], y_m=padded[1], load=padded[2], wrench=wrench, uphill=uphill)


def _dual(rows: Float[np.ndarray, "n 3"], wanted: Float[np.ndarray, " 3"], plane: Float[np.ndarray, " 3"]) -> float:
    return float(0.5 * np.square(np.maximum(rows @ plane, 0.0)).sum() - wanted @ plane)
