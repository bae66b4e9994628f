"""Access from compiled code to MuJoCo's C functions, contact list and constraint arrays.

The plant modifies MuJoCo's step in two places, 500 times per second: it aligns the tangents of each contact with the belt, and
corrects the contact forces (``contact/_coulomb_kernels.py``). Python is too slow for both, so compiled kernels call MuJoCo through
these addresses. The memory layouts are measured with a small model on the installed MuJoCo version.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool
from llvmlite import binding

from treadline.core.errors import SimulationDiverged

PROBE = """
<mujoco><option jacobian="dense"/><worldbody><geom type="plane" size="9 9 1"/>
<body pos="0 0 0.09"><freejoint/><geom type="box" size="0.1 0.1 0.1" surfacevel="1 0 0 0 0 0"/></body>
<body pos="2 0 9"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
<body pos="4 0 9"><freejoint/><geom type="sphere" size="0.1"/></body>
</worldbody></mujoco>
"""
"""Model for the measurement of memory layouts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLayout:
    """Byte offsets of fields in ``mjData`` and ``mjContact``."""

    count_offset: int
    """Offset of the number of contacts in mjData."""
    stride: int
    frame: int
    friction: int
    surfacevel: int
    geom: int
    efc_address: int


CONSTRAINT_ARRAYS = ("efc_J", "efc_R", "efc_aref", "efc_force")
"""Fields of ``mjData`` with pointers into its arena, which move from step to step."""
POINTERS_SPAN = 8192
"""Number of bytes after ``mjData.energy`` searched for the pointers: about 250 pointers of 8 bytes."""


def _library() -> str:
    folder = Path(mujoco.__file__).parent
    names = sorted(path for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco*.dll") for path in folder.glob(pattern))
    if not names:
        raise SimulationDiverged(f"MuJoCo {mujoco.__version__} ships no library next to its Python package; reinstall it")
    return str(names[0])


def load_library() -> None:
    """Register MuJoCo's C functions by name for compiled code."""
    binding.load_library_permanently(_library())
    # Without a handler MuJoCo writes warnings to a file in the working folder; the plant counts them and raises an error.
    mujoco.set_mju_user_warning(lambda _: None)


@cache
def contact_layout() -> ContactLayout:
    """Return the measured layout of the installed MuJoCo version.

    Raises:
        SimulationDiverged: If the measurement is ambiguous.
    """
    model = mujoco.MjModel.from_xml_string(PROBE)
    data = mujoco.MjData(model)
    # The counts follow the timers; 512 bytes after the timers are still inside the struct.
    durations = data.timer.duration
    start = int(durations.__array_interface__["data"][0])
    span = durations.strides[0] * len(durations) + 512
    possible = np.ones(span // 4, dtype=bool)
    for box_height, sphere_height in ((9.0, 9.0), (0.09, 9.0), (0.09, 0.09)):
        data.qpos[9], data.qpos[16] = box_height, sphere_height
        mujoco.mj_forward(model, data)
        possible &= np.frombuffer(ctypes.string_at(start, span), dtype=np.int32) == data.ncon
    count_offset = start + 4 * _only(possible, "the number of contacts") - data._address  # noqa: SLF001 - the only way to the struct
    fields = ("dist", "frame", "friction", "surfacevel", "geom", "efc_address")
    base, *starts = (int(getattr(data.contact, name).__array_interface__["data"][0]) for name in fields)
    offsets = {name: begins - base for name, begins in zip(fields[1:], starts, strict=True)}
    return ContactLayout(count_offset=count_offset, stride=int(data.contact.dist.strides[0]), **offsets)


def _only(possible: Bool[np.ndarray, " n"], what: str) -> int:
    """Return the index of the only place at which a value was found."""
    found = np.flatnonzero(possible)
    if found.size != 1:
        raise SimulationDiverged(f"MuJoCo {mujoco.__version__}: {what} was found in {found.size} places; use 4.0")
    return int(found[0])


@cache
def pointer_offsets() -> tuple[int, ...]:
    """Return the measured byte offsets in ``mjData`` of its pointers to ``CONSTRAINT_ARRAYS``.

    Raises:
        SimulationDiverged: If a pointer is not found in exactly one place.
    """
    model = mujoco.MjModel.from_xml_string(PROBE)
    data = mujoco.MjData(model)
    start = int(data.energy.__array_interface__["data"][0])
    possible = {name: np.ones(POINTERS_SPAN // 8, dtype=bool) for name in CONSTRAINT_ARRAYS}
    for box_height, sphere_height in ((0.09, 9.0), (0.09, 0.09)):
        data.qpos[9], data.qpos[16] = box_height, sphere_height
        mujoco.mj_forward(model, data)
        words = np.frombuffer(ctypes.string_at(start, POINTERS_SPAN), dtype=np.uint64)
        for name in CONSTRAINT_ARRAYS:
            possible[name] &= words == getattr(data, name).__array_interface__["data"][0]
    first = start - data._address  # noqa: SLF001 - the binding's only way to the struct
    return tuple(first + 8 * _only(there, f"the pointer to {name}") for name, there in possible.items())


def contact_list(data: mujoco.MjData) -> int:
    """Return the address of the contacts: the start of MuJoCo's arena, which does not move.

    Raises:
        SimulationDiverged: If there is no contact, so that the address is undetermined.
    """
    if data.ncon == 0:
        raise SimulationDiverged("the chair touches nothing at its start; check [start] and the staircase")
    return int(data.contact.dist.__array_interface__["data"][0])


def noslip_address(model: mujoco.MjModel) -> int:
    """Return the measured address of a model's number of no-slip iterations.

    Raises:
        SimulationDiverged: If it is not found in exactly one place.
    """
    start, span = int(model.opt.gravity.__array_interface__["data"][0]), 512
    possible, before = np.ones(span // 4, dtype=bool), model.opt.noslip_iterations
    for mark in (1_234_567, 7_654_321):
        model.opt.noslip_iterations = mark
        possible &= np.frombuffer(ctypes.string_at(start, span), dtype=np.int32) == mark
    model.opt.noslip_iterations = before
    return start + 4 * _only(possible, "noslip_iterations")
