"""Belt traction from MuJoCo's contact solution, compiled.

The constraint forces are stored in MuJoCo's arena, whose layout changes at every step, so the pointer in ``mjData`` is read each
time. ``no_type_check`` prevents the shape checker of the tests from wrapping compiled functions.
"""

from typing import no_type_check

from numba import njit

from treadline.plant.mujoco.coulomb_kernels import doubles


@njit(cache=True)
@no_type_check
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
