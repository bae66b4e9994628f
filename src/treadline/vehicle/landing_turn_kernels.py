"""Compiled search of ``landing_turn``: the quickest drives and turns on a landing, A* over cells of place and heading.

Each cell keeps the exact pose in which it was reached soonest (as hybrid A*, Dolgov et al., 2008), so that drives are straight. The
search knows turns to the left; places are in the frame of the flight below, from its landing's nosing.
"""

import heapq
import math
from typing import Any, NamedTuple

import numpy as np

from treadline.core.kernel_cache import njit

CELL_M, HEADING_RAD = 0.01, math.radians(3.0)
"""Size of a cell: between two headings the corner of a chair of 1.5 m moves 0.3 mm further out than at either."""
DRIVE_M = 3.0 * CELL_M
"""Length of one drive [m]: it leaves its cell in every direction."""
DRIVE_COST, TURN_COST, REVERSAL_COST = 3, 2, 7
"""Times of a drive and of a turn at 0.1 m/s and 15 °/s, and of a reversal of either, a stop and a start with a time constant of
0.33 s each [0.1 s]. The chair drives and turns at the same time: a turn that follows a drive takes none."""
BEYOND = 10
"""Number of headings before the first and beyond the last [-]: a chair shifts aside by turning back and forth by 30°."""


class Landing(NamedTuple):
    """Landing on which the stair turns to the left [m, rad]."""

    depth: float
    right: float
    left: float
    """Places of its sides."""
    half_flight: float
    """Half width of the flights."""
    foot_x: float
    foot_y: float
    """Middle of the next flight's foot."""
    turn: float


class Outline(NamedTuple):
    """Rectangles in plan that hold a chair and its belts, in B."""

    rear_m: float
    front_m: float
    half_m: float
    """Distances from the centre of turns, mid-track, to the rear, the front and a side of the chair [m]."""
    belts_rear_m: float
    belts_front_m: float
    half_belts_m: float
    """Distances to the ends and the sides of the belts' flat runs [m]."""

    def wider(self, by_m: float) -> "Outline":
        """Return the outline with a distance around it [m]."""
        return Outline(*(reach_m + by_m for reach_m in self))

    def about(self, ahead_m: float) -> "Outline":
        """Return the outline by its distances from a point ahead of mid-track, about which the chair turns."""
        rear_m, front_m, half_m, belts_rear_m, belts_front_m, half_belts_m = self
        ends_m = (belts_rear_m + ahead_m, belts_front_m - ahead_m)
        return Outline(rear_m + ahead_m, front_m - ahead_m, half_m, *ends_m, half_belts_m)


@njit(cache=True)
def is_free(landing: Landing, outline: Outline, x: float, y: float, heading: float) -> bool:
    """Return whether the belts stand on the landing, and nothing of the chair reaches beyond it but over the flight below."""
    c, s = math.cos(heading), math.sin(heading)
    up_x, up_y = math.cos(landing.turn), math.sin(landing.turn)
    foot_m = up_x * landing.foot_x + up_y * landing.foot_y
    for along in (-outline.rear_m, outline.front_m):
        for aside in (-outline.half_m, outline.half_m):
            corner_x, corner_y = x + c * along - s * aside, y + s * along + c * aside
            if corner_x > landing.depth or corner_y < landing.right or corner_y > landing.left:
                return False
            beside = corner_y > landing.half_flight
            if corner_x < 0.0 and (beside or corner_y < -landing.half_flight):
                return False
            if (beside or up_x > -1e-9) and up_x * corner_x + up_y * corner_y > foot_m + 1e-9:
                return False
    for along in (-outline.belts_rear_m, outline.belts_front_m):
        for aside in (-outline.half_belts_m, outline.half_belts_m):
            if x + c * along - s * aside < 0.0:
                return False
    # The inner corner, where the flight below ends aside, between two corners of the chair.
    along, aside = -c * x + s * (landing.half_flight - y), s * x + c * (landing.half_flight - y)
    return not (-outline.rear_m < along < outline.front_m and abs(aside) < outline.half_m)


class Reached(NamedTuple):
    """Cells that a search has reached, each with one number for heading, column and row."""

    cells: tuple[int, int, int]
    """Numbers of headings, columns and rows."""
    step_rad: float
    """Difference of two headings [rad]."""
    came: Any
    """Cell from which each was reached, and one [-]; zero at the start, and where none was."""
    spent: Any
    """Cost up to each cell, and one; zero where none was reached."""
    signs: Any
    """Signs of the last drive and the last turn, and whether the last move was a drive."""
    closed: Any
    poses: Any


def reached_from(landing: Landing, start: Any) -> tuple[Reached, Any]:
    """Return the cells of a search that begins at a place in the landing's frame and a heading [m, m, rad], and its queue."""
    turns = round(landing.turn / HEADING_RAD)
    step = landing.turn / turns
    columns, rows = int(landing.depth / CELL_M) + 2, int((landing.left - landing.right) / CELL_M) + 2
    count = (turns + 2 * BEYOND + 1) * columns * rows
    number = BEYOND + round(start[2] / step)
    cell = (number * columns + int(start[0] / CELL_M)) * rows + int((start[1] - landing.right) / CELL_M)
    came, spent = np.zeros((2, count), dtype=np.int32)
    signs, closed, poses = np.zeros((count, 3), dtype=np.int8), np.zeros(count, dtype=np.bool_), np.zeros((count, 3))
    spent[cell], poses[cell] = 1, (start[0], start[1], (number - BEYOND) * step)
    return Reached((turns + 2 * BEYOND + 1, columns, rows), step, came, spent, signs, closed, poses), np.array([[0, cell]])


@njit(cache=True)
def search(
    landing: Landing, outline: Outline, reached: Reached, queue: Any, goal: Any, lane_m: float, before_m: float, most: int
) -> Any:
    """Return the poses of the quickest way to the lane and the direction of a flight, one row each, and the queue.

    There is no way (yet) if there is no row; the search has ended if its queue is empty.

    Args:
        landing: Landing.
        outline: Outline of the chair.
        reached: Cells that have been reached.
        queue: Cells from which the search goes on, a heap of pairs: cost at least over a cell, and the cell.
        goal: Place on the flight's middle line and its direction, zero or the turn [m, m, rad].
        lane_m: Largest distance from that line [m].
        before_m: Least distance from the flight along it [m].
        most: Number of cells from which it goes on at most.
    """
    (headings, columns, rows), step, came, spent, signs, closed, poses = reached
    ends = BEYOND + int(round(goal[2] / step))
    heap = [(cost, cell) for cost, cell in queue]
    while heap and most > 0:
        cell = heapq.heappop(heap)[1]
        if closed[cell]:
            continue
        closed[cell] = True
        most -= 1
        number = cell // (columns * rows)
        if _cost_left(poses[cell], goal, abs(number - ends), lane_m, before_m) == 0:
            return _way(cell, came, poses), queue[:0]
        for move in range(4):
            kind, sign = move // 2, 2 * (move % 2) - 1
            to, drive_m = number + kind * sign, (1 - kind) * sign * DRIVE_M
            x, y = poses[cell, 0] + drive_m * math.cos(poses[cell, 2]), poses[cell, 1] + drive_m * math.sin(poses[cell, 2])
            if to < 0 or to >= headings or not is_free(landing, outline, x, y, (to - BEYOND) * step):
                continue
            at = (to * columns + int(x / CELL_M)) * rows + int((y - landing.right) / CELL_M)
            reverses = sign * signs[cell, kind] < 0
            takes = DRIVE_COST if not kind else 0 if signs[cell, 2] else TURN_COST
            cost = spent[cell] + takes + reverses * REVERSAL_COST
            if closed[at] or 0 < spent[at] <= cost:
                continue
            came[at], spent[at], poses[at] = cell + 1, cost, (x, y, (to - BEYOND) * step)
            signs[at] = signs[cell]
            signs[at, kind], signs[at, 2] = sign, 1 - kind
            heapq.heappush(heap, (cost + _cost_left(poses[at], goal, abs(to - ends), lane_m, before_m), at))
    left = np.empty((len(heap), 2), dtype=np.int64)
    for place, (cost, cell) in enumerate(heap):
        left[place] = cost, cell
    return np.empty((0, 3)), left


@njit(cache=True)
def _cost_left(pose: Any, goal: Any, turns: int, lane_m: float, before_m: float) -> int:
    """Return the least cost from a pose to the lane and the direction of a flight, zero there: drives, and turns beyond them."""
    c, s = math.cos(goal[2]), math.sin(goal[2])
    aside = abs((pose[1] - goal[1]) * c - (pose[0] - goal[0]) * s) - lane_m
    along = before_m - abs((pose[0] - goal[0]) * c + (pose[1] - goal[1]) * s)
    drives = int(math.ceil(max(aside, along, 0.0) / DRIVE_M))
    return DRIVE_COST * drives + TURN_COST * max(turns - drives, 0)


@njit(cache=True)
def _way(cell: int, came: Any, poses: Any) -> Any:
    """Return the poses up to a cell."""
    count = 0
    at = cell
    while at != -1:
        count, at = count + 1, came[at] - 1
    way = np.empty((count, 3))
    for place in range(count):
        way[count - 1 - place] = poses[cell]
        cell = came[cell] - 1
    return way
