"""Selected fields of a log's messages as time series, each topic with its own time axis.

A column is ``topic.field``, nested fields with dots, elements with brackets: ``/imu.angular_velocity.z``, ``/tracks.data[0]``; the
leading slash is optional. The time of a topic is ``header.stamp`` if any of its messages has a non-zero stamp, else the log time.
Of messages with equal times the last is used.
"""

import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from treadline.core.errors import LogFormatError, NotFinite, RecordError
from treadline.io import mcap_read
from treadline.io._tables import listed
from treadline.io.ros_types import RecordedTopic, decoder_of

Series = tuple[Float64[np.ndarray, " n"], Float64[np.ndarray, " n"]]
"""Times since the first message of the log [ns], and values."""

_FIELD = re.compile(r"\w+(\.\w+|\[\d{1,9}\])*", re.ASCII)
_STEP = re.compile(r"(\w*[A-Za-z_]\w*)|\[(\d+)\]", re.ASCII)


@dataclass(slots=True)
class _Channel:
    """Collected times, stamps and values of one topic."""

    columns: dict[str, list[str | int]] = field(default_factory=dict)
    times: "array[int]" = field(default_factory=lambda: array("q"))
    stamps: "array[int]" = field(default_factory=lambda: array("q"))
    values: "array[float]" = field(default_factory=lambda: array("d"))


class Channels:
    """Collector of the requested columns, message by message."""

    def __init__(self, path: Path, wanted: tuple[str, ...]) -> None:
        self._path = path
        self._seen: dict[str, None] = {}
        self._decoders: dict[RecordedTopic, Callable[[bytes], Any]] = {}
        self._channels: dict[str, _Channel] = {}
        for name in wanted:
            topic, _, inside = name.partition(".")
            steps: list[str | int] = (
                [step or int(place) for step, place in _STEP.findall(inside)] if _FIELD.fullmatch(inside) else []
            )
            self._channels.setdefault(_slashed(topic), _Channel()).columns[name] = steps

    def wants(self, topic: str) -> bool:
        """Return whether any column of a topic is requested, and record the topic name for error messages."""
        self._seen[_slashed(topic)] = None
        return _slashed(topic) in self._channels

    def take(self, topic: RecordedTopic, time_ns: int, data: bytes) -> None:
        """Extract the requested fields of a message."""
        decode = self._decoders.get(topic)
        if decode is None:
            decode = self._decoders[topic] = decoder_of(topic)
        message = decode(data)
        channel = self._channels[_slashed(topic.name)]
        if len(channel.times) >= mcap_read.MAX_MESSAGES:
            raise LogFormatError(f"more than {mcap_read.MAX_MESSAGES} messages on {topic.name}")
        channel.values.extend([_number(message, name, steps) for name, steps in channel.columns.items()])
        channel.times.append(time_ns)
        channel.stamps.append(_stamp(message))

    def series(self) -> dict[str, Series]:
        """Return times and values of each column.

        Raises:
            LogFormatError: If a topic is missing in the log, or has fewer than two messages.
            RecordError: If the time of a topic decreases.
        """
        if not self._channels:
            raise LogFormatError(f"{self._path}: no column is requested; name one as topic.field (topics: {listed(self._seen)})")
        clocks = {topic: self._clock(topic, channel) for topic, channel in self._channels.items()}
        origin = min(int(times[0]) for times, _ in clocks.values())
        series: dict[str, Series] = {}
        for topic, (times, rows) in clocks.items():
            channel = self._channels[topic]
            values = np.array(channel.values).reshape(-1, len(channel.columns))[rows]
            for name, column in zip(channel.columns, values.T, strict=True):
                if np.isinf(column).any():
                    raise NotFinite(f"{self._path}: column '{name}' holds Inf; repair the recording")
                series[name] = (times - origin).astype(float), column
        return series

    def _clock(self, topic: str, channel: _Channel) -> tuple[np.ndarray, np.ndarray]:
        """Return the increasing times in use, and the indices of their messages."""
        if topic not in self._seen:
            raise LogFormatError(
                f"{self._path}: no topic '{topic}' for '{next(iter(channel.columns))}' (there are: {listed(self._seen)}); "
                "a column is topic.field"
            )
        if len(channel.times) < 2:
            raise LogFormatError(f"{self._path}: {len(channel.times)} messages on {topic}; at least two are needed")
        logged = np.array(channel.times)
        rows = np.argsort(logged, kind="stable")
        stamps = np.array(channel.stamps)[rows]
        times = stamps if stamps.any() else logged[rows]
        steps = np.diff(times)
        if (steps < 0).any():
            k = int(np.flatnonzero(steps < 0)[0])
            raise RecordError(
                f"{self._path}: the time of {topic} does not increase: message {k + 2} is stamped {-steps[k] / 1e9:.6g} s before "
                "the one logged before it; cut the recording there"
            )
        last = np.append(steps > 0, True)
        if last.sum() < 2:
            raise RecordError(f"{self._path}: all messages on {topic} have the same time")
        return times[last], rows[last]


def _slashed(topic: str) -> str:
    return "/" + topic.lstrip("/")


def _stamp(message: Any) -> int:
    """Return the stamp in a message header [ns], 0 without header."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _number(message: Any, name: str, steps: list[str | int]) -> float:
    """Return the number at a path of fields and indices."""
    value = message
    for step in steps:
        try:
            value = value[step] if isinstance(step, int) else getattr(value, step)
        except AttributeError:
            raise LogFormatError(f"no field '{step}' for '{name}' (there are: {_fields(value)})") from None
        except (IndexError, TypeError):
            count = len(value) if hasattr(value, "__len__") else "no"
            raise LogFormatError(f"'{name}': a message has {count} elements there, not [{step}]") from None
    if not isinstance(value, int | float | np.number | np.bool_):
        raise LogFormatError(f"'{name}' is not a number but {type(value).__name__} (there are: {_fields(value)})")
    return float(value)


def _fields(value: Any) -> str:
    """Return the possible continuations of a path, for error messages."""
    if hasattr(value, "__len__"):
        return f"[0] to [{len(value) - 1}]" if len(value) and not isinstance(value, str) else "none"
    return listed(item for item in dir(value) if not item.startswith("_"))
