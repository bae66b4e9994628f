"""Belt motors, brakes and battery, compiled: limits of force and power on the speed commanded by the speed loop.

A permanent-magnet motor with a gear gives a force at the belt that decreases linearly with speed::

    F_max(v) = F_peak · u - (F_peak / v_0) · v,      u = battery voltage / nominal voltage

limited to F_peak, or to the continuous force when hot (first-order heating by the square of the force). The copper loss is F² v_0 /
F_peak: at stall, F_peak · v_0 is converted to heat. A brake, or a motor at standstill, holds up to ``BRAKE_HOLD`` and slips above.

Both belts together obey ``m dv/dt = F - F_c`` with the traction F_c from the contact solution of the previous ticks. Used directly,
F_c would make the loop unstable: a gripping belt carries the chair's mass M, F_c = L + M dv/dt, and each tick would multiply an
error by -M/m. Therefore the part explained by the last changes of speed is subtracted, L = F_c - M a, and moved to the left side
(added mass): ``(m + M) dv/dt = F - L``. For gripping belts this is exact; an error in M decays by |M_s - M| / (m + M_s) per tick,
below one for all M up to m + 2 M_s. For sliding belts F_c is constant and the same equation approaches dv/dt = (F - F_c) / m with
the ratio M / (m + M) per tick. A load within the limits leaves the commanded speeds unchanged.

The distribution of a load between the belts needs a separate treatment. Friction across the nosings locks the yaw of a chair
driving straight: the smallest difference of speed moves the load from one belt to the other, up to the friction cone. In explicit
steps this is a relay with chattering (measured: left and right in opposite phase, 150 N at 50 Hz). Therefore the limits act on the
sum first, because a load exceeding the limit of one belt passes to the other; the remainder above a belt's own limit then acts on
``LOCKED`` times the inertia, and the traction is the mean of two ticks, which cancels oscillations with a period of two ticks.
"""

import math

from treadline.core.kernel_cache import njit
from treadline.core.signals import TICK_S
from treadline.plant._actuator_lag_and_slew_kernels import SEAT_ANGLE, STROKE, STROKE_RATE, table

# Motor parameters; an empty array is a drive without limits.
PEAK, NO_LOAD, CONTINUOUS, THERMAL_S, MOVING_KG, CARRIED_KG, BRAKE_HOLD = 0, 1, 2, 3, 4, 5, 6
NOMINAL_V, FULL_V, EMPTY_V, RESISTANCE, CAPACITY_J = 7, 8, 9, 10, 11
# State, by side: traction of the last two ticks, force of motor or brake, speed change of the last two ticks, heat (1: steady state
# at the continuous force). Common: electric power, battery voltage, charge, energy drawn from the battery, work done on the belts.
TRACTION, OLD_TRACTION, FORCE, CHANGE, OLD_CHANGE, HEAT = 0, 2, 4, 6, 8, 10
POWER, VOLTAGE, CHARGE, ENERGY_J, WORK_J = 12, 13, 14, 15, 16
ELECTRIC = 17
# Parameters of the seat actuator: stall force, no-load rate, holding force; stiffness of the seat mount, ratio of damping to
# stiffness.
PUSH, RATE, HOLD, STIFFNESS, DAMPING_S = 0, 1, 2, 3, 4
STANDS_M_S = 1e-4
"""Rate below which the seat actuator counts as stationary [m/s]: its screw is self-locking."""
LOCKED = 16.0
"""Ratio of the inertia for the belts' difference to that for their mean: 100 N yield by 1 mm/s per tick, a sixteenth of 63 kg."""


@njit(cache=True)
def beyond(value, low, high):
    """Return the signed excess of a value over an interval."""
    return value - min(max(value, low), high)


@njit(cache=True)
def bounds_of(side, speed, held, motor, electric):
    """Return the lowest and highest force of a belt's motor or brake."""
    if held:
        return -motor[BRAKE_HOLD], motor[BRAKE_HOLD]
    limit = motor[PEAK] if electric[HEAT + side] < 1.0 else min(motor[CONTINUOUS], motor[PEAK])
    stall, slope = motor[PEAK] * electric[VOLTAGE] / motor[NOMINAL_V], motor[PEAK] / motor[NO_LOAD]
    return -min(limit, stall + slope * speed), min(limit, stall - slope * speed)


@njit(cache=True)
def load_of(side, motor, electric):
    """Return the load on a belt without the inertial force of the chair's mass due to the last changes of speed."""
    traction = 0.5 * (electric[TRACTION + side] + electric[OLD_TRACTION + side])
    change = 0.5 * (electric[CHANGE + side] + electric[OLD_CHANGE + side])
    return traction - motor[CARRIED_KG] * change / TICK_S


@njit(cache=True)
def limit_belts(before, asked, held, motor, electric):
    """Move the belt speeds from ``before`` towards ``asked`` within the limits of motors and brakes; ``asked`` is changed in place.

    Args:
        before: speeds at the last tick (left, right).
        held: whether brake or gear holds each belt.
        motor: parameters as named above.
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
            # No regeneration: a back-driven motor dissipates its power in windings and controller.
            power += max(force * asked[side] + force * force * motor[NO_LOAD] / motor[PEAK], 0.0)
    draw(power, motor, electric)


@njit(cache=True)
def draw(power, motor, electric):
    """Draw electric power from the battery for one tick; the voltage drops by current times resistance."""
    open_v = motor[EMPTY_V] + electric[CHARGE] * (motor[FULL_V] - motor[EMPTY_V])
    # V = V_open - R P / V; beyond V_open² / 4R no battery of this resistance delivers the power.
    voltage = 0.5 * (open_v + math.sqrt(max(open_v * open_v - 4.0 * motor[RESISTANCE] * power, 0.0)))
    drawn_j = open_v * power / voltage * TICK_S
    electric[POWER] = drawn_j / TICK_S
    electric[ENERGY_J] += drawn_j
    electric[CHARGE] = max(electric[CHARGE] - drawn_j / motor[CAPACITY_J], 0.0)
    electric[VOLTAGE] = voltage


@njit(cache=True)
def limit_seat(actual, turning, state, seat, angles, actuator):
    """Return the available torque of the seat actuator; beyond it the stroke yields. ``state`` is changed in place.

    Args:
        actual: seat angle; ``turning``: its rate.
        state: actuator state, rows as in ``_actuator_lag_and_slew_kernels``.
        seat: lower and upper end of the stroke, spacing of ``angles``.
        angles: seat angle over the stroke.
        actuator: parameters as named above.
    """
    rate = abs(state[STROKE_RATE])
    force = actuator[HOLD] if rate < STANDS_M_S else actuator[PUSH] * max(1.0 - rate / actuator[RATE], 0.0)
    step = seat[2]
    higher = table(state[STROKE] + step, seat[0], step, angles)
    lower = table(state[STROKE] - step, seat[0], step, angles)
    slope = (higher - lower) / (2.0 * step)
    # Virtual work: force times stroke equals torque times angle. At the ends of the table the slope is halved or zero.
    torque = force / max(abs(slope), 1e-3)
    # The servo's torque is stiffness times deflection less damping times rate.
    free, most = actual + actuator[DAMPING_S] * turning, torque / actuator[STIFFNESS]
    target = min(max(state[SEAT_ANGLE], free - most), free + most)
    if target != state[SEAT_ANGLE]:
        state[STROKE] = min(max(state[STROKE] + (target - state[SEAT_ANGLE]) / slope, seat[0]), seat[1])
        state[SEAT_ANGLE] = target
    return torque
