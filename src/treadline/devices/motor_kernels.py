"""Belt motors, brakes and battery, compiled: what a load leaves of the speed that the speed loop asks for.

A permanent-magnet motor behind a gear gives, at the belt, a force that falls linearly with speed::

    F_max(v) = F_peak · u - (F_peak / v_0) · v,      u = battery voltage / nominal voltage

and never more than F_peak, or the continuous force once it is hot (first-order heating by the square of the force). The copper
loss is F² v_0 / F_peak: at stall all of F_peak · v_0 is heat. A brake, or a motor that stands, holds up to ``BRAKE_HOLD`` and
slips beyond.

Both belts together obey ``m dv/dt = F - F_c`` with F_c the traction that the contact solve returned for the ticks before. Taken as
it is, F_c would make the loop unstable: a belt that grips carries the chair's mass M, F_c = L + M dv/dt, and each tick would
multiply an error by -M/m. So the part that the last changes of speed explain is taken out, L = F_c - M a, and put on the left
(added mass): ``(m + M) dv/dt = F - L``. For belts that grip this is exact; an error in M decays by |M_s - M| / (m + M_s) per tick,
below one for all M up to m + 2 M_s. For belts that slide, F_c is constant and the same equation reaches dv/dt = (F - F_c) / m with
the ratio M / (m + M) per tick. A load within the limits leaves the speeds as asked for.

How the belts share a load is another matter. Friction across the nosings locks the yaw of a chair that drives straight, and a
gripping belt then meets a wall: the least difference of speed moves the load from one belt to the other, up to the friction cone.
In explicit steps that is a relay, and it chatters (left and right in opposite phase, 150 N at 50 Hz, was measured). So the limits
act on the sum first, as a load that one belt cannot take passes to the other; what exceeds one belt's own limit then yields with
``LOCKED`` times the inertia, and the traction is the mean of two ticks, which is blind to a chatter of period two.
"""

import math
from typing import no_type_check

from numba import njit

from treadline.devices.kernels import SEAT_ANGLE, STROKE, STROKE_RATE, table
from treadline.signals import TICK_S

# Constants of a chair's motors; an array without entries is a drive without limits.
PEAK, NO_LOAD, CONTINUOUS, THERMAL_S, MOVING_KG, CARRIED_KG, BRAKE_HOLD = 0, 1, 2, 3, 4, 5, 6
NOMINAL_V, FULL_V, EMPTY_V, RESISTANCE, CAPACITY_J = 7, 8, 9, 10, 11
MOTOR = 12
# State: traction of the last tick and of the one before, force of motor or brake, speed change of the last tick and of the one
# before, heat (1: as the continuous force makes), all by side; electric power, battery voltage, charge, energy drawn from the
# battery and work done on the belts.
TRACTION, OLD_TRACTION, FORCE, CHANGE, OLD_CHANGE, HEAT = 0, 2, 4, 6, 8, 10
POWER, VOLTAGE, CHARGE, ENERGY_J, WORK_J = 12, 13, 14, 15, 16
ELECTRIC = 17
# Constants of the seat's actuator: force at stall, rate without load, force that it holds; stiffness of the seat on it, and damping
# over stiffness.
PUSH, RATE, HOLD, STIFFNESS, DAMPING_S = 0, 1, 2, 3, 4
STANDS_M_S = 1e-4
"""Rate below which the seat's actuator counts as standing: its screw holds."""
LOCKED = 16.0
"""Inertia against a difference of the belts over that against their mean: 100 N yield by 1 mm/s per tick, a sixteenth of 63 kg."""


@njit(cache=True)
@no_type_check
def beyond(value, low, high):
    """Return by how much a value exceeds an interval, signed."""
    return value - min(max(value, low), high)


@njit(cache=True)
@no_type_check
def bounds_of(side, speed, held, motor, electric):
    """Return the lowest and highest force of a belt's motor, or of what holds it."""
    if held:
        return -motor[BRAKE_HOLD], motor[BRAKE_HOLD]
    limit = motor[PEAK] if electric[HEAT + side] < 1.0 else min(motor[CONTINUOUS], motor[PEAK])
    stall, slope = motor[PEAK] * electric[VOLTAGE] / motor[NOMINAL_V], motor[PEAK] / motor[NO_LOAD]
    return -min(limit, stall + slope * speed), min(limit, stall - slope * speed)


@njit(cache=True)
@no_type_check
def load_of(side, motor, electric):
    """Return the load on a belt without the part that carries the chair's mass through the last changes of speed."""
    traction = 0.5 * (electric[TRACTION + side] + electric[OLD_TRACTION + side])
    change = 0.5 * (electric[CHANGE + side] + electric[OLD_CHANGE + side])
    return traction - motor[CARRIED_KG] * change / TICK_S


@njit(cache=True)
@no_type_check
def limit_belts(before, asked, held, motor, electric):
    """Bring the belts' speeds from ``before`` to ``asked`` as far as motors and brakes can; ``asked`` is changed in place.

    Args:
        before: speeds at the last tick (left, right).
        held: whether brake or gear holds each belt.
        motor: constants as named above.
        electric: state as named above; changed in place.
    """
    inertia = motor[MOVING_KG] + motor[CARRIED_KG]
    left = load_of(0, motor, electric) + inertia * (asked[0] - before[0]) / TICK_S
    right = load_of(1, motor, electric) + inertia * (asked[1] - before[1]) / TICK_S
    low_left, high_left = bounds_of(0, before[0], held[0], motor, electric)
    low_right, high_right = bounds_of(1, before[1], held[1], motor, electric)
    shared = 0.5 * beyond(left + right, low_left + low_right, high_left + high_right)
    own = (beyond(left - shared, low_left, high_left), beyond(right - shared, low_right, high_right))
    forces = (left - shared - own[0], right - shared - own[1])
    power = 0.0
    for side in range(2):
        asked[side] -= TICK_S * (shared + own[side] / LOCKED) / inertia
        electric[OLD_TRACTION + side], electric[OLD_CHANGE + side] = electric[TRACTION + side], electric[CHANGE + side]
        electric[CHANGE + side] = asked[side] - before[side]
        electric[FORCE + side] = force = forces[side]
        heating = 0.0 if held[side] else (force / motor[CONTINUOUS]) ** 2
        electric[HEAT + side] += (heating - electric[HEAT + side]) * TICK_S / motor[THERMAL_S]
        if not held[side]:
            electric[WORK_J] += force * asked[side] * TICK_S
            # What a motor that is driven back generates is burnt in its windings and controller: none returns to the battery.
            power += max(force * asked[side] + force * force * motor[NO_LOAD] / motor[PEAK], 0.0)
    draw(power, motor, electric)


@njit(cache=True)
@no_type_check
def draw(power, motor, electric):
    """Take electric power from the battery for a tick: its voltage sags by current times resistance."""
    open_v = motor[EMPTY_V] + electric[CHARGE] * (motor[FULL_V] - motor[EMPTY_V])
    # V = V_open - R P / V; beyond V_open² / 4R no battery of this resistance delivers the power.
    voltage = 0.5 * (open_v + math.sqrt(max(open_v * open_v - 4.0 * motor[RESISTANCE] * power, 0.0)))
    drawn_j = open_v * power / voltage * TICK_S
    electric[POWER] = drawn_j / TICK_S
    electric[ENERGY_J] += drawn_j
    electric[CHARGE] = max(electric[CHARGE] - drawn_j / motor[CAPACITY_J], 0.0)
    electric[VOLTAGE] = voltage


@njit(cache=True)
@no_type_check
def limit_seat(actual, turning, state, seat, angles, actuator):
    """Return the torque that the seat's actuator has now, and let its stroke yield to more; ``state`` is changed in place.

    Args:
        actual: the seat's angle; ``turning``: its rate.
        state: of the drives, rows as in ``devices.kernels``.
        seat: stroke's lower end, upper end, spacing of ``angles``.
        angles: seat angle over the stroke.
        actuator: constants as named above.
    """
    rate = abs(state[STROKE_RATE])
    force = actuator[HOLD] if rate < STANDS_M_S else actuator[PUSH] * max(1.0 - rate / actuator[RATE], 0.0)
    step = seat[2]
    higher = table(state[STROKE] + step, seat[0], step, angles)
    lower = table(state[STROKE] - step, seat[0], step, angles)
    slope = (higher - lower) / (2.0 * step)
    # Virtual work: force times stroke is torque times angle. At an end of the table the slope is half, or none.
    torque = force / max(abs(slope), 1e-3)
    # The servo's torque is stiffness times deflection less damping times rate.
    free, most = actual + actuator[DAMPING_S] * turning, torque / actuator[STIFFNESS]
    target = min(max(state[SEAT_ANGLE], free - most), free + most)
    if target != state[SEAT_ANGLE]:
        state[STROKE] = min(max(state[STROKE] + (target - state[SEAT_ANGLE]) / slope, seat[0]), seat[1])
        state[SEAT_ANGLE] = target
    return torque
