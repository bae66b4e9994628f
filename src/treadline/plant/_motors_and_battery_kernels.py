"""Belt motors, brakes and battery, compiled: limits of force and power on the speed commanded by the speed loop.

A permanent-magnet motor with a gear gives a force at the belt that decreases linearly with speed::

    F_max(v) = F_peak · u - (F_peak / v_0) · v,      u = battery voltage / nominal voltage

limited to F_peak, or to the continuous force when hot (first-order heating by the square of the force). The copper loss is F² v_0 /
F_peak: at stall, F_peak · v_0 is converted to heat. A brake, or a motor at standstill, holds up to a force and slips above.

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

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.core.signals import TICK_S
from treadline.plant._actuator_lag_and_slew_kernels import table

_BELT = ("peak", "no_load", "continuous", "thermal_s", "moving_kg", "carried_kg", "brake_hold")
_BATTERY = ("nominal_v", "full_v", "empty_v", "resistance", "capacity_j")
MOTOR = np.dtype([(name, float) for name in _BELT + _BATTERY])
"""Parameters of the belt motors, brakes and the battery."""
_BY_SIDE = ("traction", "old_traction", "force", "change", "old_change", "heat")
_COMMON = ("power", "voltage", "charge", "energy_j", "work_j")
ELECTRIC = np.dtype([(name, float, 2) for name in _BY_SIDE] + [(name, float) for name in _COMMON])
"""State. By side: traction of the last two ticks, force of motor or brake, speed change of the last two ticks, heat (1: steady
state at the continuous force). Common: electric power, battery voltage, charge, energy drawn from the battery, work done on the
belts."""
SEAT_MOTOR = np.dtype([(name, float) for name in ("push", "rate", "hold", "stiffness", "damping_s")])
"""Parameters of the seat actuator: stall force, no-load rate, holding force; stiffness of the seat mount, ratio of damping to
stiffness."""
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
        return -motor["brake_hold"], motor["brake_hold"]
    limit = motor["peak"] if electric["heat"][side] < 1.0 else min(motor["continuous"], motor["peak"])
    stall, slope = motor["peak"] * electric["voltage"] / motor["nominal_v"], motor["peak"] / motor["no_load"]
    return -min(limit, stall + slope * speed), min(limit, stall - slope * speed)


@njit(cache=True)
def load_of(side, motor, electric):
    """Return the load on a belt without the inertial force of the chair's mass due to the last changes of speed."""
    traction = 0.5 * (electric["traction"][side] + electric["old_traction"][side])
    change = 0.5 * (electric["change"][side] + electric["old_change"][side])
    return traction - motor["carried_kg"] * change / TICK_S


@njit(cache=True)
def limit_belts(before, asked, held, motor, electric):
    """Move the belt speeds from ``before`` towards ``asked`` within the limits of motors and brakes; ``asked`` is changed in place.

    Args:
        before: speeds at the last tick (left, right).
        held: whether brake or gear holds each belt.
        motor: record ``MOTOR``.
        electric: record ``ELECTRIC``; changed in place.
    """
    inertia = motor["moving_kg"] + motor["carried_kg"]
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
        electric["old_traction"][side], electric["old_change"][side] = electric["traction"][side], electric["change"][side]
        electric["change"][side] = asked[side] - before[side]
        electric["force"][side] = force = forces[side]
        heating = 0.0 if held[side] else (force / motor["continuous"]) ** 2
        electric["heat"][side] += (heating - electric["heat"][side]) * TICK_S / motor["thermal_s"]
        if not held[side]:
            electric["work_j"] += force * asked[side] * TICK_S
            # No regeneration: a back-driven motor dissipates its power in windings and controller.
            power += max(force * asked[side] + force * force * motor["no_load"] / motor["peak"], 0.0)
    draw(power, motor, electric)


@njit(cache=True)
def draw(power, motor, electric):
    """Draw electric power from the battery for one tick; the voltage drops by current times resistance."""
    open_v = motor["empty_v"] + electric["charge"] * (motor["full_v"] - motor["empty_v"])
    # V = V_open - R P / V; beyond V_open² / 4R no battery of this resistance delivers the power.
    voltage = 0.5 * (open_v + math.sqrt(max(open_v * open_v - 4.0 * motor["resistance"] * power, 0.0)))
    drawn_j = open_v * power / voltage * TICK_S
    electric["power"] = drawn_j / TICK_S
    electric["energy_j"] += drawn_j
    electric["charge"] = max(electric["charge"] - drawn_j / motor["capacity_j"], 0.0)
    electric["voltage"] = voltage


@njit(cache=True)
def limit_seat(actual, turning, state, seat, angles, actuator):
    """Return the available torque of the seat actuator; beyond it the stroke yields. ``state`` is changed in place.

    Args:
        actual: seat angle; ``turning``: its rate.
        state: record ``_actuator_lag_and_slew_kernels.STATE``.
        seat: lower and upper end of the stroke, spacing of ``angles``.
        angles: seat angle over the stroke.
        actuator: record ``SEAT_MOTOR``.
    """
    rate = abs(state["stroke_rate"])
    force = actuator["hold"] if rate < STANDS_M_S else actuator["push"] * max(1.0 - rate / actuator["rate"], 0.0)
    step = seat[2]
    higher = table(state["stroke"] + step, seat[0], step, angles)
    lower = table(state["stroke"] - step, seat[0], step, angles)
    slope = (higher - lower) / (2.0 * step)
    # Virtual work: force times stroke equals torque times angle. At the ends of the table the slope is halved or zero.
    torque = force / max(abs(slope), 1e-3)
    # The servo's torque is stiffness times deflection less damping times rate.
    free, most = actual + actuator["damping_s"] * turning, torque / actuator["stiffness"]
    target = min(max(state["seat_angle"], free - most), free + most)
    if target != state["seat_angle"]:
        state["stroke"] = min(max(state["stroke"] + (target - state["seat_angle"]) / slope, seat[0]), seat[1])
        state["seat_angle"] = target
    return torque
