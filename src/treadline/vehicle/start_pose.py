"""Start pose of a chair on floor, flight or landing: ``Staircase, Tracks, Start -> Standing``."""

import math
from dataclasses import dataclass

import numpy as np

from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.chair import Tracks
from treadline.scenario.scenario import Start
from treadline.scenario.stair import Stair
from treadline.vehicle.staircase import Staircase, Step

CLEARANCE_M = 0.001
"""Initial gap between a chair and its support [m]."""
FLOOR_START_M, LANDING_START_M, LANDING_SPARE_M = 1.0, 0.6, 0.1
"""Initial distance of the nearer pulley from the first nosing (floor) and from the edge (landing), and free length of a short
landing behind the chair [m]."""
LANDING_LEAST_M = 0.2
"""Least initial distance of the pulley from the edge of a short landing, and from a sill [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Standing:
    """Start pose of a chair."""

    p_WB: Vector3
    R_WB: Rotation
    seat_rad: float
    """Angle of the seat relative to the chassis [rad]: level, or parallel."""


def from_edge_m(landing: Staircase | Stair, tracks: Tracks) -> float:
    """Return the distance of the rear pulley behind the edge for a start on a landing [m]."""
    return min(max(landing.landing_m - length_m(landing, tracks) - LANDING_SPARE_M, LANDING_LEAST_M), LANDING_START_M)


def length_m(landing: Staircase | Stair, tracks: Tracks) -> float:
    """Return the length that a chair takes on a landing [m]: its belts, and its raised flipper where a wall is at the end."""
    flipper_m = tracks.approach_m * math.cos(math.radians(tracks.approach_angle_deg)) + tracks.pulley_radius_m
    return tracks.flat_run_m + (flipper_m if landing.end_wall else 0.0)


def standing(staircase: Staircase, tracks: Tracks, start: Start) -> Standing:
    """Return the start pose of a scenario, slightly above the support, behind the sills of its floor or landing.

    On the landing, heading and lateral position are relative to the last flight.
    """
    heading, top = math.radians(start.heading_deg), staircase.steps[-1]
    slope = {"floor": 0.0, "landing": top.tread_slope_rad, "flight": staircase.slope_rad}[start.place]
    along, flight = 0.5 * tracks.flat_run_m * math.cos(heading), 0
    R_WB = rotation_y(-slope) @ rotation_z(heading)
    if start.place == "floor":
        sills_m, level_m = staircase.ground_behind(None)
        p_WB = np.array([-along - max(FLOOR_START_M, sills_m + LANDING_LEAST_M), start.lateral_m, CLEARANCE_M + level_m])
    elif start.place == "landing":
        sills_m, level_m = staircase.ground_behind(top.index)
        behind_m = along + max(from_edge_m(staircase, tracks), sills_m + LANDING_LEAST_M)
        p_WB = np.array([top.x_m + behind_m, start.lateral_m, top.z_m + level_m + CLEARANCE_M + behind_m * math.tan(slope)])
        flight = len(staircase.plans) - 1
    else:
        step = staircase.steps[start.step]
        flight = next(k for k, steps in enumerate(staircase.flights) if step in steps)
        lifted_m = CLEARANCE_M - rounded_off_m(step.nosing_radius_m, slope) + _above_plane_m(staircase, step, tracks.flat_run_m)
        from_nosing = staircase.R_WS @ np.array([-along, start.lateral_m, lifted_m])
        p_WB = step.nosing_F + from_nosing
    if flight:
        R_WF, p_WF = staircase.flight_frame(flight)
        p_WB, R_WB = p_WF + R_WF @ p_WB, R_WF @ R_WB
    return Standing(p_WB=p_WB, R_WB=R_WB, seat_rad=slope if start.seat == "level" else 0.0)


def rounded_off_m(nosing_radius_m: float, slope_rad: float) -> float:
    """Return the distance from the plane of the sharp edges down to the plane tangent to the rounded nosings [m]."""
    return nosing_radius_m * (math.sin(slope_rad) + math.cos(slope_rad) - 1.0)


def _above_plane_m(staircase: Staircase, front: Step, flat_run_m: float) -> float:
    """Return the height of the highest nosing under the belts above the plane through the front nosing [m]."""
    c, s = math.cos(staircase.slope_rad), math.sin(staircase.slope_rad)
    offsets = [
        (step.z_m - front.z_m) * c - (step.x_m - front.x_m) * s
        for step in next(steps for steps in staircase.flights if front in steps)
        if step.index <= front.index and not step.missing and (front.x_m - step.x_m) * c <= flat_run_m
    ]
    highest_m = max(offsets, default=0.0)
    return highest_m if highest_m > CLEARANCE_M else 0.0
