"""Belt motors, brakes and battery, compiled: what a load leaves of the speed that the speed loop asks for.

A permanent-magnet motor behind a gear gives, at the belt, a force that falls linearly with speed::

    F_max(v) = F_peak · u - (F_peak / v_0) · v,      u = battery voltage / nominal voltage

and never more than F_peak, or the continuous force once it is hot (first-order heating by the square of the force). The copper
loss is F² v_0 / F_peak: at stall all of F_peak · v_0 is heat. A brake, or a motor that stands, holds up to ``BRAKE_HOLD`` and slips
beyond.

The belt obeys ``m dv/dt = F - F_c`` with F_c the traction that the contact solve returned for the tick before. Taken as it is, F_c
would make the loop unstable: a belt that grips carries the chair's mass M, F_c = L + M dv/dt, and each tick would multiply an error
by -M/m. So the part that the last change of speed explains is taken out, L = F_c - M a, and put on the left (added mass):
``(m + M) dv/dt = F - L``. For a belt that grips this is exact; an error in M decays by |M_s - M| / (m + M_s) per tick, which is
below one for all M up to m + 2 M_s. For a belt that slides, F_c is constant and the same equation reaches dv/dt = (F - F_c) / m with
the ratio M / (m + M) per tick. The motor's own slope F_peak / v_0 enters implicitly. A load within the limits leaves the speed as
asked for.
"""

import math
from typing import no_type_check

from numba import njit

from treadline.signals import TICK_S

# Constants of a chair's motors; an array without entries is a drive without limits.
PEAK, NO_LOAD, CONTINUOUS, THERMAL_S, MOVING_KG, CARRIED_KG, BRAKE_HOLD = 0, 1, 2, 3, 4, 5, 6
NOMINAL_V, FULL_V, EMPTY_V, RESISTANCE, CAPACITY_J = 7, 8, 9, 10, 11
MOTOR = 12
# State: traction of the last tick, force of motor or brake, speed change of the last tick, heat (1: as the continuous force makes),
# all by side; electric power, battery voltage, charge, energy drawn from the battery and work done on the belts.
TRACTION, FORCE, CHANGE, HEAT, POWER, VOLTAGE, CHARGE, ENERGY_J, WORK_J = 0, 2, 4, 6, 8, 9, 10, 11, 12
ELECTRIC = 13


@njit(cache=True)
@no_type_check
def drive_belt_within(asked, speed, load, inertia, slope, stall, limit):
    """Return speed and force of a belt a tick later: as asked, or what stall force, slope and limit leave of it."""
    force = load + inertia * (asked - speed) / TICK_S
    for sign in (1.0, -1.0):
        if sign * force > min(limit, stall - slope * sign * asked):
            line = (inertia * speed + TICK_S * (sign * stall - load)) / (inertia + TICK_S * slope)
            bounded = sign * stall - slope * line
            if sign * bounded > limit:
                return speed + TICK_S * (sign * limit - load) / inertia, sign * limit
            return line, bounded
    return asked, force


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
    peak, inertia = motor[PEAK], motor[MOVING_KG] + motor[CARRIED_KG]
    supply = electric[VOLTAGE] / motor[NOMINAL_V]
    power = 0.0
    for side in range(2):
        load = electric[TRACTION + side] - motor[CARRIED_KG] * electric[CHANGE + side] / TICK_S
        slope, stall, limit = peak / motor[NO_LOAD], peak * supply, peak
        if electric[HEAT + side] >= 1.0:
            limit = min(motor[CONTINUOUS], peak)
        if held[side]:
            slope, stall, limit = 0.0, motor[BRAKE_HOLD], motor[BRAKE_HOLD]
        speed, force = drive_belt_within(asked[side], before[side], load, inertia, slope, stall, limit)
        electric[CHANGE + side] = speed - before[side]
        electric[FORCE + side] = force
        asked[side] = speed
        heating = 0.0 if held[side] else (force / motor[CONTINUOUS]) ** 2
        electric[HEAT + side] += (heating - electric[HEAT + side]) * TICK_S / motor[THERMAL_S]
        if not held[side]:
            electric[WORK_J] += force * speed * TICK_S
            # What a motor that is driven back generates is burnt in its windings and controller: none returns to the battery.
            power += max(force * speed + force * force * motor[NO_LOAD] / peak, 0.0)
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
