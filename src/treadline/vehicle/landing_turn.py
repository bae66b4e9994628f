"""Turn on a landing: whether a chair finds room to turn from one flight to the next, its way, and the least landing.

``FlightPlan, Outline -> poses, metres``. The belts stand on the landing; the rear may reach over the flight below; nothing else may
pass a side, the wall or drop there, or the next flight's foot.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import Vector3
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle import landing_turn_kernels as kernels
from treadline.vehicle.bodies import flipper_turns, vehicle
from treadline.vehicle.staircase import FlightPlan
from treadline.vehicle.start_checks import placed_parts
from treadline.vehicle.start_pose import Standing

CLEAR_M = 0.05
"""Distance of the outline from walls and edges that are seen [m]."""
OFF_PLAN_M = 0.04
"""Largest distance of the chair from its plan in a turn [m]: a landing has room for it."""
WITHIN_M = 0.002
"""Resolution of the least landing [m]."""
MOST_M = 3.0
"""Side of the largest landing that is searched [m]: on more than twice its length every chair turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """Rectangles in plan that hold a chair and its belts, in B."""

    rear_m: float
    front_m: float
    half_m: float
    """Distances from mid-track to the rear, the front and a side of the chair [m]."""
    half_run_m: float
    half_belts_m: float
    """Distances to the ends and the sides of the belts' flat runs [m]."""

    def wider(self, by_m: float) -> "Outline":
        """Return the outline with a distance around it [m]."""
        return Outline(**{name: getattr(self, name) + by_m for name in self.__slots__})

    @property
    def numbers(self) -> Float[np.ndarray, " 5"]:
        """Numbers of the compiled search."""
        return np.array([self.rear_m, self.front_m, self.half_m, self.half_run_m, self.half_belts_m])


def outline_of(chair: ChairDescription, flipper_rad: float | None = None) -> Outline:
    """Return the outline of a chair on level ground.

    Args:
        flipper_rad: Angle of the flipper above the belts; None: as far up as it turns.
    """
    if flipper_rad is None and chair.flipper is not None:
        flipper_rad = math.radians(chair.flipper.range_deg[1])
    level = Standing(p_WB=np.zeros(3), R_WB=np.eye(3), seat_rad=0.0)
    parts = placed_parts(vehicle(chair, Chair()), level, flipper_turns(chair, flipper_rad))
    ways = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rear_m, front_m, half_m = np.max([ways @ part.centre_W + part.reach(ways) for part in parts], axis=0).tolist()
    tracks = chair.tracks
    return Outline(
        rear_m=rear_m,
        front_m=front_m,
        half_m=half_m,
        half_run_m=0.5 * tracks.flat_run_m,
        half_belts_m=0.5 * (tracks.gauge_m + tracks.belt_width_m),
    )


def way_over(plan: FlightPlan, width_m: float, outline: Outline, start: Vector3 | None = None) -> Float[np.ndarray, "n 3"]:
    """Return the poses of the shortest way over a landing to the next flight, a drive or a turn apart; empty if there is none.

    Columns: place from the landing's nosing, in F [m], and heading [rad].

    Args:
        width_m: Width of both flights.
        outline: Outline of the chair, with its distance from walls and edges.
        start: Pose from which it turns; unset: as the belts have come on the landing, in the middle of the flight.
    """
    x, y = plan.foot(width_m).mean(axis=0) * (1.0, plan.side)
    sides = (plan.right_m, plan.left_m) if plan.side > 0.0 else (-plan.left_m, -plan.right_m)
    landing = np.array([plan.depth_m, *sides, 0.5 * width_m, abs(plan.turn_rad), x, y])
    mirrored = np.array([1.0, plan.side, plan.side])
    pose = np.array([outline.half_run_m, 0.0, 0.0]) if start is None else start * mirrored
    lane_m = max(0.5 * width_m - outline.half_m, kernels.CELL_M)
    return np.asarray(kernels.search(landing, outline.numbers, pose, lane_m) * mirrored)


def least_landing_m(plan: FlightPlan, width_m: float, outline: Outline) -> float:
    """Return the least side of a landing on which a chair turns [m]: its depth, and its width where that is less."""

    def turns(side_m: float) -> bool:
        wider_m = max(side_m - (plan.left_m - plan.right_m), 0.0) * plan.side
        sides = (plan.right_m + min(wider_m, 0.0), plan.left_m + max(wider_m, 0.0))
        larger = replace(plan, depth_m=side_m, right_m=sides[0], left_m=sides[1])
        return len(way_over(larger, width_m, outline)) > 0

    low_m, high_m = width_m * abs(math.sin(plan.turn_rad)), MOST_M
    while high_m - low_m > WITHIN_M:
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (low_m, middle_m) if turns(middle_m) else (middle_m, high_m)
    return high_m
