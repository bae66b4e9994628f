"""Turn on a landing: whether a chair finds room to turn from one flight to the next, its way, and the least landing.

``FlightPlan, Outline -> poses, metres``. The belts stand on the landing; the rear may reach over the flight below; nothing else may
pass a side, the wall or drop there, or the next flight's foot.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import Vector3
from treadline.core.step_sizes import OBSTACLE_CLEAR_M
from treadline.vehicle import landing_turn_kernels as kernels
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.landing_turn_kernels import Landing, Outline

OFF_PLAN_M = 0.04
"""Largest distance of the chair from its plan in a turn [m]: a landing has room for it."""
WITHIN_M = 0.002
"""Resolution of the least landing [m]."""
NEAR_M = 0.16
"""Largest distance of the pose from which a way is searched from that of the chair [m]:
two deviations of its place aside, or a chair whose belts have just come on the landing, by its distance from edges."""
PORTION = 1000
"""Number of cells from which a search goes on in a portion [-]: 1 to 1.5 ms in the median; the first, which touches most of the
memory, has taken up to 50 ms."""
MOST_M = 3.0
"""Side of the largest landing that is searched [m]: on more than twice its length every chair turns."""


def way_over(
    plan: FlightPlan, width_m: float, outline: Outline, near: Vector3 | None = None, *, off_m: float | None = None
) -> Float[np.ndarray, "n 3"]:
    """Return the poses of the quickest way over a landing to the next flight, a drive or a turn apart; empty if there is none.

    Columns and arguments as of ``ways_over``.
    """
    return [way for way in ways_over(plan, width_m, outline, near, off_m=off_m) if way is not None][-1]


def ways_over(
    plan: FlightPlan, width_m: float, outline: Outline, near: Vector3 | None = None, *, off_m: float | None = None
) -> Iterator[Float[np.ndarray, "n 3"] | None]:
    """Search the quickest way over a landing to the next flight by portions; yield None until it ends, then the way.

    Its columns: place of the point from which the outline counts, from the landing's nosing, in F [m], and heading [rad].

    Args:
        plan: The landing and the flight above.
        width_m: Width of both flights.
        outline: Outline of the chair, with its distance from walls and edges.
        near: Pose of the chair, near which the way begins where it has room; unset: as the chair has come on the landing, in the
            middle of the flight that it has left.
        off_m: Distance from the foot of the flight above at which a chair that goes down has left it; None: the chair goes up.
    """
    landing, mirrored = landing_of(plan, width_m)
    foot, first = np.array([landing.foot_x, landing.foot_y, landing.turn]), np.array([outline.belts_rear_m, 0.0, 0.0])
    start, goal, before_m = first, foot, 0.0
    if off_m is not None:
        start = foot - off_m * np.array([math.cos(foot[2]), math.sin(foot[2]), 0.0])
        # The guard holds a chair that enters no flight yet at this distance from the edge.
        goal, before_m = np.zeros(3), outline.belts_rear_m + OBSTACLE_CLEAR_M
    start = start if near is None else _free_start(landing, outline, near * mirrored)
    lane_m = max(0.5 * width_m - outline.half_m, kernels.CELL_M)
    way, is_there = np.empty((0, 3)), kernels.is_free(landing, outline, *start)
    reached, queue = kernels.reached_from(landing, start)
    while is_there and len(queue):
        way, queue = kernels.search(landing, outline, reached, queue, goal, lane_m, before_m, PORTION)
        if len(queue):
            yield None
    yield np.asarray(way * mirrored)


def has_room(plan: FlightPlan, width_m: float, outline: Outline, way: Float[np.ndarray, "n 3"]) -> bool:
    """Return whether a chair has room at each pose of a way."""
    landing, mirrored = landing_of(plan, width_m)
    return all(kernels.is_free(landing, outline, *pose) for pose in way * mirrored)


def _free_start(landing: Landing, outline: Outline, pose: Vector3) -> Vector3:
    """Return the nearest pose that is free, at a heading of the search; the pose itself if none is near."""
    x, y, heading = pose
    step = landing.turn / round(landing.turn / kernels.HEADING_RAD)
    heading = step * round(heading / step)
    moves_m = np.arange(-NEAR_M, NEAR_M + 0.5 * kernels.CELL_M, kernels.CELL_M)
    for along_m, aside_m in sorted(((a, b) for a in moves_m for b in moves_m), key=lambda move: math.hypot(*move)):
        if kernels.is_free(landing, outline, x + along_m, y + aside_m, heading):
            return np.array([x + along_m, y + aside_m, heading])
    return pose


def landing_of(plan: FlightPlan, width_m: float) -> tuple[Landing, Vector3]:
    """Return a landing as one on which the stair turns to the left, and the signs that mirror a pose to it."""
    foot = plan.foot(width_m).mean(axis=0) * (1.0, plan.side)
    sides = (plan.right_m, plan.left_m) if plan.side > 0.0 else (-plan.left_m, -plan.right_m)
    (x, y), (right_m, left_m) = foot.tolist(), sides
    landing = Landing(plan.depth_m, right_m, left_m, 0.5 * width_m, x, y, abs(plan.turn_rad))
    return landing, np.array([1.0, plan.side, plan.side])


def least_landing_m(plan: FlightPlan, width_m: float, outline: Outline, off_m: float | None = None) -> float:
    """Return the least side of a landing on which a chair turns [m]: its depth, and its width where that is less.

    Arguments as of ``way_over``.
    """

    def turns(side_m: float) -> bool:
        wider_m = max(side_m - (plan.left_m - plan.right_m), 0.0) * plan.side
        sides = (plan.right_m + min(wider_m, 0.0), plan.left_m + max(wider_m, 0.0))
        larger = replace(plan, depth_m=side_m, right_m=sides[0], left_m=sides[1])
        return len(way_over(larger, width_m, outline, off_m=off_m)) > 0

    low_m, high_m = width_m * abs(math.sin(plan.turn_rad)), MOST_M
    while high_m - low_m > WITHIN_M:
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (low_m, middle_m) if turns(middle_m) else (middle_m, high_m)
    return high_m
