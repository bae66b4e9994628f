"""Dynamics of the actuators, compiled: belts with brake, seat stroke, flipper target."""

from treadline.core.kernel_cache import njit
from treadline.core.signals import TICK_S

# Rows of the actuator state.
LEFT, RIGHT, STROKE, STROKE_RATE, FLIPPER_TARGET, FLIPPER_LOST = 0, 1, 2, 3, 4, 5
# Fault flags, 0 or 1; STALLED has one row per belt.
STALLED, POWER_CUT, SEAT_STUCK, FLIPPER_STUCK = 6, 8, 9, 10
# Outputs: held seat angle, rate of the flipper target, brake flag.
SEAT_ANGLE, FLIPPER_RATE, BRAKED = 11, 12, 13
DRIVES = 14
# Columns of a flipper's limits: lowest and highest angle, rate limit, servo deflection at full torque, servo lag, damping of an
# unpowered motor, damping of the joint, stall torque, no-load rate, whether it follows the commands, angle at which it stays else.
FOLLOWS, STAYS, FLIPPER = 9, 10, 11


@njit(cache=True)
def act(command, drives, state, seat, angles, flipper, flipper_angle):
    """Advance the actuators by a tick: ``state`` is changed in place.

    Args:
        command: left, right [m/s], brake (0 or 1), stroke rate [m/s], flipper rate [rad/s].
        drives: speed limit, lag blend, speed step, brake step, seat blend, seat rate limit.
        state: rows as named above.
        seat: lower and upper end of the stroke, spacing of ``angles``; empty without a seat.
        angles: seat angle over the stroke; empty without a seat.
        flipper: limits of each flipper, the first of which commands turn; no rows without one.
        flipper_angle: actual flipper angle.
    """
    powered = state[POWER_CUT] < 0.5
    braked = command[2] > 0.5 or not powered  # fail-safe brake: power releases it
    state[BRAKED] = 1.0 if braked else 0.0
    for side in range(2):
        stands = braked or state[STALLED + side] > 0.5
        state[side] = drive_belt(state[side], command[side], stands, drives[0], drives[1], drives[2], drives[3])
    asked = min(max(command[3], -drives[5]), drives[5])
    state[STROKE_RATE] += (asked - state[STROKE_RATE]) * drives[4]
    if state[SEAT_STUCK] > 0.5 or not powered:  # held by its gear
        state[STROKE_RATE] = 0.0
    if seat.shape[0] > 0:
        state[STROKE] = min(max(state[STROKE] + state[STROKE_RATE] * TICK_S, seat[0]), seat[1])
        state[SEAT_ANGLE] = table(state[STROKE], seat[0], seat[2], angles)

    if flipper.shape[0] > 0:
        limits = flipper[0]
        rate = min(max(command[4], -limits[2]), limits[2]) if state[FLIPPER_STUCK] < 0.5 and powered else 0.0
        # Anti-windup: the target stays within the servo deflection of full motor torque.
        target = min(max(state[FLIPPER_TARGET] + rate * TICK_S, flipper_angle - limits[3]), flipper_angle + limits[3])
        held = min(max(target, limits[0]), limits[1])
        state[FLIPPER_TARGET] = held
        state[FLIPPER_RATE] = rate if held == target else 0.0


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
