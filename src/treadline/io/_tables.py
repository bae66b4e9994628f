"""Tables: requested columns of a log with their clock, the checks common to all formats, and the sampling grid of the clock.

A log of any format becomes one table or several consecutive tables, and ``records`` turns tables into records. Inputs are resampled
by sample-and-hold, as they acted; outputs by linear interpolation. If rows are missing and the others lie on the grid, the missing
rows become rows of NaN instead of interpolated values.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Shaped

from treadline.core.arrays import LARGEST
from treadline.core.errors import LogFormatError, NotFinite, PeriodMismatch, RecordError, closest
from treadline.core.state_space import GAP_SHARE, UNWRAPPED
from treadline.io._clock import IRREGULAR, Seconds, Ticks, Times, clocks_of, words_of

MOST_NAMED = 12
"""Largest number of names listed in an error message."""
LONGEST_NAME = 80
"""Largest number of characters of a name in an error message."""
MAX_BYTES = 1024**3
"""Largest size of what is unpacked from a file [bytes]."""
MOST_ROWS = 10_000_000
"""Largest number of resampled rows: four weeks at 4 Hz; a single wrong time stamp would require more."""
RESAMPLE = "pass --resample"
"""Default remedy in error messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of one file, or of a part of a file."""

    file: Path
    names: tuple[str, ...]
    values: Float64[np.ndarray, "n k"]
    clock: str | None
    """Name of the clock column."""
    t_s: Float64[np.ndarray, " n"] | None
    """Time of each row [s]."""
    marks: Shaped[np.ndarray, " n"]
    """Line or row number of each row for error messages; an array, because a stream does not keep earlier rows."""
    spot: str = ": row {}"
    """Format of a row's location in error messages."""
    header: tuple[str, ...] = ()
    """All column names of the file; empty for formats without a header."""
    widths: tuple[int, ...] = ()
    """Number of columns of each name asked for, where a matrix has several; empty: one each."""
    period_s: float | None = None
    """Period that the file states."""

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def columns_of(self, names: int) -> int:
        """Return the number of columns of the first names asked for."""
        return sum(self.widths[:names]) if self.widths else names

    def where(self, k: int) -> str:
        """Return the location of a row: file and line, or file and row."""
        return f"{self.file}{self.spot.format(self.marks[k])}"


class Log:
    """File open for streaming: an iterable of consecutive tables of the requested columns."""

    def __init__(self, file: Path, wanted: tuple[str, ...], period_s: float | None) -> None:
        self._file = file
        self._wanted = wanted
        self._period_s = period_s
        self._size, self._done = 1, 0

    def __iter__(self) -> Iterator[Table]:
        """Yield the tables in the order of the rows."""
        raise NotImplementedError

    def _table(
        self, values: Float64[np.ndarray, "n k"], seconds: Seconds | None, ticks: list[Ticks], marks: np.ndarray, **more: Any
    ) -> Table:
        """Return the next table of the file."""
        clock, t_s = (None, None) if seconds is None else (seconds.clock.name, seconds.of(ticks))
        return Table(file=self._file, names=self._wanted, values=values, clock=clock, t_s=t_s, marks=marks, **more)

    @property
    def fraction(self) -> float:
        """Fraction of the file read so far."""
        return self._done / self._size


MOST_LETTERS = 200
"""Longest name of a column, in any kind of file: a longer one is no header, and would be searched and printed."""


def place_of(file: Path, name: str, there: Sequence[str]) -> int:
    """Return the place of a column: by its name, less exactly if only one is so named, or by its number from 0.

    Raises:
        LogFormatError: If there is none, or several.
    """
    if (longest := max(map(len, there), default=0)) > MOST_LETTERS:
        raise LogFormatError(f"{file}: a column's name has {longest} characters; {MOST_LETTERS} at most. Is its line a header?")
    alike = alike_of(name, there)
    if len(alike) == 1:
        return alike[0]
    if not alike and name.isdecimal() and int(name) < len(there):
        return int(name)
    if not alike:
        raise missing(file, name, there)
    first, second = (there[place] for place in alike[:2])
    if first == second:
        raise LogFormatError(f"{file}: column '{first}' occurs twice; rename one, or give the number of the column ({alike[0]})")
    raise LogFormatError(f"{file}: '{name}' may be '{first}' or '{second}'; give the whole name")


def alike_of(name: str, there: Sequence[str]) -> list[int]:
    """Return the places of the columns that a name may mean: the exact ones, else those of its words, without unit or path."""
    for key in (str, words_of, lambda each: words_of(_bare(each))):
        meant = key(name)
        alike = [k for k, other in enumerate(there) if key(other) == meant != []]
        if alike:
            return alike
    ends = tuple(mark + _bare(name).casefold() for mark in "/.")
    return [k for k, other in enumerate(there) if _bare(other).casefold().endswith(ends)]


def _bare(name: str) -> str:
    """Return a name without a unit in brackets; a number in brackets is an element."""
    name = name.strip()
    alike = name.replace("(", "[").replace(")", "]")
    begins = alike.find("[", alike.rfind("]", 0, -1) + 1)
    if begins < 0 or not alike.endswith("]") or alike[begins + 1 : -1].isdecimal():
        return name
    return name[:begins].rstrip()


def missing(file: Path, name: str, there: Iterable[str]) -> LogFormatError:
    """Return the error for a column missing in the file."""
    meant = closest(name, there)
    hint = "name columns with --inputs and --outputs" if meant is None else f"did you mean '{meant}'?"
    return LogFormatError(f"{file}: no column '{name}' (there are: {listed(there)}); {hint}")


def no_clock(table: Table) -> PeriodMismatch:
    """Return the error for a table without a time column."""
    given = next(iter(clocks_of(table.names)), None)
    if given is not None:
        return PeriodMismatch(
            f"{table.file}: column '{given.name}' is the time: leave it out of --inputs and --outputs, or give --period"
        )
    there = f" (there are: {listed(table.header)})" if table.header else ""
    return PeriodMismatch(f"{table.file}: no time column{there}; give --period, or name the time t_s, time_ms, t [us] or time_ns")


def listed(names: Iterable[str], most: int = MOST_NAMED) -> str:
    """Return names as a list of limited length on one line."""
    every = [" ".join(name.split())[:LONGEST_NAME] for name in names]
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return (", ".join(every[:most]) + more) if every else "none"


def check_count(file: Path, rows: int) -> None:
    """Reject a table too short to have a period."""
    if rows < 2:
        raise LogFormatError(f"{file}: {rows} rows of data; at least two rows are needed")


def check_period(period_s: float | None) -> None:
    """Reject a period that is not a positive finite number."""
    if period_s is not None and not (math.isfinite(period_s) and period_s > 0.0):
        raise PeriodMismatch(f"--period is {period_s}; it must be positive")


def check_values(table: Table, *, allow_gaps: bool) -> None:
    """Reject Inf, NaN unless gaps are allowed, and columns in a wrong unit."""
    _check_finite(table, table.names, table.values, allow_gaps=allow_gaps)
    if table.t_s is not None:
        _check_finite(table, (str(table.clock),), table.t_s[:, None], allow_gaps=False, nan="repair the recording")
    for name, column in zip(table.names, table.values.T, strict=True):
        largest = float(np.nanmax(np.abs(column), initial=0.0))
        # An unwrapped angle exceeds π; only its name distinguishes it from an angle in degrees.
        if name.endswith("_rad") and not name.endswith(UNWRAPPED) and largest > math.pi:
            raise RecordError(
                f"{table.file}: column '{name}' reaches {largest:.1f}, beyond π: degrees? convert it to radians; the name of an "
                f"unwrapped angle ends in {UNWRAPPED}"
            )
        if name.endswith("_m_s") and largest > 50.0:
            raise RecordError(f"{table.file}: column '{name}' reaches {largest:.0f} m/s: millimetres? convert it to metres")


def check_gaps(file: Path, gaps: int, rows: int) -> None:
    """Reject a record with too many gaps."""
    if gaps > GAP_SHARE * rows:
        raise NotFinite(
            f"{file}: {gaps / rows:.0%} of the rows hold NaN or are missing; at most {GAP_SHARE:.0%} may: repair the recording"
        )


def _check_finite(
    table: Table,
    names: tuple[str, ...],
    values: Float[np.ndarray, "n k"],
    *,
    allow_gaps: bool,
    nan: str = "pass --allow-gaps, which leaves out the windows with NaN",
) -> None:
    size = np.abs(values)
    is_bad = ~(size <= LARGEST) & ~(np.isnan(size) & allow_gaps)
    if is_bad.any():
        i, j = np.argwhere(is_bad)[0].tolist()
        word = "NaN" if np.isnan(size[i, j]) else "Inf" if np.isinf(size[i, j]) else f"a number beyond {LARGEST:.0e}"
        raise NotFinite(f"{table.where(i)}: column '{names[j]}' holds {word}; {nan if word == 'NaN' else 'repair the recording'}")


def period_of(table: Table, t_s: Times, period_s: float | None, before_s: float | None = None) -> float:
    """Return the requested period, or the median step, rounded as far as the rounding of the stamps allows; time must increase.

    Args:
        t_s: Times of the table.
        before_s: Time of the row before the table, if the table continues another one.
    """
    steps = _steps(t_s, before_s)
    back = np.flatnonzero(steps <= 0.0)
    if back.size:
        where = table.where(int(back[0]) + (before_s is None))
        raise RecordError(f"{where}: column '{table.clock}' does not increase; cut the recording there, or remove repeated rows")
    if period_s is not None:
        return period_s
    # Each stamp is rounded by half the spacing of floats, which is at most twice that of the median stamp in an even record.
    return shortest_decimal(float(np.median(steps)), 2.0 * float(np.spacing(np.median(np.abs(t_s)))))


def shortest_decimal(value: float, uncertainty: float) -> float:
    """Return the decimal number of the fewest digits within the uncertainty: 0.05 for the difference of two rounded stamps."""
    candidates = (float(f"{value:.{digits}g}") for digits in range(1, 17))
    return next((number for number in candidates if abs(number - value) <= uncertainty), value)


def uneven(
    table: Table, t_s: Times, period_s: float, before_s: float | None = None, *, remedy: str = RESAMPLE
) -> PeriodMismatch | None:
    """Return the error for the first step that differs from the period, or None."""
    steps = _steps(t_s, before_s)
    off = np.flatnonzero(np.abs(steps - period_s) > IRREGULAR * period_s)
    if not off.size:
        return None
    k = int(off[0])
    places = places_of(t_s, period_s, before_s)
    # The fraction of missing rows of a stream is unknown before its end.
    if places is not None and (before_s is not None or len(t_s) >= (1.0 - GAP_SHARE) * (places[-1] + 1.0)):
        remedy = f"if rows are missing, pass --allow-gaps, else {remedy.removeprefix('pass ')}"
    return PeriodMismatch(
        f"{table.where(k + (before_s is None))}: a step of {steps[k]:.4g} s where the period is {period_s:.4g} s; {remedy}"
    )


def spread(values: Float64[np.ndarray, "n c"], places: Times, rows: int) -> Iterator[Float64[np.ndarray, "_ c"]]:
    """Yield rows at their places with rows of NaN between them, in parts of at most ``rows`` rows."""
    total = int(places[-1]) + 1
    for start in range(0, total, rows):
        part = np.full((min(rows, total - start), values.shape[1]), np.nan)
        first, last = np.searchsorted(places, (start, start + len(part))).tolist()
        part[places[first:last].astype(int) - start] = values[first:last]
        yield part


def places_of(t_s: Times, period_s: float, before_s: float | None = None) -> Times | None:
    """Return the index of each row on the sampling grid, or None if a step is not a multiple of the period.

    Args:
        before_s: Time of the row before the first, from which indices are counted; without it the first row has index 0.
    """
    steps = _steps(t_s, before_s) / period_s
    whole = np.rint(steps)
    # The negated form also catches NaN from an overflow, which fails every comparison.
    if not ((np.abs(steps - whole) <= IRREGULAR) & (whole >= 1.0)).all():
        return None
    return np.concatenate([[0.0], np.cumsum(whole)]) if before_s is None else np.cumsum(whole) - 1.0


def resampled(table: Table, inputs: int, period_s: float | None, *, allow_gaps: bool) -> Table:
    """Return a table whose times are uneven on the sampling grid: the inputs by sample-and-hold, the outputs interpolated."""
    check_values(table, allow_gaps=allow_gaps)
    t_s = np.empty(0) if table.t_s is None else table.t_s
    period_s = period_of(table, t_s, period_s)
    # Steps within the tolerance may still add up to another number of periods, if all of them are longer or shorter.
    if uneven(table, t_s, period_s) is None and abs(t_s[-1] - t_s[0] - period_s * (len(t_s) - 1)) <= 0.5 * period_s:
        return table
    grid = t_s[0] + period_s * np.arange(rows_of(str(table.file), t_s[0], t_s[-1], period_s))
    values, m = np.empty((len(grid), len(table.names))), table.columns_of(inputs)
    for j, column in enumerate(table.values.T):
        values[:, j] = held(grid + 1e-9 * period_s, t_s, column) if j < m else np.interp(grid, t_s, column)
    return replace(table, values=values, t_s=None, period_s=period_s, marks=np.arange(len(grid)))


def held(grid: Float64[np.ndarray, " k"], times: Times, values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " k"]:
    """Return the last value at or before each grid point."""
    return values[np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(times) - 1)]


def rows_of(what: str, first: float, last: float, period: float) -> int:
    """Return the number of points of a grid; times and period in the same unit."""
    count = (last - first) / period + 1.0
    if not count <= MOST_ROWS:
        raise RecordError(f"{what}: {count:.3g} rows at that period; at most {MOST_ROWS} are made: give a longer --period")
    return int(count)


def _steps(t_s: Times, before_s: float | None) -> Float64[np.ndarray, " k"]:
    return np.diff(t_s) if before_s is None else np.diff(t_s, prepend=before_s)
