"""Firmware of the box at the drives, compiled for this computer: the same C files that run on the microcontroller.

``DriveBox.receive(bytes)``, ``DriveBox.tick(now_ms, inputs) -> outputs``, ``DriveBox.frame(readings) -> bytes``.
"""

import ctypes
import shutil
import subprocess
import tempfile
from ctypes import Structure, c_bool, c_int16, c_int32, c_uint8, c_uint16
from functools import cache
from pathlib import Path

from treadline.core.errors import LinkError
from treadline.hardware._frame import BoxState, Cause, content_of, state_of

SOURCES = Path(__file__).parents[4] / "firmware"
"""Folder of the C files in a checkout of the repository."""
FRAME_MAX = 102
"""Largest frame on the line [bytes], ``TL_FRAME_MAX``."""


class Inputs(Structure):
    """``tl_inputs``."""

    _fields_ = [*((name, c_bool) for name in ("dead_man", "stop", "handset", "rearm"))]
    _fields_ += [("drive_error", c_uint16), ("belts", c_int16 * 2)]


class Outputs(Structure):
    """``tl_outputs``."""

    _fields_ = [("belts_um_s", c_int32 * 2), ("seat", c_int16), ("flipper", c_int16)]
    _fields_ += [("brake", c_bool), ("contactor", c_bool)]


class Readings(Structure):
    """``tl_readings``."""

    _fields_ = [("present", c_uint8), ("buttons", c_uint8), ("voltage_mv", c_uint16)]
    _fields_ += [("orientation", c_int16 * 4), ("rates", c_int16 * 3), ("accelerations", c_int16 * 3)]
    _fields_ += [("seat", c_int16 * 2), ("flipper", c_int16 * 2)]


@cache
def library() -> ctypes.CDLL:
    """Return the firmware as a shared library.

    Raises:
        LinkError: Without a C compiler, or without the repository's ``firmware`` folder.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise LinkError("no C compiler (cc, gcc or clang) on the path; the emulator compiles the firmware: install gcc")
    if not SOURCES.is_dir():
        raise LinkError(f"no folder {SOURCES}; the emulator needs the firmware's C files: run it from a checkout of the repository")
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "box.so"
        sources = [str(SOURCES / f"{name}.c") for name in ("frame", "rules", "messages", "box")]
        subprocess.run([compiler, "-std=c99", "-O2", "-fPIC", "-shared", *sources, "-o", str(built)], check=True)  # noqa: S603 - the path's compiler
        found = ctypes.CDLL(str(built))
    found.tl_box_bytes.restype = found.tl_box_state.restype = ctypes.c_size_t
    found.tl_box_tick.restype = Outputs
    found.tl_box_start.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
    found.tl_box_receive.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    found.tl_box_tick.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.POINTER(Inputs)]
    found.tl_box_state.argtypes = [ctypes.c_void_p, ctypes.POINTER(Readings), ctypes.c_char_p]
    return found


class DriveBox:
    """One box with its firmware, started at time zero: latched."""

    def __init__(self) -> None:
        self._library = library()
        self.memory = ctypes.create_string_buffer(self._library.tl_box_bytes())
        """Memory of the box, ``tl_box``."""
        self._library.tl_box_start(self.memory, 0)
        self._cause = Cause.ARMED

    def receive(self, received: bytes) -> None:
        """Pass bytes from the line."""
        self._library.tl_box_receive(self.memory, received, len(received))

    def tick(self, now_ms: int, inputs: Inputs) -> Outputs:
        """Return what the drives do from a time on [ms]."""
        outputs: Outputs = self._library.tl_box_tick(self.memory, now_ms, inputs)
        return outputs

    def frame(self, readings: Readings) -> bytes:
        """Return the state as a frame."""
        frame = ctypes.create_string_buffer(FRAME_MAX)
        length = self._library.tl_box_state(self.memory, readings, frame)
        return frame.raw[:length]

    def events(self) -> list[str]:
        """Return a line if the box was stopped or armed since the last call."""
        state, before = self.state, self._cause
        self._cause = state.cause
        return [f"{state.cause.name}, newest command {state.now_ms - state.heard_ms} ms old"] if state.cause != before else []

    @property
    def state(self) -> BoxState:
        """State without readings."""
        content = content_of(self.frame(Readings())[:-1])
        state = None if content is None else state_of(content)
        assert state is not None, "the firmware writes a whole state"  # noqa: S101
        return state
