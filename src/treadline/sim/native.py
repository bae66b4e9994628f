"""MuJoCo's C functions and contact list, reachable from compiled code.

Friction that differs along and across the belt needs each contact's tangents turned to the belt, between MuJoCo's
collision and constraint stages, 500 times a second: too often for Python. The kernels call MuJoCo through these
addresses. Layouts are measured on a small model with the installed MuJoCo, not assumed.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from llvmlite import binding

from treadline.errors import SimulationDiverged

PROBE = """
<mujoco><option jacobian="dense"/><worldbody><geom type="plane" size="9 9 1"/>
<body pos="0 0 0.09"><freejoint/><geom type="box" size="0.1 0.1 0.1" surfacevel="1 0 0 0 0 0"/></body>
<body pos="2 0 9"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
<body pos="4 0 9"><freejoint/><geom type="sphere" size="0.1"/></body>
</worldbody></mujoco>
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLayout:
    """Where things stand in ``mjData`` and ``mjContact``, in bytes."""

    count_offset: int
    """Of the number of contacts in mjData."""
    stride: int
    frame: int
    friction: int
    surfacevel: int
    geom: int
    efc_address: int
    """Of a contact's first row among the constraints, -1 without one."""


def _library() -> str:
    folder = Path(mujoco.__file__).parent
    names = sorted(path for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco*.dll") for path in folder.glob(pattern))
    if not names:
        raise SimulationDiverged(f"MuJoCo {mujoco.__version__} ships no library next to its Python package; reinstall it")
    return str(names[0])


def load_library() -> None:
    """Make MuJoCo's C functions known by name to compiled code."""
    binding.load_library_permanently(_library())
    # MuJoCo would write warnings to a file in the user's folder; the plant counts them and raises.
    mujoco.set_mju_user_warning(_no_file)


def _no_file(message: str) -> None:
    del message


@cache
def contact_layout() -> ContactLayout:
    """Return the layout of the installed MuJoCo, measured.

    Raises:
        SimulationDiverged: If it cannot be measured without doubt.
    """
    model = mujoco.MjModel.from_xml_string(PROBE)
    data = mujoco.MjData(model)
    # The counts follow the timers; read a little past those, well inside the struct.
    durations = data.timer.duration
    start = int(durations.__array_interface__["data"][0])
    span = durations.strides[0] * len(durations) + 512
    possible = np.ones(span // 4, dtype=bool)
    for box_height, sphere_height in ((9.0, 9.0), (0.09, 9.0), (0.09, 0.09)):
        data.qpos[9], data.qpos[16] = box_height, sphere_height
        mujoco.mj_forward(model, data)
        possible &= np.frombuffer(ctypes.string_at(start, span), dtype=np.int32) == data.ncon
    found = np.flatnonzero(possible)
    if found.size != 1:
        raise SimulationDiverged(
            f"MuJoCo {mujoco.__version__}: the number of contacts was found in {found.size} places; use 3.11 to 4.0"
        )
    contact = data.contact
    base = contact.dist.__array_interface__["data"][0]

    def offset(name: str) -> int:
        return int(getattr(contact, name).__array_interface__["data"][0] - base)

    return ContactLayout(
        count_offset=start + 4 * int(found[0]) - data._address,  # noqa: SLF001 - the binding's only way to the struct
        stride=int(contact.dist.strides[0]),
        frame=offset("frame"),
        friction=offset("friction"),
        surfacevel=offset("surfacevel"),
        geom=offset("geom"),
        efc_address=offset("efc_address"),
    )


def contact_list(data: mujoco.MjData) -> int:
    """Return the address of the contacts: the start of MuJoCo's arena, which does not move.

    Raises:
        SimulationDiverged: If the data hold no contact, so that the address cannot be told.
    """
    if data.ncon == 0:
        raise SimulationDiverged("the chair touches nothing at its start; check [start] and the staircase")
    return int(data.contact.dist.__array_interface__["data"][0])


POINTERS = ("efc_force", "efc_J", "efc_aref", "efc_R", "qacc")
POINTER_WORDS = 200
"""Words of mjData after its energies that are searched: 181 reach the last pointer in MuJoCo 4.0."""


@cache
def pointer_offsets() -> dict[str, int]:
    """Return the offsets [bytes] in mjData of ``POINTERS`` and of the count ``nefc``, measured: constraints move at every step.

    Raises:
        SimulationDiverged: If one cannot be measured without doubt.
    """
    model = mujoco.MjModel.from_xml_string(PROBE)
    data = mujoco.MjData(model)
    data.qpos[9] = 0.09
    mujoco.mj_forward(model, data)
    begin = data._address  # noqa: SLF001 - the binding's only way to the struct
    start = int(data.energy.__array_interface__["data"][0])
    words = np.frombuffer(ctypes.string_at(start, 8 * POINTER_WORDS), dtype=np.uint64)
    # Four more counts follow that of the contacts: equalities, frictions, limits, and all constraints.
    offsets = {"nefc": contact_layout().count_offset + 16}
    counted = ctypes.c_int32.from_address(begin + offsets["nefc"]).value == data.nefc > 0
    for name in POINTERS:
        found = np.flatnonzero(words == getattr(data, name).__array_interface__["data"][0])
        # Empty arrays before an array have its address, too; the arena's are all filled.
        if found.size == 0 or (found.size > 1 and name != "qacc") or not counted:
            raise SimulationDiverged(f"MuJoCo {mujoco.__version__}: no unique place of {name} in mjData; use 3.11 to 4.0")
        offsets[name] = start + 8 * int(found[-1]) - begin
    return offsets
