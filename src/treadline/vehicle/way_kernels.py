"""Compiled search of ``way``: the cheapest sequence of moves of belts and flipper along which rest poses are followed."""

import heapq
import math
from typing import Any

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.scenario.chair import GRAVITY_M_S2
from treadline.vehicle.rest_pose_kernels import JUMP_RAD, RESTS, describe, follow, posture, settle

BRANCHES = 3
"""Most rest poses of one place and flipper angle; more than three have not been seen."""
SAME_RAD = math.radians(0.6)
"""Pitches that are one rest pose [rad]: just below the least angle between two rest poses of a place."""


@njit(cache=True)
def search(
    grounds: Any,
    parts: Any,
    masses: Any,
    torques: Any,
    places: Any,
    angles: Any,
    start: Any,
    limits: Any,
    rates: Any,
    prices: Any,
) -> tuple[Any, Any]:
    """Search the cheapest way, by A* with the time of the belts as bound.

    Args:
        grounds: Grounds (profile, vertex, 3); the first is the likely one, all must be passed by the same moves.
        places: Grid of places in the order of the drive [m].
        angles: Grid of flipper angles [rad].
        start: Index of place and angle, and pitch at the start.
        limits: Most torque [N m], most friction, error of the centre of mass along the chair [m], steepest line of the ground
            [rad].
        rates: Speed of belts [m/s], flipper and pitch [rad/s].
        prices: In seconds: per m/s of a fall; per second and (m/s)² of a fall that an error would cause, beyond the quiet speed;
            quiet speed [m/s]; per second and rad² of pitch above the steepest line; per second of a share of 1 on the flipper; per
            radian of pitch; per radian of the flipper.

    Returns:
        Rows (place, angle, pitch, drop of the fall on the move to it [m], drop by an error there [m]), and the cost; no rows
        without a way.
    """
    count, wide = places.size, angles.size
    many = grounds.shape[0]
    size = count * wide * BRANCHES
    pitch = np.full((size, many), np.nan)
    cost, rate, falls, unknown = np.full(size, np.inf), np.zeros(size), np.zeros(size), np.zeros(size)
    parent, closed = np.full(size, -1), np.zeros(size, np.bool_)
    i, j = int(start[0]), int(start[1])
    first = (i * wide + j) * BRANCHES
    for p in range(many):
        body, weighs = posture(angles[j : j + 1], parts, masses)
        pitch[first, p], _, _, stands = settle(start[2], places[i], body, weighs, grounds[p])
        if not stands:
            return np.zeros((0, 5)), np.zeros(0)
    cost[first] = 0.0
    to_go = np.abs(places[-1] - places) / rates[0]
    queue = [(to_go[i], first)]
    there = np.empty(many)
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if closed[node]:
            continue
        closed[node] = True
        i, j = node // (wide * BRANCHES), node // BRANCHES % wide
        if i == count - 1:
            return _path(node, parent, places, angles, pitch, falls, unknown), cost[node : node + 1]
        for step in range(-1, 2):
            for turn in range(-1, 2):
                to_i, to_j = i + step, j + turn
                if (step == 0 and turn == 0) or (step < 0 and turn != 0) or to_i < 0 or to_i >= count or to_j < 0 or to_j >= wide:
                    continue
                fall, stands = 0.0, True
                before, after = angles[j : j + 1], angles[to_j : to_j + 1]
                for p in range(many):
                    there[p], _, _, drop, ends = follow(
                        pitch[node, p], places[i], before, places[to_i], after, parts, masses, grounds[p]
                    )
                    fall = max(fall, drop)
                    if ends != RESTS:
                        stands = False
                        break
                if not stands:
                    continue
                to = _slot(pitch, (to_i * wide + to_j) * BRANCHES, there)
                if to < 0 or closed[to]:
                    continue
                if math.isnan(pitch[to, 0]):
                    pitch[to] = there
                    rate[to], unknown[to] = _rate(there, places[to_i], after, parts, masses, grounds, torques, limits, prices)
                if rate[to] == np.inf:
                    continue
                turned = abs(there[0] - pitch[node, 0])
                took = max(abs(places[to_i] - places[i]) / rates[0], abs(angles[to_j] - angles[j]) / rates[1], turned / rates[2])
                total = cost[node] + took * (1.0 + rate[to]) + prices[5] * turned + prices[6] * abs(angles[to_j] - angles[j])
                total += prices[0] * max(math.sqrt(2.0 * GRAVITY_M_S2 * fall) - prices[2], 0.0)
                if total < cost[to] - 1e-9:
                    cost[to], parent[to], falls[to] = total, node, fall
                    pitch[to] = there
                    heapq.heappush(queue, (total + to_go[to_i], to))
    return np.zeros((0, 5)), np.zeros(0)


@njit(cache=True)
def _slot(pitch: Any, first: int, there: Any) -> int:
    """Return the branch of a cell that has these pitches, or a free one; -1 if there is none."""
    for b in range(first, first + BRANCHES):
        if math.isnan(pitch[b, 0]):
            return b
        if np.abs(pitch[b] - there).max() < SAME_RAD:
            return b
    return -1


@njit(cache=True)
def _rate(
    there: Any, x: float, angle: Any, parts: Any, masses: Any, grounds: Any, torques: Any, limits: Any, prices: Any
) -> tuple[float, float]:
    """Return the price of a second in a pose, infinite where a limit forbids it, and the drop that an error would cause [m]."""
    out = np.empty(15 + torques.size)
    steepest, borne, drop = 0.0, 0.0, 0.0
    for p in range(grounds.shape[0]):
        if not describe(there[p], x, angle, parts, masses, grounds[p], torques, out):
            return np.inf, 0.0
        slips = abs(out[8] * out[9] + (1.0 - out[8]) * out[10])
        if out[15] > limits[0] or slips > limits[1]:
            return np.inf, 0.0
        steepest = max(steepest, out[0])
        front, rear = int(parts[int(out[13]), 6]) >= 0, int(parts[int(out[14]), 6]) >= 0
        borne = max(borne, (out[8] if front else 0.0) + (1.0 - out[8] if rear else 0.0))
        for side in range(2):
            drop = max(drop, _drop(out[0], x, angle, parts, masses, grounds[p], limits[2] * (2.0 * side - 1.0)))
    lacks = max(math.sqrt(2.0 * GRAVITY_M_S2 * drop) - prices[2], 0.0)
    above = max(steepest - limits[3], 0.0)
    return prices[1] * lacks * lacks + prices[3] * above * above + prices[4] * borne, drop


@njit(cache=True)
def _drop(th: float, x: float, angle: Any, parts: Any, masses: Any, ground: Any, error_m: float) -> float:
    """Return by how much the centre of mass would sink if it were elsewhere along the chair [m]."""
    body, weighs = posture(angle, parts, masses)
    weighs[1] += error_m
    weighs[4] += error_m
    low, _, drop, stands = settle(th, x, body, weighs, ground)
    if not stands:
        return 9.0
    return drop if abs(low - th) > JUMP_RAD else 0.0


@njit(cache=True)
def _path(node: int, parent: Any, places: Any, angles: Any, pitch: Any, falls: Any, unknown: Any) -> Any:
    """Return the rows of the way to a node."""
    wide, length, last = angles.size, 0, node
    while last >= 0:
        length += 1
        last = parent[last]
    rows = np.empty((length, 5))
    for k in range(length - 1, -1, -1):
        rows[k, 0], rows[k, 1] = places[node // (wide * BRANCHES)], angles[node // BRANCHES % wide]
        rows[k, 2], rows[k, 3], rows[k, 4] = pitch[node, 0], falls[node], unknown[node]
        node = parent[node]
    return rows
