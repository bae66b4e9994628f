"""Numeric topics of a run log as arrays: thousands of messages of one layout are decoded together.

A ``JointState`` or ``Imu`` message of one topic differs from the next in its stamp and its numbers only, as long as names and frame
are the same. Messages of a topic are grouped by these labels, and each group is decoded as one matrix of bytes.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from treadline.core.errors import LogFormatError
from treadline.core.signals import TICK_S
from treadline.io.cdr import HEADER, TICK_NS, seconds_of
from treadline.io.decode import CdrReader
from treadline.io.mcap_read import mcap_messages, one_error

MAX_LAYOUTS = 64
"""Largest number of different labels within one topic; a log of treadline has at most two."""
_STAMP_BYTES = 8
_FIRST = len(HEADER)
"""Offset of the stamp in a message."""
IMU_DOUBLES = 4 + 9 + 3 + 9 + 3
"""Numbers of a sensor_msgs/Imu up to the acceleration: orientation, angular velocity, acceleration, and two covariances between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """Messages of one topic: stamps, log times and numbers, in recorded order."""

    t_s: Float[np.ndarray, " n"]
    taken_s: Float[np.ndarray, " n"]
    """Mission time at which each message was taken [s]."""
    names: tuple[str, ...]
    position: Float[np.ndarray, "n p"]
    velocity: Float[np.ndarray, "n v"]
    frames: tuple[str, ...]
    """Frame names that occur."""
    frame: Int[np.ndarray, " n"]
    """Index of each message's frame in ``frames``."""

    def column(self, name: str) -> Float[np.ndarray, " n"] | None:
        """Return the positions of a name, or None if the topic does not have the name."""
        return self.position[:, self.names.index(name)] if name in self.names else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogContents:
    """Selected topics of a log."""

    columns: dict[str, Columns]
    """Topics of numbers, as arrays."""
    messages: dict[str, list[tuple[float, bytes]]]
    """Other topics: mission time [s] and bytes of each message."""


def read_contents(path: Path, numeric: Collection[str], others: Collection[str], stamped: Collection[str] = ()) -> LogContents:
    """Return the requested topics of a run log.

    Args:
        numeric: Topics of ``JointState`` or ``Imu`` messages.
        others: Topics whose messages are returned as bytes.
        stamped: Topics of which only the stamps are needed: large messages, returned up to their stamp.

    Raises:
        LogFormatError: If the file is missing, too large, damaged or not a treadline log.
    """
    wanted = {*numeric, *others, *stamped}
    stamps: dict[str, list[int]] = {}
    data: dict[str, list[bytes]] = {}
    with one_error(path):
        for topic, logged_ns, message in mcap_messages(path, wanted.__contains__, sealed=True):
            stamps.setdefault(topic.name, []).append(logged_ns)
            data.setdefault(topic.name, []).append(message[: _FIRST + _STAMP_BYTES] if topic.name in stamped else message)
        columns = {topic: _columns(topic, np.array(stamps[topic]), data[topic]) for topic in numeric if topic in data}
    messages = {
        topic: [(seconds_of(ns), message) for ns, message in zip(stamps[topic], data[topic], strict=True)]
        for topic in (*others, *stamped)
        if topic in data
    }
    return LogContents(columns=columns, messages=messages)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Offsets of the numbers in the messages of one label."""

    frame: str
    names: tuple[str, ...]
    label_end: int
    """End of the bytes that are the same in every message of the group."""
    position: tuple[int, int]
    """Offset and count of the positions."""
    velocity: tuple[int, int]


def _columns(topic: str, logged_ns: Int[np.ndarray, " n"], data: Sequence[bytes]) -> Columns:
    """Return the messages of a topic as columns."""
    lengths = np.array([len(message) for message in data])
    layout_of = _imu_layout if topic == "/imu" else _joint_layout
    rest = np.arange(len(data))
    groups: list[tuple[_Layout, Int[np.ndarray, " k"], Float[np.ndarray, "k q"]]] = []
    while len(rest):
        if len(groups) == MAX_LAYOUTS:
            raise LogFormatError(f"{topic}: more than {MAX_LAYOUTS} different sets of names; a topic of treadline has one")
        first = data[rest[0]]
        layout = layout_of(first)
        same = rest[lengths[rest] == len(first)]
        rows = np.frombuffer(b"".join(data[k] for k in same), np.uint8).reshape(len(same), len(first))
        labels = slice(_FIRST + _STAMP_BYTES, layout.label_end)
        alike = (rows[:, labels] == rows[0, labels]).all(axis=1)
        groups.append((layout, same[alike], rows[alike]))
        rest = np.setdiff1d(rest, same[alike], assume_unique=True)
    names = groups[0][0].names
    shape = (groups[0][0].position[1], groups[0][0].velocity[1])
    if any((layout.names, layout.position[1], layout.velocity[1]) != (names, *shape) for layout, _, _ in groups):
        raise LogFormatError(f"{topic}: the names change within the log; is it joined from logs of different versions?")
    return _joined(groups, logged_ns)


def _joined(groups: list[tuple[_Layout, np.ndarray, np.ndarray]], logged_ns: Int[np.ndarray, " n"]) -> Columns:
    """Return the groups of a topic in recorded order."""
    order = np.argsort(np.concatenate([at for _, at, _ in groups]))
    stamps_ns = [
        1_000_000_000 * rows[:, _FIRST : _FIRST + 4].copy().view("<i4")[:, 0].astype(np.int64)
        + rows[:, _FIRST + 4 : _FIRST + 8].copy().view("<u4")[:, 0]
        for _, _, rows in groups
    ]
    return Columns(
        t_s=_seconds(np.concatenate(stamps_ns)[order]),
        taken_s=_seconds(logged_ns),
        names=groups[0][0].names,
        position=np.concatenate([_doubles(rows, *layout.position) for layout, _, rows in groups])[order],
        velocity=np.concatenate([_doubles(rows, *layout.velocity) for layout, _, rows in groups])[order],
        frames=tuple(layout.frame for layout, _, _ in groups),
        frame=np.concatenate([np.full(len(at), k) for k, (_, at, _) in enumerate(groups)])[order],
    )


def _seconds(time_ns: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return times in seconds, as ``seconds_of`` does: a multiple of the tick gives the mission's float."""
    ticks, rest = np.divmod(time_ns, TICK_NS)
    return np.where(rest == 0, ticks * TICK_S, time_ns / 1e9)


def _doubles(rows: np.ndarray, offset: int, count: int) -> Float[np.ndarray, "k c"]:
    return rows[:, offset : offset + 8 * count].copy().view("<f8").reshape(len(rows), count)


def _joint_layout(message: bytes) -> _Layout:
    """Return the layout of a JointState message; counts and names belong to the label."""
    r = CdrReader(message)
    _, frame = r.stamp()
    names = tuple(r.string() for _ in range(r.uint32()))
    found: list[tuple[int, int]] = []
    ends: list[int] = []
    for _ in range(2):
        count = r.uint32()
        ends.append(r.offset)
        if count:
            r.doubles(count)
        found.append((r.offset - 8 * count, count))
    if found[0][1] not in (0, len(names)):
        raise LogFormatError(f"a JointState holds {found[0][1]} numbers; {len(names)} are required")
    return _Layout(frame=frame, names=names, label_end=ends[0], position=found[0], velocity=found[1])


def _imu_layout(message: bytes) -> _Layout:
    """Return the layout of an Imu message: all its numbers as positions."""
    r = CdrReader(message)
    _, frame = r.stamp()
    end = r.offset
    r.doubles(IMU_DOUBLES)
    return _Layout(frame=frame, names=(), label_end=end, position=(r.offset - 8 * IMU_DOUBLES, IMU_DOUBLES), velocity=(r.offset, 0))
