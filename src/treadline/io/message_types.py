"""Message types of ROS by their definitions: bytes to and from values, in CDR, the wire format of ROS 2, or in ROS 1's own.

The standard types are those that rosbags holds; treadline's are registered from the ``.msg`` files of its ROS package. Messages are
decoded by the code that rosbags generates from a definition. They are encoded by one ``struct`` for each type and set of lengths,
built from the same definition: a log takes a dozen messages in each tick, and rosbags' encoder takes three times as long. The bytes
of ROS 1, which has reached its end of life, are rosbags' conversion of these.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from treadline.core.errors import LogFormatError
from treadline.core.signals import TICK_S

PACKAGE = "treadline_msgs"
CDR = b"\x00\x01\x00\x00"
"""Encapsulation header: CDR, little-endian."""
_CODES = {
    "bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d",
    "string": "s",
}  # fmt: skip
"""Codes of ``struct``; a text is a count and bytes."""
MOST_ELEMENTS = 1 << 28
"""Largest sequence that is decoded: a damaged message can declare billions of elements."""
TICK_NS = round(TICK_S * 1e9)
"""Duration of a tick [ns]."""


@cache
def store(*, ros1: bool = False) -> Any:
    """Return rosbags' store of the standard types of ROS 2 and of treadline's, or of the types of ROS 1."""
    known = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    known.max_sequence_length = MOST_ELEMENTS
    if ros1:
        known.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
        return known
    for path in sorted(files("treadline").joinpath("data", PACKAGE, "msg").iterdir(), key=str):
        known.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"{PACKAGE}/msg/{path.name.removesuffix('.msg')}"))
    return known


class RosMessage(NamedTuple):
    """A message before it is encoded."""

    topic: str
    kind: str
    """Message type as ROS 2 writes it."""
    values: Sequence[Any]
    """Numbers, texts, and bytes for a ``uint8[]``, in the order of the definition; other sequences begin with their count."""
    lengths: tuple[int, ...] = ()
    """Counts of these sequences."""

    def encoded(self, *, ros1: bool = False) -> bytes:
        """Return the bytes of the message: CDR, or those of ROS 1, whose header has a number more, zero here."""
        row: list[Any] = [CDR, *self.values]
        sizes: list[int] = []
        for at in _texts(self.kind, self.lengths):
            place = at + 1 + len(sizes)
            value = row[place]
            data = value if type(value) is bytes else value.encode() + b"\x00"
            sizes.append(len(data))
            row[place : place + 1] = (len(data), data)
        cdr = _packer(self.kind, self.lengths, tuple(sizes)).pack(*row)
        return bytes(store().cdr_to_ros1(cdr, self.kind)) if ros1 else cdr


def message_of(kind: str, data: bytes, *, ros1: bool = False) -> Any:
    """Return a message as an object with its fields.

    Raises:
        LogFormatError: If the bytes are no message of the type.
    """
    try:
        return store(ros1=True).deserialize_ros1(data, kind) if ros1 else store().deserialize_cdr(data, kind)
    except SerdeError as error:
        raise LogFormatError(f"not a {kind}: {error}") from None


def row_layout(kind: str, sizes: Iterable[int], lengths: tuple[int, ...] = ()) -> list[tuple[str, str, int]]:
    """Return name, ``struct`` code and offset of each value of a message, CDR's encapsulation header not counted.

    Args:
        kind: Message type.
        sizes: Bytes of the texts and of the sequences of bytes.
        lengths: Counts of the other sequences.
    """
    found, at, left = [], 0, iter(sizes)
    for name, code in _leaves(kind, iter(lengths)):
        for part in ("I", f"{next(left)}s") if code == "s" else (code,):
            at += -at % struct.calcsize(part[-1])
            found.append((name, part, at))
            at += struct.calcsize(f"<{part}")
    return found


@lru_cache(maxsize=1024)
def _packer(kind: str, lengths: tuple[int, ...], sizes: tuple[int, ...]) -> struct.Struct:
    text, at = f"<{len(CDR)}s", 0
    for _, code, offset in row_layout(kind, sizes, lengths):
        text += f"{offset - at}x{code}"
        at = offset + struct.calcsize(f"<{code}")
    return struct.Struct(text)


@lru_cache(maxsize=1024)
def _texts(kind: str, lengths: tuple[int, ...]) -> tuple[int, ...]:
    """Return which of a message's values are texts or sequences of bytes."""
    return tuple(at for at, (_, code) in enumerate(_leaves(kind, iter(lengths))) if code == "s")


def _leaves(kind: str, lengths: Iterator[int]) -> Iterator[tuple[str, str]]:
    """Yield name and code of each value of a message; ``s`` is a text or a sequence of bytes."""
    for name, field in store().fielddefs[kind][1]:
        yield from _parts(name, field, lengths)


def _parts(name: str, field: tuple[Any, Any], lengths: Iterator[int]) -> Iterator[tuple[str, str]]:
    """Yield name and code of each value of a field."""
    node, of = field
    if node == Nodetype.BASE:
        yield name, _CODES[of[0]]
    elif node == Nodetype.NAME:
        yield from ((f"{name}.{inner}", code) for inner, code in _leaves(of, lengths))
    elif node == Nodetype.SEQUENCE and of[0] == (Nodetype.BASE, ("uint8", 0)):
        yield name, "s"
    else:
        count = of[1]
        if node == Nodetype.SEQUENCE:
            count = next(lengths)
            yield name, "I"
        for k in range(count):
            yield from _parts(f"{name}[{k}]", of[0], lengths)


def seconds_of(time_ns: int) -> float:
    """Return a time in seconds; a multiple of the tick gives exactly the mission's float, so that a replay is bit-identical."""
    ticks, rest = divmod(time_ns, TICK_NS)
    return time_ns / 1e9 if rest else ticks * TICK_S


@lru_cache(maxsize=16)  # all signals of a tick have the same few times
def nanoseconds_of(t_s: float) -> int:
    """Return a mission time in nanoseconds."""
    return round(t_s * 1e9)


@lru_cache(maxsize=16)
def stamp(t_s: float) -> tuple[int, int]:
    """Return seconds and nanoseconds of a mission time, the values of a builtin_interfaces/Time."""
    return divmod(nanoseconds_of(t_s), 1_000_000_000)


def stamped_s(time: Any, *, origin_ns: int = 0, logged_ns: int = 0) -> float:
    """Return a builtin_interfaces/Time on the mission clock [s]; a zero stamp is replaced by the log time.

    Args:
        origin_ns: Time that is zero on the mission clock.
        logged_ns: Time at which the message was logged.
    """
    return seconds_of((time.sec * 1_000_000_000 + time.nanosec or logged_ns) - origin_ns)
