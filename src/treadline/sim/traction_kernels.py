"""Traction of the belts, read from MuJoCo's contact solution in compiled code.

The constraint forces live in MuJoCo's arena, which is laid out anew at every step: the pointer in ``mjData`` is read each time.
``no_type_check`` keeps the tests' shape checker from wrapping what numba compiles.
"""

from typing import Any, no_type_check

from numba import carray, njit, types  # type: ignore[attr-defined]
from numba.extending import intrinsic


@intrinsic
def _double_at(_: Any, address: Any) -> Any:
    """Return an address as a pointer to doubles."""
    del address

    def cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.uintp), cast


@njit(cache=True)
@no_type_check
def add_traction(count, real, whole, layout, belt_side, chair_y, force_pointer, traction):
    """Add to ``traction`` (left, right) [N] the force along the belt with which the stair pushes each belt forward.

    Call after the contact solve, with contact frames as ``turn_contacts`` leaves them: the first tangent lies along the belt.

    Args:
        layout: offsets in a contact: of the frame and its geoms, and of the first of its rows among the constraints.
        belt_side: of each geom: 0 left, 1 right, -1 no belt.
        chair_y: the belts' axis in W.
        force_pointer: the word of ``mjData`` that holds the address of ``efc_force``.
    """
    frame, geom, rows = layout[0], layout[3], layout[4]
    for i in range(count):
        first, second = whole[i, geom], whole[i, geom + 1]
        row = whole[i, rows]
        side, sign = belt_side[first], 1.0
        if side < 0:
            side, sign = belt_side[second], -1.0
        # A contact outside the belts' width has its tangent along no direction of travel: it is square to the chair's y axis only
        # where ``turn_contacts`` turned it.
        tangent = real[i, frame + 3 : frame + 6]
        along_y = tangent[0] * chair_y[0] + tangent[1] * chair_y[1] + tangent[2] * chair_y[2]
        if side < 0 or row < 0 or abs(along_y) > 1e-6:
            continue
        # MuJoCo's force acts on the second geom, and the tangent y × n of a belt above the stair points backward.
        traction[side] += sign * carray(_double_at(force_pointer[0]), (row + 2,))[row + 1]
