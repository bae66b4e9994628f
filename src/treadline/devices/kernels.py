"""What the drives make of the orders, tick by tick, compiled: belts, the seat's actuator, the arm's servo.

``no_type_check`` keeps the tests' shape checker from wrapping what numba compiles.
"""

from typing import no_type_check

from numba import njit

TICK_S = 0.01

# Rows of the drive state.
LEFT, RIGHT, STROKE, STROKE_RATE, ARM_TARGET, ARM_LOST = 0, 1, 2, 3, 4, 5
# What is broken: 0 or 1; of the belts one row each.
STALLED, POWER_CUT, SEAT_STUCK, ARM_STUCK = 6, 8, 9, 10
# What follows from the orders: where the seat is held, how fast the arm's target moves, whether the brake is on.
SEAT_ANGLE, ARM_RATE, BRAKED = 11, 12, 13
DRIVES = 14


@njit(cache=True)
@no_type_check
def drive_belt(speed, asked, brake, limit, blend, step, brake_step):
    """Return a belt's speed a tick later: first-order lag within an acceleration limit; the brake ignores the lag."""
    if brake:
        return max(speed - brake_step, 0.0) if speed > 0.0 else min(speed + brake_step, 0.0)
    target = min(max(asked, -limit), limit)
    change = (target - speed) * blend
    return speed + min(max(change, -step), step)


@njit(cache=True)
@no_type_check
def table(value, start, spacing, entries):
    """Return a table's value by linear interpolation, held at its ends."""
    place = (value - start) / spacing
    if place <= 0.0:
        return entries[0]
    last = entries.shape[0] - 1
    if place >= last:
        return entries[last]
    i = int(place)
    return entries[i] + (place - i) * (entries[i + 1] - entries[i])


@njit(cache=True)
@no_type_check
def act(command, drives, state, seat, angles, arm, arm_angle):
    """Advance the drives by a tick: ``state`` is changed in place.

    Args:
        command: left, right [m/s], brake (0 or 1), stroke rate [m/s], arm rate [rad/s].
        drives: speed limit, lag blend, speed step, brake step, seat blend, seat rate limit.
        state: rows as named above.
        seat: stroke's lower end, upper end, spacing of ``angles``.
        angles: seat angle over the stroke.
        arm: lowest and highest angle, rate limit, angle by which full torque winds the servo up, and more; empty without one.
        arm_angle: where the arm is.
    """
    powered = state[POWER_CUT] < 0.5
    braked = command[2] > 0.5 or not powered  # a brake that power holds open
    state[BRAKED] = 1.0 if braked else 0.0
    for side in range(2):
        stands = braked or state[STALLED + side] > 0.5
        state[side] = drive_belt(state[side], command[side], stands, drives[0], drives[1], drives[2], drives[3])
    asked = min(max(command[3], -drives[5]), drives[5])
    state[STROKE_RATE] += (asked - state[STROKE_RATE]) * drives[4]
    if state[SEAT_STUCK] > 0.5 or not powered:  # held by its gear
        state[STROKE_RATE] = 0.0
    state[STROKE] = min(max(state[STROKE] + state[STROKE_RATE] * TICK_S, seat[0]), seat[1])
    state[SEAT_ANGLE] = table(state[STROKE], seat[0], seat[2], angles)

    if arm.shape[0] > 0:
        rate = min(max(command[4], -arm[2]), arm[2]) if state[ARM_STUCK] < 0.5 and powered else 0.0
        # Never further ahead of the arm than full torque reaches: what the motor cannot lift it does not owe later.
        target = min(max(state[ARM_TARGET] + rate * TICK_S, arm_angle - arm[3]), arm_angle + arm[3])
        held = min(max(target, arm[0]), arm[1])
        state[ARM_TARGET] = held
        state[ARM_RATE] = rate if held == target else 0.0
