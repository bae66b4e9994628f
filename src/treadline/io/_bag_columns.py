"""Selected fields of the messages in MCAP files and ROS bags as columns on one grid.

A column is ``topic.field``, nested fields with dots, elements with brackets: ``/imu.angular_velocity.z``, ``/tracks.data[0]``; the
leading slash is optional. The time of a topic is ``header.stamp`` if any of its messages has a non-zero stamp, else the log time.
Of messages with equal times the last is used. Each topic has its own times; they are brought to one grid:

* its period is the one asked for, or the median interval of the slowest topic wanted;
* it runs from the latest first message to the earliest last one;
* an input is the last value at or before the point; an output lies on the line between its neighbours;
* where a topic pauses for more than ``PAUSE`` periods (its own median interval or the grid's, the longer one), the points
  inside the pause are NaN: nothing is invented.
"""

import re
from array import array
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from treadline.core.errors import LogFormatError, NotFinite, RecordError
from treadline.io import mcap_read
from treadline.io._tables import Table, held, listed, rows_of
from treadline.io.mcap_read import RecordedTopic, damage
from treadline.io.message_files import READERS, decoder_of, parts_of

_Series = tuple[Float64[np.ndarray, " n"], Float64[np.ndarray, " n"]]
"""Times since the first message of the log [ns], and values."""

_FIELD = re.compile(r"\w+(\.\w+|\[\d{1,9}\])*", re.ASCII)
_STEP = re.compile(r"(\w*[A-Za-z_]\w*)|\[(\d+)\]", re.ASCII)
PAUSE = 3.0
"""Two messages lost in a row are bridged, three are a gap."""
HALF = 0.5
"""Half a nanosecond, which absorbs rounding: stamps are whole nanoseconds."""


def read_bag(path: Path, inputs: tuple[str, ...], outputs: tuple[str, ...], period_s: float | None) -> tuple[Table, float]:
    """Return the wanted columns on one grid, and its period.

    Raises:
        LogFormatError: If the log is broken, or a column is not in it.
        RecordError: If a topic's time goes back, or the topics share no time.
    """
    wanted = (*inputs, *outputs)
    channels = _Channels(path, wanted)
    for file in parts_of(path):
        with damage(file):
            for topic, time_ns, data in READERS[file.suffix.lower()](file, channels.wants):
                channels.take(topic, time_ns, data)
    series = channels.series()
    medians = {name: float(np.median(np.diff(t))) for name, (t, _) in series.items()}
    period_ns = max(medians.values()) if period_s is None else 1e9 * period_s
    grid = _grid(path, series, period_ns)
    values = np.empty((len(grid), len(wanted)))
    for j, name in enumerate(wanted):
        t, column = series[name]
        values[:, j] = held(grid + HALF, t, column) if j < len(inputs) else np.interp(grid, t, column)
        # Without a value inside, not at the ends of, a pause.
        before = np.clip(np.searchsorted(t, grid + HALF, side="right") - 1, 0, len(t) - 2)
        is_inside = (grid > t[before] + HALF) & (grid < t[before + 1] - HALF)
        values[is_inside & (np.diff(t)[before] > PAUSE * max(period_ns, medians[name])), j] = np.nan
    since_first = 1e-9 * (grid - grid[0])
    spot = ": {:.3f} s after the first common time"
    table = Table(file=path, names=wanted, values=values, clock=None, t_s=None, marks=since_first, spot=spot)
    return table, period_ns / 1e9 if period_s is None else period_s


def _grid(path: Path, series: dict[str, _Series], period_ns: float) -> Float64[np.ndarray, " k"]:
    first = max(t[0] for t, _ in series.values())
    last = min(t[-1] for t, _ in series.values())
    if not last - first >= period_ns:
        spans = listed(f"{name} from {t[0] / 1e9:.3f} to {t[-1] / 1e9:.3f} s" for name, (t, _) in series.items())
        raise RecordError(f"{path}: the columns share less than a period of time ({spans}); are their stamps of one clock?")
    return first + period_ns * np.arange(rows_of(str(path), first, last + HALF, period_ns))


@dataclass(slots=True)
class _Channel:
    """Collected times, stamps and values of one topic."""

    columns: dict[str, list[str | int]] = field(default_factory=dict)
    times: "array[int]" = field(default_factory=lambda: array("q"))
    stamps: "array[int]" = field(default_factory=lambda: array("q"))
    values: "array[float]" = field(default_factory=lambda: array("d"))


class _Channels:
    """Collector of the requested columns, message by message."""

    def __init__(self, path: Path, wanted: tuple[str, ...]) -> None:
        self._path = path
        self._seen: dict[str, None] = {}
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
        message = decoder_of(topic)(data)
        channel = self._channels[_slashed(topic.name)]
        if len(channel.times) >= mcap_read.MAX_MESSAGES:
            raise LogFormatError(f"more than {mcap_read.MAX_MESSAGES} messages on {topic.name}")
        channel.values.extend([_number(message, name, steps) for name, steps in channel.columns.items()])
        channel.times.append(time_ns)
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        channel.stamps.append(0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))

    def series(self) -> dict[str, _Series]:
        """Return times and values of each column.

        Raises:
            LogFormatError: If a topic is missing in the log, or has fewer than two messages.
            RecordError: If the time of a topic decreases.
        """
        if not self._channels:
            raise LogFormatError(f"{self._path}: no column is requested; name one as topic.field (topics: {listed(self._seen)})")
        clocks = {topic: self._clock(topic, channel) for topic, channel in self._channels.items()}
        origin = min(int(times[0]) for times, _ in clocks.values())
        series: dict[str, _Series] = {}
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
                f"{self._path}: no topic '{topic}' for '{next(iter(channel.columns))}' (there are: {listed(self._seen, 99)}); "
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
    # The constants of a message type have defaults.
    return listed(item.name for item in (fields(value) if is_dataclass(value) else ()) if item.default is MISSING)
