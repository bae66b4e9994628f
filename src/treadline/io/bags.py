"""Logs of messages as records: MCAP, ROS bags, and folders of them.

Each topic has its own times (see ``channels``). They are brought to one grid:

* its period is the one asked for, or the median interval of the slowest topic wanted;
* it runs from the latest first message to the earliest last one;
* an input is the last value at or before the point; an output lies on the line between its neighbours;
* where a topic pauses for more than ``PAUSE`` periods (its own median interval or the grid's, the longer one), the points
  inside the pause are NaN: nothing is invented.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

from treadline.core.errors import LogFormatError, RecordError, TreadlineError
from treadline.io._sampling_grid import held, rows_of
from treadline.io._tables import Table, listed
from treadline.io.channels import Channels, Series
from treadline.io.mcap_read import mcap_messages
from treadline.io.ros_bags import bag_messages, db3_messages
from treadline.io.ros_types import Packet

PAUSE = 3.0
"""Two messages lost in a row are bridged, three are a gap."""
HALF = 0.5
"""Stamps are whole nanoseconds: half of one absorbs rounding."""

READERS: dict[str, Callable[[Path, Callable[[str], bool]], Iterator[Packet]]] = {
    ".mcap": mcap_messages,
    ".bag": bag_messages,
    ".db3": db3_messages,
}
"""What reads a file of messages, by its ending."""


def read_bag(path: Path, inputs: tuple[str, ...], outputs: tuple[str, ...], period_s: float | None) -> tuple[Table, float]:
    """Return the wanted columns on one grid, and its period.

    Raises:
        LogFormatError: If the log is broken, or a column is not in it.
        RecordError: If a topic's time goes back, or the topics share no time.
    """
    wanted = (*inputs, *outputs)
    channels = Channels(path, wanted)
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
        values[_in_a_pause(grid, t, PAUSE * max(period_ns, medians[name])), j] = np.nan
    since_first = 1e-9 * (grid - grid[0])
    spot = ": {:.3f} s after the first common time"
    table = Table(file=path, names=wanted, values=values, clock=None, t_s=None, marks=since_first, spot=spot)
    return table, period_ns / 1e9 if period_s is None else period_s


def _grid(path: Path, series: dict[str, Series], period_ns: float) -> Float64[np.ndarray, " k"]:
    first = max(t[0] for t, _ in series.values())
    last = min(t[-1] for t, _ in series.values())
    if not last - first >= period_ns:
        spans = listed(f"{name} from {t[0] / 1e9:.3f} to {t[-1] / 1e9:.3f} s" for name, (t, _) in series.items())
        raise RecordError(f"{path}: the columns share less than a period of time ({spans}); are their stamps of one clock?")
    return first + period_ns * np.arange(rows_of(str(path), first, last + HALF, period_ns))


def _in_a_pause(grid: Float64[np.ndarray, " k"], t: Float64[np.ndarray, " n"], longest: float) -> Bool[np.ndarray, " k"]:
    """Return which points lie inside, not at the ends of, an interval longer than that."""
    before = np.clip(np.searchsorted(t, grid + HALF, side="right") - 1, 0, len(t) - 2)
    return (np.diff(t)[before] > longest) & (grid > t[before] + HALF) & (grid < t[before + 1] - HALF)


def parts_of(path: Path) -> list[Path]:
    """Return the files of a log in their order: itself, or those of a bag's folder."""
    return [path] if path.is_file() else sorted((p for p in path.iterdir() if p.suffix in READERS), key=_number)


def _number(path: Path) -> tuple[int, str]:
    """Order the parts of a bag: run_2 before run_10."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isascii() and digits.isdigit() else 0, path.name


@contextmanager
def damage(file: Path) -> Iterator[None]:
    """Make one error of whatever a broken log does to its readers."""
    try:
        yield
    except LogFormatError as error:
        raise LogFormatError(f"{file}: {_line(error)}") from None
    except TreadlineError:
        raise
    except Exception as error:
        cause = _line(error) or type(error).__name__
        raise LogFormatError(f"{file}: not a whole log: {cause}; was it cut short? (mcap recover, rosbag reindex)") from error


def _line(error: Exception) -> str:
    """Return what an error says on one line: names out of a file may hold anything."""
    return " ".join(str(error).split())[:500]
