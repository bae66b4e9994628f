"""Contact forces of the belts according to Coulomb's law, compiled: friction along and across the belt, forces, traction.

The forces come from a fixed-point iteration around MuJoCo's convex contact solver.

MuJoCo's contact problem is convex: each contact satisfies ``y_n >= |mu * y_t|``, where ``y = J a - aref + R f`` is the residual
acceleration of the contact (normal n, tangents t). A contact sliding at speed v has ``|y_t| = b v`` with ``b = 2/(dmax
timeconst)``, so the convex problem separates it at ``mu b v``: 6 m/s² at 0.05 m/s. The belts of a turning chair always slide. The
correction of De Saxcé and Feng (1998) restores Signorini's condition ``0 <= f_n, y_n >= 0, f_n y_n = 0`` with anisotropic Coulomb
friction and maximum dissipation: the reference acceleration of the normal row is reduced by ``s = |mu * y_t|``. ``s`` depends on
the solution, so the solve is repeated until ``s`` converges.

Paper: G. De Saxcé, Z.-Q. Feng, The bipotential method, Math. Comput. Modelling 28, 1998; V. Acary et al., ZAMM 91, 2011.
"""

import math

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from treadline.core.kernel_cache import njit

_STAGE = types.void(types.uintp, types.uintp)
_solve = types.ExternalFunction("mj_fwdConstraint", _STAGE)

MAX_SOLVES = 10
"""Largest number of contact solves per step; most steps need one or two. In a turn on 25°, 99 % of the ticks have residuals below
0.09 m/s² with three solves and below 0.015 m/s² with ten; neither the yaw rate (1 %) nor the time per step changes."""
TOLERANCE_M_S2 = 0.01
"""Accepted residual of the fixed point [m/s²]: a thousandth of gravity."""
RELAXATION_CUT, RELAXATION_MIN, SLOW_CONVERGENCE = 0.7, 0.3, 0.9
"""Under-relaxation of the iteration: factor on the step size, its minimum, and the ratio of successive changes above which it is
applied."""
EXCLUDED = -1
"""Constraint address of a contact without constraint rows."""
FRICTION = np.dtype([(name, float, 2) for name in ("left", "right", "middle", "leftward")])
"""Friction of a geom: along and across for its left half, the same for its right half, a point on the line between the halves and
the unit vector to its left, both in the horizontal plane of the world."""


@intrinsic
def _doubles_at(context, address):
    """Return an address as a pointer to doubles."""
    signature = types.CPointer(types.float64)(address)

    def generate(context, builder, signature, arguments):
        del context, signature
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    del context
    return signature, generate


@njit(cache=True)
def doubles(pointer, size):
    """Return the array at a pointer of ``mjData``, to be read again after each solve because the arena moves."""
    return carray(_doubles_at(pointer[0]), size)


@njit(cache=True)
def _tangent_speed(row, mu, J, R, aref, force, acceleration, force_share):
    """Return ``|mu * y_t|`` of the contact with normal row ``row`` [m/s²]."""
    nv = acceleration.shape[0]
    square = 0.0
    for axis in range(2):
        tangent = row + 1 + axis
        y = force_share * R[tangent] * force[tangent] - aref[tangent]
        for j in range(nv):
            y += J[tangent * nv + j] * acceleration[j]
        weighted = mu[axis] * y
        square += weighted * weighted
    return math.sqrt(square)


@njit(cache=True)
def normal_force(count, whole, address, pointers):
    """Return the sum of the normal contact forces after a solve [N]."""
    force = doubles(pointers[3], 3 * whole.shape[0])
    total = 0.0
    for i in range(count):
        if whole[i, address] != EXCLUDED:
            total += force[whole[i, address]]
    return total


@njit(cache=True)
def solve_contacts(model, data, count, real, whole, fields, pointers, acceleration, warm_start, shift, softness, accuracy):
    """Solve the contacts of one step with Coulomb friction.

    Args:
        count: Number of contacts of this step.
        real: Contact list as doubles, one row per contact; ``whole`` the same memory as 32-bit integers.
        fields: Columns of friction in ``real`` and of the constraint address in ``whole``.
        pointers: Locations in ``mjData`` of the pointers to ``native.CONSTRAINT_ARRAYS``.
        acceleration: Generalised acceleration; of the previous step on entry, of this step on return.
        warm_start: Start value of MuJoCo's solver.
        shift: Working memory, two numbers per contact: reference acceleration of the normal, and its correction.
        softness: 1 with MuJoCo's regularised friction; 0 with no-slip iterations, which remove the regularisation.
        accuracy: Accepted residual [m/s²] and largest number of solves.

    Returns:
        Residual of the fixed point [m/s²], maximum over the loaded contacts.
    """
    friction, address = fields[0], fields[1]
    tolerance, max_solves = accuracy
    nv = acceleration.shape[0]
    rows = 3 * real.shape[0]
    J, R = doubles(pointers[0], rows * nv), doubles(pointers[1], rows)
    aref = force = doubles(pointers[2], rows)
    for i in range(count):
        row = whole[i, address]
        if row == EXCLUDED:
            continue
        shift[i, 0] = aref[row]
        # Initial value from the acceleration of the previous step: from the slip alone, a hard turn converges to another branch.
        shift[i, 1] = _tangent_speed(row, real[i, friction : friction + 2], J, R, aref, force, acceleration, 0.0)
        aref[row] = shift[i, 0] - shift[i, 1]
    relaxation, before = 1.0, math.inf
    for solve in range(max_solves):
        _solve(model, data)
        force = doubles(pointers[3], rows)
        change = 0.0
        for i in range(count):
            row = whole[i, address]
            if row == EXCLUDED:
                continue
            wanted = _tangent_speed(row, real[i, friction : friction + 2], J, R, aref, force, acceleration, softness)
            if force[row] > 0.0:
                change = max(change, abs(wanted - shift[i, 1]))
            shift[i, 1] += relaxation * (wanted - shift[i, 1])
        if change < tolerance or solve == max_solves - 1:
            return change
        if change > SLOW_CONVERGENCE * before:
            relaxation = max(RELAXATION_CUT * relaxation, RELAXATION_MIN)
        before = change
        for i in range(count):
            row = whole[i, address]
            if row != EXCLUDED:
                aref[row] = shift[i, 0] - shift[i, 1]
        warm_start[:] = acceleration
    return 0.0


@njit(cache=True)
def turn_contacts(count, real, whole, frame, friction, surfacevel, geom, is_belt, chair_y, mu):
    """Align the tangents of each belt contact with the belt: along y × n, and across; set the friction of the stair's geom.

    ``real`` and ``whole`` are the contact list as doubles and as integers, one row per contact; ``mu`` has one record
    ``FRICTION`` per geom.
    """
    for i in range(count):
        row = real[i]
        first, second = whole[i, geom], whole[i, geom + 1]
        if is_belt[first]:
            sign, grip = 1.0, mu[second]
        elif is_belt[second]:
            sign, grip = -1.0, mu[first]
        else:
            continue
        # The position of a contact is stored before its frame. The sign of ``aside`` selects the half of the geom.
        middle, leftward = grip["middle"], grip["leftward"]
        aside = (row[frame - 3] - middle[0]) * leftward[0] + (row[frame - 2] - middle[1]) * leftward[1]
        mu_along, mu_across = grip["left"] if aside > 0.0 else grip["right"]
        nx, ny, nz = row[frame], row[frame + 1], row[frame + 2]
        ox, oy, oz = sign * nx, sign * ny, sign * nz
        tx = chair_y[1] * oz - chair_y[2] * oy
        ty = chair_y[2] * ox - chair_y[0] * oz
        tz = chair_y[0] * oy - chair_y[1] * ox
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        if length < 0.1:  # side face of the belt: its tangent plane does not contain the direction of travel
            row[friction] = mu_across
            row[friction + 1] = mu_across
            continue
        tx, ty, tz = tx / length, ty / length, tz / length
        sx, sy, sz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        a, b = row[surfacevel], row[surfacevel + 1]
        vx = a * row[frame + 3] + b * row[frame + 6]
        vy = a * row[frame + 4] + b * row[frame + 7]
        vz = a * row[frame + 5] + b * row[frame + 8]
        row[frame + 3], row[frame + 4], row[frame + 5] = tx, ty, tz
        row[frame + 6], row[frame + 7], row[frame + 8] = sx, sy, sz
        row[surfacevel] = vx * tx + vy * ty + vz * tz
        row[surfacevel + 1] = vx * sx + vy * sy + vz * sz
        row[friction] = mu_along
        row[friction + 1] = mu_across


@njit(cache=True)
def weaken(count, real, whole, friction, geom, grip):
    """Scale the friction of each contact by the remaining friction of its belt."""
    for i in range(count):
        share = grip[whole[i, geom]] * grip[whole[i, geom + 1]]
        real[i, friction] *= share
        real[i, friction + 1] *= share


@njit(cache=True)
def add_traction(count, real, whole, layout, belt_side, chair_y, force_pointer, traction):
    """Add the forward force of the stair on each belt [N] to ``traction`` (left, right).

    Call after the contact solve, with contact frames from ``turn_contacts``: the first tangent lies along the belt.

    Args:
        layout: offsets in a contact: frame, geoms, and first constraint row.
        belt_side: of each geom: 0 left, 1 right, -1 no belt.
        chair_y: axis of the pulleys in W.
        force_pointer: word of ``mjData`` with the address of ``efc_force``.
    """
    frame, geom, rows = layout[0], layout[3], layout[4]
    for i in range(count):
        first, second = whole[i, geom], whole[i, geom + 1]
        row = whole[i, rows]
        side, sign = belt_side[first], 1.0
        if side < 0:
            side, sign = belt_side[second], -1.0
        # Contacts on the side of a belt have no tangent along the direction of travel: only tangents set by ``turn_contacts`` are
        # perpendicular to the chair's y axis.
        tangent = real[i, frame + 3 : frame + 6]
        along_y = tangent[0] * chair_y[0] + tangent[1] * chair_y[1] + tangent[2] * chair_y[2]
        if side < 0 or row < 0 or abs(along_y) > 1e-6:
            continue
        # MuJoCo's force acts on the second geom, and the tangent y × n of a belt above the stair points backward.
        traction[side] += sign * doubles(force_pointer, row + 2)[row + 1]
