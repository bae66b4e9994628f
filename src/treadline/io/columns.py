"""Numbers, signals and stamps of a run's own log as arrays, for playback and figures.

Thousands of messages of one layout become arrays together: those of ``treadline_msgs`` and of an IMU have their numbers at the same
places, as long as the frame's name has one length. Others are decoded one by one.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.errors import LogFormatError
from treadline.core.signals import TICK_S
from treadline.io.mcap_read import RecordedTopic, damage, mcap_messages
from treadline.io.message_types import CDR, PACKAGE, TICK_NS, row_layout, seconds_of
from treadline.io.messages import IMU
from treadline.io.standard_messages import signal_reader
from treadline.io.topics import received

_STAMP = slice(len(CDR), len(CDR) + 8)
"""Bytes of the stamp, with which each message begins."""
_COUNT = slice(_STAMP.stop, _STAMP.stop + 4)
"""Bytes of the length of the frame's name."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogContents:
    """Selected topics of a log."""

    columns: dict[str, Float[np.ndarray, "n c"]] = field(default_factory=dict)
    """Topics of numbers: a row for each message, its stamp [s] and the requested numbers."""
    signals: dict[str, list[tuple[float, Any]]] = field(default_factory=dict)
    """Other topics: mission time [s] and signal of each message."""
    stamps_s: dict[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    """Stamps of the topics of which nothing else was requested [s]."""


def read_contents(
    path: Path, numeric: Mapping[str, Sequence[str]], others: Collection[str] = (), stamped: Collection[str] = ()
) -> LogContents:
    """Return the requested topics of a run log.

    Args:
        numeric: Fields of each topic that becomes an array.
        others: Topics whose messages are returned as signals.
        stamped: Topics of which only the stamps are needed.

    Raises:
        LogFormatError: If the file is missing, too large, damaged or not a treadline log.
    """
    wanted = {*numeric, *others, *stamped}
    topics: dict[str, RecordedTopic] = {}
    logged_ns: dict[str, list[int]] = {}
    data: dict[str, list[bytes]] = {}
    contents = LogContents()
    with damage(path):
        for topic, time_ns, message in mcap_messages(path, wanted.__contains__, sealed=True):
            topics[topic.name] = topic
            logged_ns.setdefault(topic.name, []).append(time_ns)
            data.setdefault(topic.name, []).append(message[: _STAMP.stop] if topic.name in stamped else message)
        for name, topic in topics.items():
            if name in stamped:
                contents.stamps_s[name] = _stamps_s(_rows(data[name], _STAMP.stop))
            elif name in numeric:
                contents.columns[name] = _columns(topic, data[name], numeric[name])
            else:
                times = map(seconds_of, logged_ns[name])
                contents.signals[name] = list(zip(times, (_signal(topic, message) for message in data[name]), strict=True))
    return contents


def _signal(topic: RecordedTopic, data: bytes) -> Any:
    read = signal_reader(topic.name, topic.kind)
    if read is None:
        raise LogFormatError(f"{topic.name} holds {topic.kind}; is it of another version?")
    return read(*received(topic, data, 0))


def _columns(topic: RecordedTopic, data: Sequence[bytes], names: Sequence[str]) -> Float[np.ndarray, "n c"]:
    places = _places(topic.kind, data, names)
    if places is None:
        signals = [_signal(topic, message) for message in data]
        return np.array([[getattr(signal, name) for name in ("t_s", *names)] for signal in signals], dtype=float)
    rows = _rows(data, max(places) + 8)
    values = [rows[:, at : at + 8].copy().view("<f8")[:, 0] for at in places]
    return np.column_stack([_stamps_s(rows), *values])


def _places(kind: str, data: Sequence[bytes], names: Sequence[str]) -> list[int] | None:
    """Return the offset of each number, the same in all messages; None where a topic has no such layout."""
    if (not kind.startswith(PACKAGE) and kind != IMU) or len({message[_COUNT] for message in data}) != 1:
        return None
    count = int.from_bytes(data[0][_COUNT], "little")
    if count > len(data[0]):
        raise LogFormatError("a message ends before its last field")
    layout = {name: at for name, code, at in row_layout(kind, chain([count], repeat(1))) if code == "d"}
    return [len(CDR) + layout[name] for name in names]


def _rows(data: Sequence[bytes], size: int) -> np.ndarray:
    """Return the first bytes of each message."""
    if min(map(len, data)) < size:
        raise LogFormatError("a message ends before its last field")
    return np.frombuffer(b"".join(message[:size] for message in data), np.uint8).reshape(len(data), size)


def _stamps_s(rows: np.ndarray) -> Float[np.ndarray, " n"]:
    """Return the stamps in seconds, as ``seconds_of`` does: a multiple of the tick gives the mission's float."""
    seconds, nanoseconds = rows[:, _STAMP].copy().view("<i4").T.astype(np.int64)
    time_ns = 1_000_000_000 * seconds + nanoseconds
    ticks, rest = np.divmod(time_ns, TICK_NS)
    return np.where(rest == 0, ticks * TICK_S, time_ns / 1e9)
