"""Time columns: what they are called, in which unit they count, and what to do where the name says no unit.

A name is split into words: ``t_s``, ``Time (ms)``, ``__time``, ``elapsed_us``, ``header.stamp``; the last may be a unit. Seconds
and nanoseconds may stand in two columns (``stamp.sec``, ``stamp.nanosec``). Without a unit, or where a name says seconds, a number
of ten, 13, 16 or 19 digits is the time since 1970 in s, ms, µs or ns; else the period that is asked for decides, else the unit is
the second, unless the steps contradict it.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Shaped

from treadline.core.errors import PeriodMismatch

IRREGULAR = 0.05
"""Largest relative deviation of a sampling interval from the period."""
WHOLE_STEP = 10.0
"""Step of whole numbers from which on they are hardly seconds: a logger's of 100 Hz in ms; tanks are logged each 1 to 4 s."""
_UNITS = {
    1.0: "s sec secs second seconds",
    1e3: "ms msec msecs millis millisecond milliseconds",
    1e6: "us µs μs usec usecs micros microsecond microseconds",
    1e9: "ns nsec nsecs nanosec nanosecs nanos nanosecond nanoseconds",
    1.0 / 60.0: "min minute minutes",
    1.0 / 3600.0: "h hour hours",
}
_PER_SECOND = {word: ticks for ticks, words in _UNITS.items() for word in words.split()}
_TIMES = {"t", "ts", "time", "timestamp", "datetime", "stamp", "elapsed", "epoch", "zeit", "zeitstempel", "temps", "tiempo"}
_OF_TIMES = {*_TIMES, "header", "date", "unix", "utc", "ros", "rosbag", "log", "sim", "system", "relative"}
_SECONDS, _NANOSECONDS = {"sec", "secs", "seconds"}, {"nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"}
"""Units of two columns that are added."""
_PERIODS = {"ts", "dt", "dts", "period", "periods", "sampletime", "samplingtime", "samplingperiod", "samplinginterval"}
_FREQUENCIES = {"fs", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency"}
_SINCE_1970 = 1e9, 1e10
"""Seconds since 1970 from 2001 to 2286: the times with ten digits."""

Times = Float64[np.ndarray, " n"]
"""Times [s]."""
Ticks = Shaped[np.ndarray, " n"]
"""Times in the unit of a clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeColumn:
    """Time column of a log, or its two columns of seconds and nanoseconds."""

    columns: tuple[str, ...]
    per_s: float | None = None
    """Ticks per second; None if the name does not say."""

    @property
    def name(self) -> str:
        """Name for error messages."""
        return " and ".join(self.columns)


def clocks_of(there: Iterable[str], wanted: Iterable[str] = ()) -> list[TimeColumn]:
    """Return the columns that their names make a clock, the plainest name first."""
    words = {name: words_of(name) or [""] for name in there if name not in set(wanted) and name != "T"}  # a temperature
    found = [(len(said), clock) for name in words for said, clock in [_clock(name, words)] if clock is not None]
    return [clock for _, clock in sorted(found, key=lambda item: item[0])]


def _clock(name: str, words: dict[str, list[str]]) -> tuple[list[str], TimeColumn | None]:
    """Return the words of a name without its unit, and the clock that it is."""
    *said, last = words[name]
    if last in _SECONDS:
        fine = next((other for other, (*before, unit) in words.items() if before == said and unit in _NANOSECONDS), None)
        if fine is not None:
            return said, TimeColumn(columns=(name, fine), per_s=1e9)
    per_s = _PER_SECOND.get(last)
    said = words[name] if per_s is None else said
    is_time = _OF_TIMES.issuperset(said) and not _TIMES.isdisjoint(said)
    if is_time or said[-2:] == ["header", "stamp"] or (per_s and not said and len(last) > len("min")):
        return said, TimeColumn(columns=(name,), per_s=per_s)
    return said, None


def words_of(name: str) -> list[str]:
    """Return the words of a name, in lower case."""
    return re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold())


def period_in(name: str, value: float) -> float | None:
    """Return the sampling period that a single number of that name states, or None."""
    word = "".join(words_of(name.rpartition(".")[2]))
    return value if word in _PERIODS else 1.0 / value if word in _FREQUENCIES and value else None


class Seconds:
    """Times of a log in seconds, block after block."""

    def __init__(self, file: Path, clock: TimeColumn, period_s: float | None) -> None:
        self._file, self.clock = file, clock
        self._period_s = period_s
        self._per_s = None if clock.per_s == 1.0 else clock.per_s  # seconds are the word for any unit, which the numbers confirm
        self._origin: int | None = None

    def of(self, columns: Sequence[Ticks]) -> Times:
        """Return the times in the columns of the clock; whole numbers count from the first of the log, as a float rounds them."""
        exact = [column.astype(np.int64 if column.dtype.kind in "iu" else float) for column in columns]
        ticks = exact[0] if len(exact) == 1 else 1_000_000_000 * exact[0] + exact[1]
        if self._per_s is None:
            self._per_s = self._ticks_per_second(ticks)
        if ticks.dtype.kind != "i":
            return ticks / self._per_s
        if self._origin is None:
            self._origin = int(ticks[0])
        return (ticks - self._origin) / self._per_s

    def _ticks_per_second(self, ticks: Ticks) -> float:
        """Return the unit of a clock: by the digits of a time since 1970, by the period that is given, or seconds.

        Loggers write finer units as whole numbers, and seconds with decimals unless the period is a whole number of seconds. A long
        one has to be given.

        Raises:
            PeriodMismatch: If all times are whole numbers, ten or more apart, and no period was given.
        """
        first, last, step = float(ticks[0]), float(ticks[-1]), float(np.median(np.diff(ticks))) if len(ticks) > 1 else 0.0
        units = [per_s for per_s in _UNITS if per_s >= 1.0]
        low, high = _SINCE_1970
        since = [per_s for per_s in units if low <= first / per_s and last / per_s < high]
        given, period_s = [], self._period_s
        if period_s is not None:
            given = [per_s for per_s in units if abs(step / per_s - period_s) <= IRREGULAR * period_s]
        elif not since and step >= WHOLE_STEP and not np.mod(ticks, 1).any():
            finer = next(per_s for per_s in units if step / per_s <= 1.0 or per_s == units[-1])
            raise PeriodMismatch(
                f"{self._file}: column '{self.clock.name}' steps by {step:g} s; if it counts {_UNITS[finer].split()[-1]}, give "
                f"--period {step / finer:g} or name it t_{_UNITS[finer].split()[0]}; if seconds, give --period {step:g}"
            )
        return next(iter([*since, *given]), 1.0)
