"""CDR, the wire format of ROS 2 messages: little-endian values, aligned to their size.

Only the types used in the logs; readers of ROS 2 (and the tests' independent decoder) read the output.
"""

import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from treadline.core.signals import TICK_S

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header: CDR, little-endian."""


_TIME = struct.Struct("<iI")
"""Seconds and nanoseconds of a builtin_interfaces/Time."""


class MessageForm:
    """Message whose texts and lengths are constant: packing a time and the numbers is all that is left for each message.

    Args:
        data: The message with zeros for the open values.
        times: Offsets of the times.
        numbers: Offset and count of each group of 64-bit floats.
    """

    def __init__(self, data: bytes, times: Sequence[int], numbers: Sequence[tuple[int, int]]) -> None:
        self._data = data
        self._times = times
        self._packers = [(struct.Struct(f"<{count}d").pack_into, at) for at, count in numbers]

    def pack(self, t_s: float, *numbers: Sequence[float]) -> bytes:
        """Return the message with all times set to one time, and each group of numbers to its values."""
        data = bytearray(self._data)
        stamp = _stamp(t_s)
        for at in self._times:
            data[at : at + 8] = stamp
        for (pack_into, at), values in zip(self._packers, numbers, strict=True):
            pack_into(data, at, *values)
        return bytes(data)


class CdrWriter:
    """Writer of one CDR message; alignment counts from the end of the encapsulation header."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._times: list[int] = []
        self._numbers: list[tuple[int, int]] = []

    def _align(self, size: int) -> None:
        gap = -len(self._data) % size
        if gap:
            self._data += bytes(gap)

    def uint8(self, value: int) -> None:
        """Append a byte or bool."""
        self._data.append(value)

    def int32(self, value: int) -> None:
        """Append a signed 32-bit integer."""
        self._align(4)
        self._data += struct.pack("<i", value)

    def uint32(self, value: int) -> None:
        """Append an unsigned 32-bit integer."""
        self._align(4)
        self._data += struct.pack("<I", value)

    def doubles(self, *values: float) -> None:
        """Append 64-bit floats: an array of fixed length, or consecutive fields."""
        self._align(8)
        self._data += struct.pack(f"<{len(values)}d", *values)

    def array(self, values: np.ndarray) -> None:
        """Append an array of 64-bit floats, row by row, without its length."""
        self._align(8)
        self._data += np.ascontiguousarray(values, "<f8").tobytes()

    def floats(self, *values: float) -> None:
        """Append 32-bit floats."""
        self._align(4)
        self._data += struct.pack(f"<{len(values)}f", *values)

    def string(self, text: str) -> None:
        """Append a string with its length and terminating zero."""
        data = text.encode() + b"\x00"
        self.uint32(len(data))
        self._data += data

    def raw(self, data: bytes) -> None:
        """Append a sequence of bytes with its length."""
        self.uint32(len(data))
        self._data += data

    def stamp(self, t_s: float, frame_id: str) -> None:
        """Append a std_msgs/Header."""
        self.time(t_s)
        self.string(frame_id)

    def time(self, t_s: float) -> None:
        """Append the part of a std_msgs/Header before the frame name."""
        self._align(4)
        self._data += _stamp(t_s)

    def open_time(self) -> None:
        """Append a time that ``MessageForm.pack`` sets."""
        self.time(0.0)
        self._times.append(len(self._data) - _TIME.size)

    def open_doubles(self, count: int) -> None:
        """Append 64-bit floats that ``MessageForm.pack`` sets; none take no alignment, as in an empty sequence."""
        if count:
            self.doubles(*[0.0] * count)
        self._numbers.append((len(self._data) - 8 * count, count))

    def form(self) -> "MessageForm":
        """Return the complete message as a form, whose open times and numbers are still to be set."""
        data = self.message()
        start = len(data) - len(self._data)
        return MessageForm(data, [start + at for at in self._times], [(start + at, count) for at, count in self._numbers])

    def message(self) -> bytes:
        """Return the complete message."""
        return HEADER + bytes(self._data)


class Ros1Writer(CdrWriter):
    """Writer of one ROS 1 message: no alignment, strings without terminating zero, headers with a sequence number."""

    def _align(self, size: int) -> None:
        pass

    def string(self, text: str) -> None:
        """Append a string with its length."""
        self.raw(text.encode())

    def time(self, t_s: float) -> None:
        """Append the part of a std_msgs/Header before the frame name."""
        self.uint32(0)
        super().time(t_s)

    def message(self) -> bytes:
        """Return the complete message."""
        return bytes(self._data)


TICK_NS = round(TICK_S * 1e9)
"""Duration of a tick [ns]."""


def seconds_of(time_ns: int) -> float:
    """Return a time in seconds; a multiple of the tick gives exactly the mission's float, so that a replay is bit-identical."""
    ticks, rest = divmod(time_ns, TICK_NS)
    return time_ns / 1e9 if rest else ticks * TICK_S


@lru_cache(maxsize=16)  # all signals of a tick have the same few times
def nanoseconds_of(t_s: float) -> int:
    """Return a mission time in nanoseconds."""
    return round(t_s * 1e9)


@lru_cache(maxsize=16)
def _stamp(t_s: float) -> bytes:
    """Return a mission time as a builtin_interfaces/Time."""
    return _TIME.pack(*divmod(nanoseconds_of(t_s), 1_000_000_000))
