"""Dynamics of the actuators, compiled: belts with brake, seat stroke, flipper target."""

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.core.signals import TICK_S

_FAULTS = ("flipper_lost", "power_cut", "seat_stuck", "flipper_stuck")
_MOTIONS = ("stroke", "stroke_rate", "flipper_target", "flipper_rate", "seat_angle", "braked")
STATE = np.dtype([(name, float, 2) for name in ("belts", "stalled")] + [(name, float) for name in _FAULTS + _MOTIONS])
"""State of the actuators: belt speeds, fault flags (0 or 1), stroke and flipper target with their rates, seat angle, brake flag."""
_SERVO = ("wind_up", "lag", "lost_damping", "damping", "torque", "no_load", "follows", "stays")
FLIPPER = np.dtype([(name, float) for name in ("low", "high", "max_rate", *_SERVO)])
"""Limits of a flipper: lowest and highest angle, rate, servo deflection at full torque, servo lag, damping of an unpowered motor,
damping of the joint, stall torque, no-load rate, whether the flipper follows the commands, angle at which it stays otherwise."""


@njit(cache=True)
def act(command, drives, state, seat, angles, flipper, flipper_angle):
    """Advance the actuators by a tick: ``state`` is changed in place.

    Args:
        command: left, right [m/s], brake (0 or 1), stroke rate [m/s], flipper rate [rad/s].
        drives: speed limit, lag blend, speed step, brake step, seat blend, seat rate limit.
        state: record ``STATE``.
        seat: lower and upper end of the stroke, spacing of ``angles``; empty without a seat.
        angles: seat angle over the stroke; empty without a seat.
        flipper: records ``FLIPPER``, that which commands turn first; none without a flipper.
        flipper_angle: actual flipper angle.
    """
    powered = state["power_cut"] < 0.5
    braked = command[2] > 0.5 or not powered  # fail-safe brake: power releases it
    state["braked"] = 1.0 if braked else 0.0
    belts, stalled = state["belts"], state["stalled"]
    for side in range(2):
        stands = braked or stalled[side] > 0.5
        belts[side] = drive_belt(belts[side], command[side], stands, drives[0], drives[1], drives[2], drives[3])
    asked = min(max(command[3], -drives[5]), drives[5])
    state["stroke_rate"] += (asked - state["stroke_rate"]) * drives[4]
    if state["seat_stuck"] > 0.5 or not powered:  # held by its gear
        state["stroke_rate"] = 0.0
    if seat.shape[0] > 0:
        state["stroke"] = min(max(state["stroke"] + state["stroke_rate"] * TICK_S, seat[0]), seat[1])
        state["seat_angle"] = table(state["stroke"], seat[0], seat[2], angles)

    if flipper.shape[0] > 0:
        limits = flipper[0]
        fastest, wind_up = limits["max_rate"], limits["wind_up"]
        rate = min(max(command[4], -fastest), fastest) if state["flipper_stuck"] < 0.5 and powered else 0.0
        # Anti-windup: the target stays within the servo deflection of full motor torque.
        target = min(max(state["flipper_target"] + rate * TICK_S, flipper_angle - wind_up), flipper_angle + wind_up)
        held = min(max(target, limits["low"]), limits["high"])
        state["flipper_target"] = held
        state["flipper_rate"] = rate if held == target else 0.0


@njit(cache=True)
def drive_belt(speed, asked, brake, limit, blend, step, brake_step):
    """Return the belt speed after one tick: first-order lag with acceleration limit; the brake acts without lag."""
    if brake:
        return max(speed - brake_step, 0.0) if speed > 0.0 else min(speed + brake_step, 0.0)
    target = min(max(asked, -limit), limit)
    change = (target - speed) * blend
    return speed + min(max(change, -step), step)


@njit(cache=True)
def table(value, start, spacing, entries):
    """Return the linear interpolation in a table, constant beyond both ends."""
    place = (value - start) / spacing
    if place <= 0.0:
        return entries[0]
    last = entries.shape[0] - 1
    if place >= last:
        return entries[last]
    i = int(place)
    return entries[i] + (place - i) * (entries[i + 1] - entries[i])
