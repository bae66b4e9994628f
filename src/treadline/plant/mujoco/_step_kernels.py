"""Inner loop of the plant, compiled: belts, seat actuator, and MuJoCo's stages.

MuJoCo's functions are linked by name; ``_native.load_library`` must run before the first call.
"""

import math

import numpy as np
from numba import types

from treadline.core.kernel_cache import njit
from treadline.plant._actuator_lag_and_slew_kernels import act
from treadline.plant._motors_and_battery_kernels import limit_belts, limit_seat
from treadline.plant.mujoco.contact._coulomb_kernels import add_traction, normal_force, solve_contacts, turn_contacts, weaken
from treadline.plant.mujoco.contact._rubber_lug_kernels import follow_lugs
from treadline.plant.sensors._pose_kernels import rotation

_STAGE = types.void(types.uintp, types.uintp)
_kinematics = types.ExternalFunction("mj_fwdKinematics", _STAGE)
_inertia = types.ExternalFunction("mj_makeM", _STAGE)
_factor = types.ExternalFunction("mj_factorM", _STAGE)
_collide = types.ExternalFunction("mj_collision", _STAGE)
_constrain = types.ExternalFunction("mj_makeConstraint", _STAGE)
_project = types.ExternalFunction("mj_projectConstraint", _STAGE)
_transmit = types.ExternalFunction("mj_transmission", _STAGE)
_velocity = types.ExternalFunction("mj_fwdVelocity", _STAGE)
_actuate = types.ExternalFunction("mj_fwdActuation", _STAGE)
_accelerate = types.ExternalFunction("mj_fwdAcceleration", _STAGE)
_solve = types.ExternalFunction("mj_fwdConstraint", _STAGE)
_integrate = types.ExternalFunction("mj_implicit", _STAGE)

NOSLIP_ITERATIONS = 3
"""Number of no-slip iterations with the brake on: three reduce the creep of a chair on 28° from millimetres to micrometres per
minute."""

_CONTACT = ("residual", "unconverged", "force_max", "airborne", "hull")
ROW = np.dtype(
    [("qpos", float, 8), ("qvel", float, 7), ("belts", float, 2)]
    + [(name, float) for name in ("seat", "contacts", "brake", "flipper", "flipper_torque")]
    + [("support", float, 4), ("rotation", float, (3, 3))]
    + [(name, float) for name in _CONTACT]
    + [("traction", float, 2), ("power", float)]
)
"""Record of the log, one per tick. Rotation: matrix of the quaternion in ``qpos``. Residual: largest residual of the contact forces
over the steps of the tick [m/s²]. Unconverged: number of steps with a residual above the tolerance. Largest force: of the sums of
the normal forces [N]. Airborne: number of steps without normal force. Hull: largest number of contacts of hull, seat and passenger
over the steps."""
NO_SUPPORT_M = -1e3
"""Reach of a chair without contact [m]."""
SEAT_QPOS = 7
"""Place of the seat among MuJoCo's positions, after the chassis' free joint."""
FLIPPER_QPOS, FLIPPER_QVEL = 7, 6
"""Places of the first flipper among MuJoCo's positions and velocities on a chair without a seat, which takes the first of them."""
SWAY = np.dtype([(name, float) for name in ("phase", "omega", "step", "kg")] + [(name, float, 2) for name in ("amplitude", "rest")])
"""Sway of the passenger: phase, angular frequency [rad/s], time step [s], moving mass [kg], amplitudes forward and left [m], and
rest position [m]."""
# Result codes of ``advance``.
SOUND, WARNED, NOT_FINITE, CROWDED = 0, 1, 2, 3


@njit(cache=True)
def reach_of_contacts(count, real, whole, frame, geom, is_belt, qpos, xmat, reach):
    """Extend ``reach`` (front, rear, left, right of B, each positive outward) to the belt contacts.

    Returns:
        of_no_belt: Number of contacts of hull, seat and passenger.
    """
    of_no_belt = 0
    for i in range(count):
        if not (is_belt[whole[i, geom]] or is_belt[whole[i, geom + 1]]):
            of_no_belt += 1
            continue
        # The position of a contact is stored before its frame.
        dx, dy, dz = real[i, frame - 3] - qpos[0], real[i, frame - 2] - qpos[1], real[i, frame - 1] - qpos[2]
        x = xmat[0] * dx + xmat[3] * dy + xmat[6] * dz
        y = xmat[1] * dx + xmat[4] * dy + xmat[7] * dz
        reach[0], reach[1] = max(reach[0], x), max(reach[1], -x)
        reach[2], reach[3] = max(reach[2], y), max(reach[3], -y)
    return of_no_belt


@njit(cache=True)
def move_payload(sway, qvel, seat_rate, xmat, seat_xmat, com, force):
    """Set the payload position of the sway, and the reaction force on the seat.

    MuJoCo treats the mass at ``com`` as fixed in the seat: its acceleration lacks the terms of the relative motion d(t), d'' + 2 ω
    × d'. The reaction to these terms acts on the seat at the same place.
    """
    phase, omega, mass = sway["phase"], sway["omega"], sway["kg"]
    c, s = math.cos(phase), math.sin(phase)
    # qvel[3:6] is the angular velocity of the chassis in its own frame, seat_rate the additional rate of the seat about y.
    w0, w1, w2 = qvel[3], qvel[4] + seat_rate, qvel[5]
    wx = xmat[0] * w0 + xmat[1] * w1 + xmat[2] * w2
    wy = xmat[3] * w0 + xmat[4] * w1 + xmat[5] * w2
    wz = xmat[6] * w0 + xmat[7] * w1 + xmat[8] * w2
    a, b = sway["amplitude"]
    dx, dy, dz = (
        seat_xmat[0] * a + seat_xmat[1] * b,
        seat_xmat[3] * a + seat_xmat[4] * b,
        seat_xmat[6] * a + seat_xmat[7] * b,
    )
    speed, push = -omega * s, -omega * omega * c
    force[0] = -mass * (push * dx + 2.0 * speed * (wy * dz - wz * dy))
    force[1] = -mass * (push * dy + 2.0 * speed * (wz * dx - wx * dz))
    force[2] = -mass * (push * dz + 2.0 * speed * (wx * dy - wy * dx))
    com[0], com[1] = sway["rest"][0] + a * c, sway["rest"][1] + b * c
    sway["phase"] = phase + omega * sway["step"]


@njit(cache=True)
def judge(warnings, log, numbers, room):
    """Return the result code: a MuJoCo warning, a non-finite state, more than ``room`` contacts, or sound."""
    for count in warnings:
        if count > 0:
            return WARNED
    for value in numbers:
        if not math.isfinite(value):
            return NOT_FINITE
    for row in log:
        if row["contacts"] > room:
            return CROWDED
    return SOUND


@njit(cache=True, nogil=True)  # several threads can advance their plants in parallel
def advance(
    ticks, mu, log, numbers,
    model, data, count, real, whole, layout, coulomb, lugs, is_belt, xmat, grip, command, drives, mismatch, state,
    belts_of, surface_velocity, radius, seat, angles, flipper, damping, force, control, qpos, qvel, warnings,
    sway, payload_com, payload_force, seat_xmat, substeps, accuracy,
    belt_side, motor, electric, actuator, force_range,
):  # fmt: skip
    """Advance the plant by some ticks, write one row of ``log`` per tick and return the result code.

    Args:
        mu: Belt friction of each geom, records ``FRICTION``.
        numbers: All numbers of ``log`` in a row.
        coulomb: Whether contact forces are corrected, MuJoCo's number of no-slip iterations, pointers of the constraint arrays,
            acceleration, warm start of the solver, working memory.
        lugs: Lug parameters, travel of the belts, part of each geom, angle of a fixed approach section.
        grip: Remaining fraction of the friction of each geom.
        command: left, right [m/s], brake (0 or 1), stroke rate [m/s], flipper rate [rad/s].
        drives: speed limit, lag blend, speed step, brake step, seat blend, seat rate limit.
        state: record ``_actuator_lag_and_slew_kernels.STATE``; changed in place.
        belts_of: geom ids as (side, rear front nose flat approach wheels, and those of further sections).
        radius: distance of each geom's contacts from its axis; 0 for the straight parts of belts.
        seat: lower and upper end of the stroke, spacing of ``angles``; empty without a seat.
        angles: seat angle over the stroke; empty without a seat.
        flipper: records ``_actuator_lag_and_slew_kernels.FLIPPER``, the commanded one first; none without a flipper.
        damping: of each degree of freedom; changed in place.
        warnings: number of MuJoCo warnings by kind.
        sway: record ``SWAY``; none without sway.
        payload_com: centre of mass in the seat frame; changed in place.
        payload_force: force on the seat at that centre [N], in W; changed in place.
        seat_xmat: rotation of the seat in W, by rows.
        substeps: number of MuJoCo steps per tick.
        accuracy: accuracy of the contact forces for ``solve_contacts``.
        belt_side: side of each geom: 0 left, 1 right, -1 no belt.
        motor: record ``_motors_and_battery_kernels.MOTOR``; none without limits.
        electric: record ``ELECTRIC``, likewise; changed in place.
        actuator: record ``SEAT_MOTOR``, likewise; none without limits.
        force_range: force ranges of MuJoCo's actuators; changed in place.
    """
    traction = electric["traction"]
    frame, friction, surfacevel, geom = layout[0], layout[1], layout[2], layout[3]
    corrected, noslip, pointers, acceleration, warm_start, shift = coulomb
    lug, travel, part_of, fixed_rad = lugs
    fields, belts, stalled = (friction, layout[4]), state["belts"], state["stalled"]
    seated, flippers = seat.shape[0] > 0, flipper.shape[0]
    first = 1 if seated else 0
    at, moves = FLIPPER_QPOS + first, FLIPPER_QVEL + first
    for k in range(ticks):
        before = (belts[0], belts[1])
        act(command, drives, state, seat, angles, flipper, qpos[at] if flippers > 0 else 0.0)
        if motor.shape[0] > 0:
            held = (state["braked"] + stalled[0] > 0.5, state["braked"] + stalled[1] > 0.5)
            limit_belts(before, belts, held, motor[0], electric)
            if electric["charge"] == 0.0:
                state["power_cut"] = 1.0  # the fail-safe brakes engage on an empty battery
        for side in range(2):
            actual = belts[side] * (1.0 + mismatch[side])
            for geom_id in belts_of[side]:
                if radius[geom_id] == 0.0:
                    surface_velocity[geom_id, 0] = -actual
                else:
                    surface_velocity[geom_id, 5] = actual / radius[geom_id]
        # A braked chair is held by static friction, which MuJoCo regularises to a creep of millimetres per minute.
        stands = state["braked"] > 0.5 and belts[0] == 0.0 and belts[1] == 0.0
        noslip[0] = NOSLIP_ITERATIONS if stands else 0
        softness = 0.0 if stands else 1.0
        if actuator.shape[0] > 0:
            torque = limit_seat(qpos[SEAT_QPOS], qvel[6], state, seat, angles, actuator[0])
            force_range[0, 0], force_range[0, 1] = -torque, torque
        if seated:
            control[0] = state["seat_angle"]
        for number in range(flippers):
            limits = flipper[number]
            target = state["flipper_target"] + state["flipper_rate"] * limits["lag"]
            control[first + number] = target if limits["follows"] > 0.5 else limits["stays"]

        row = log[k]
        row["support"][:] = NO_SUPPORT_M
        row["residual"] = row["unconverged"] = row["force_max"] = row["airborne"] = row["hull"] = 0.0
        traction[:] = 0.0
        for _ in range(substeps):
            for number in range(flippers):
                limits, rate = flipper[number], qvel[moves + number]
                if number == 0 and state["flipper_lost"] > 0.5:
                    damping[moves] = limits["damping"] + (limits["lost_damping"] if rate > 0.0 else 0.0)
                else:
                    share = rate / limits["no_load"]
                    force_range[first + number, 0] = -limits["torque"] * min(max(1.0 + share, 0.0), 1.0)
                    force_range[first + number, 1] = limits["torque"] * min(max(1.0 - share, 0.0), 1.0)
            if sway.shape[0] > 0:
                move_payload(sway[0], qvel, qvel[6] if seated else 0.0, xmat, seat_xmat, payload_com, payload_force)
            _kinematics(model, data)
            _inertia(model, data)
            _factor(model, data)
            _collide(model, data)
            chair_y = (xmat[1], xmat[4], xmat[7])
            turn_contacts(count[0], real, whole, frame, friction, surfacevel, geom, is_belt, chair_y, mu)
            if lug.height > 0.0:
                speed = (belts[0] * (1.0 + mismatch[0]), belts[1] * (1.0 + mismatch[1]))
                approach_rad = qpos[at] if flippers > 0 else fixed_rad
                follow_lugs(count[0], real, whole, frame, surfacevel, geom, part_of, speed, approach_rad, qpos, xmat, lug, travel)
            weaken(count[0], real, whole, friction, geom, grip)
            of_no_belt = reach_of_contacts(count[0], real, whole, frame, geom, is_belt, qpos, xmat, row["support"])
            row["hull"] = max(row["hull"], of_no_belt)
            _constrain(model, data)
            _project(model, data)  # required by the no-slip iterations (crash otherwise); returns immediately without them
            _transmit(model, data)
            _velocity(model, data)
            _actuate(model, data)
            _accelerate(model, data)
            if corrected[0]:
                residual = solve_contacts(
                    model, data, count[0], real, whole, fields, pointers, acceleration, warm_start, shift, softness, accuracy
                )
                row["residual"] = max(row["residual"], residual)
                row["unconverged"] += residual > accuracy[0]
            else:
                _solve(model, data)
            total = normal_force(count[0], whole, fields[1], pointers)
            row["force_max"] = max(row["force_max"], total)
            row["airborne"] += total == 0.0
            add_traction(count[0], real, whole, layout, belt_side, chair_y, pointers[3], traction)
            _integrate(model, data)

        traction /= substeps
        row["traction"][:] = traction
        row["power"] = electric["power"]
        row["qpos"][:7], row["qvel"][:6] = qpos[:7], qvel[:6]
        row["qpos"][7] = qpos[SEAT_QPOS] if seated else 0.0
        row["qvel"][6] = qvel[6] if seated else 0.0
        for side in range(2):
            row["belts"][side] = belts[side] * (1.0 + mismatch[side])
        row["seat"], row["contacts"], row["brake"] = state["stroke"], count[0], state["braked"]
        row["flipper"] = qpos[at] if flippers > 0 else 0.0
        row["flipper_torque"] = force[first] if flippers > 0 else 0.0
        rotation(qpos[3], qpos[4], qpos[5], qpos[6], row["rotation"])
    return judge(warnings, log, numbers, real.shape[0])
