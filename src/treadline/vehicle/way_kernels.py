"""Compiled search of ``way``: moves of belts and flipper along which rest poses are followed, and what is left to go from each.

A state is a place, a flipper angle and a branch of the rest pose. ``explore`` follows the moves from all states that can be
reached, ``relax`` finds the cheapest sequence of moves from each of them to the end. Both work in portions, so that a planner may
spread them.
"""

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
MOVES = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1]])
"""Moves by a step of the place and of the flipper's angle: on and back, the flipper alone, and both. The first two pairs undo each
other."""
PAIRED = 4


@njit(cache=True)
def explore(
    first: int,
    count: int,
    last: int,
    order: Any,
    pitch: Any,
    state: Any,
    leads: Any,
    cost: Any,
    places: Any,
    angles: Any,
    ground: Any,
    parts: Any,
    masses: Any,
    torques: Any,
    limits: Any,
    rates: Any,
    prices: Any,
) -> int:
    """Follow the moves from the states found so far, and return how many are found then.

    Args:
        first: Number of states whose moves have been followed.
        count: Number of states found.
        last: Number of states after which this portion ends.
        order: States in the order in which they were found.
        pitch: Pitch of each state [rad]; not a number where it has not been found.
        state: Of each state: price of a second there; drop that an error would cause [m]; torque of the flipper's motor [N m].
        leads: State to which each move leads from each state; -1 where it cannot be made.
        cost: Cost and drop [m] of each move.
        places: Grid of places in the order of the drive [m].
        angles: Grid of flipper angles [rad].
        ground: Vertices of the ground.
        limits: Torque that is free [N m], most friction, error of the centre of mass along the chair [m], steepest line of the
            ground [rad], most torque [N m], friction that is known.
        rates: Speed of belts [m/s], flipper and pitch [rad/s].
        prices: In seconds: per m/s of a fall; per second and (m/s)² of a fall that an error would cause, beyond the quiet speed;
            quiet speed [m/s]; per second and rad² of pitch above the steepest line; per second of the motor's whole torque; per
            radian of pitch; per radian of the flipper; per second of a torque that is twice what is free; per second of a
            friction of 1 above what is known.
    """
    wide = angles.size
    while first < count and first < last:
        node = order[first]
        first += 1
        i, j = node // (wide * BRANCHES), node // BRANCHES % wide
        for move in range(MOVES.shape[0]):
            to_i, to_j = i + MOVES[move, 0], j + MOVES[move, 1]
            if leads[node, move] >= 0 or to_i < 0 or to_i >= places.size or to_j < 0 or to_j >= wide:
                continue
            cell = (to_i * wide + to_j) * BRANCHES
            to, fall = _near(pitch, cell, pitch[node], JUMP_RAD), 0.0
            if to < 0:
                before, after = angles[j : j + 1], angles[to_j : to_j + 1]
                there, _, _, fall, ends = follow(pitch[node], places[i], before, places[to_i], after, parts, masses, ground)
                if ends != RESTS:
                    continue
                to = _near(pitch, cell, there, SAME_RAD)
                if to < 0:
                    to = _free(pitch, cell)
                    if to < 0:
                        continue
                    pitch[to] = there
                    _describe(state[to], there, places[to_i], after, parts, masses, ground, torques, limits, prices)
                    if state[to, 0] < np.inf:
                        order[count] = to
                        count += 1
            if state[to, 0] == np.inf:
                continue
            turned = abs(pitch[to] - pitch[node])
            swung = abs(angles[to_j] - angles[j])
            took = max(abs(places[to_i] - places[i]) / rates[0], swung / rates[1], turned / rates[2])
            leads[node, move], cost[node, move, 1] = to, fall
            cost[node, move, 0] = (
                took * (1.0 + 0.5 * (state[to, 0] + state[node, 0]))
                + prices[5] * turned
                + prices[6] * swung
                + prices[0] * max(math.sqrt(2.0 * GRAVITY_M_S2 * fall) - prices[2], 0.0)
            )
            if fall == 0.0 and move < PAIRED:  # what was followed without a fall is undone alike
                leads[to, move ^ 1], cost[to, move ^ 1, 1], cost[to, move ^ 1, 0] = node, 0.0, cost[node, move, 0]
    return count


@njit(cache=True)
def relax(sweeps: int, order: Any, leads: Any, cost: Any, to_go: Any) -> bool:
    """Lower the cost from each state to the end by a number of sweeps, and return whether nothing changes any more."""
    for _ in range(sweeps):
        same = True
        for k in range(order.size - 1, -1, -1):
            node = order[k]
            for move in range(MOVES.shape[0]):
                to = leads[node, move]
                if to >= 0 and cost[node, move, 0] + to_go[to] < to_go[node] - 1e-9:
                    to_go[node] = cost[node, move, 0] + to_go[to]
                    same = False
        if same:
            return True
    return False


@njit(cache=True)
def cheapest(node: int, leads: Any, cost: Any, to_go: Any) -> int:
    """Return the move from a state that leads to the end at least cost; -1 at the end, or without a way."""
    best, least = -1, to_go[node] + 1e-6
    for move in range(MOVES.shape[0]):
        to = leads[node, move]
        if to >= 0 and cost[node, move, 0] + to_go[to] < least:
            best, least = move, cost[node, move, 0] + to_go[to]
    return best


@njit(cache=True)
def _near(pitch: Any, first: int, there: float, within: float) -> int:
    """Return the branch of a cell that has nearly this pitch; -1 if there is none."""
    for b in range(first, first + BRANCHES):
        if abs(pitch[b] - there) < within:
            return b
    return -1


@njit(cache=True)
def _free(pitch: Any, first: int) -> int:
    """Return a free branch of a cell; -1 if there is none."""
    for b in range(first, first + BRANCHES):
        if math.isnan(pitch[b]):
            return b
    return -1


@njit(cache=True)
def _describe(
    state: Any, th: float, x: float, angle: Any, parts: Any, masses: Any, ground: Any, torques: Any, limits: Any, prices: Any
) -> None:
    """Write the price of a second in a pose, infinite where a limit forbids it, and what else a state has."""
    out = np.empty(15 + torques.size)
    state[0] = np.inf
    if not describe(th, x, angle, parts, masses, ground, torques, out):
        return
    grip, drop, torque = abs(out[8] * out[9] + (1.0 - out[8]) * out[10]), 0.0, 0.0
    for motor in range(torques.size):  # the share of the motor that bears most, as a torque of the first
        if torques[motor] > 0.0:
            torque = max(torque, out[15 + motor] * torques[0] / torques[motor])
    if torque > limits[4] or grip > limits[1]:
        return
    for side in range(2):
        drop = max(drop, _drop(out[0], x, angle, parts, masses, ground, limits[2] * (2.0 * side - 1.0)))
    lacks = max(math.sqrt(2.0 * GRAVITY_M_S2 * drop) - prices[2], 0.0)
    above = max(out[0] - limits[3], 0.0)
    over = max(torque / limits[0] - 1.0, 0.0)
    state[0] = prices[1] * lacks * lacks + prices[3] * above * above + prices[4] * torque / torques[0] + prices[7] * over
    state[0] += prices[8] * max(grip - limits[5], 0.0)
    state[1], state[2] = drop, out[15]


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
def after(node: int, time_s: float, leads: Any, cost: Any, to_go: Any, pitch: Any, places: Any, angles: Any, rates: Any) -> int:
    """Return the state on the way from a state after so much time, at the rates for which the way was priced."""
    wide = angles.size
    while time_s > 0.0:
        move = cheapest(node, leads, cost, to_go)
        if move < 0:
            break
        to = leads[node, move]
        moved = abs(places[to // (wide * BRANCHES)] - places[node // (wide * BRANCHES)])
        swung = abs(angles[to // BRANCHES % wide] - angles[node // BRANCHES % wide])
        time_s -= max(moved / rates[0], swung / rates[1], abs(pitch[to] - pitch[node]) / rates[2])
        node = to
    return node


@njit(cache=True)
def nearest(place: float, angle: float, th: float, pitch: Any, to_go: Any, places: Any, angles: Any) -> int:
    """Return the state with a way that is nearest to a place, flipper angle and pitch; -1 if there is none within two steps.

    A step of the place, one of the angle and ``JUMP_RAD`` of the pitch are as far.
    """
    wide, best, least = angles.size, -1, 1e9
    step = abs(places[-1] - places[0]) / (places.size - 1)
    turn = (angles[-1] - angles[0]) / max(wide - 1, 1) if wide > 1 else 1.0
    near_i = int(round(abs(place - places[0]) / step)) if (place - places[0]) * (places[-1] - places[0]) > 0.0 else 0
    near_j = int(round((angle - angles[0]) / turn))
    for i in range(max(near_i - 2, 0), min(near_i + 3, places.size)):
        for j in range(max(near_j - 2, 0), min(near_j + 3, wide)):
            for node in range((i * wide + j) * BRANCHES, (i * wide + j + 1) * BRANCHES):
                if to_go[node] < np.inf:
                    off = abs(places[i] - place) / step + abs(angles[j] - angle) / turn + abs(pitch[node] - th) / JUMP_RAD
                    if off < least:
                        best, least = node, off
    return best
