"""Tables: requested columns of a log with their clock, and the checks common to all formats.

A log of any format becomes one table or several consecutive tables; ``records`` and ``chunks`` turn tables into records.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64, Shaped

from treadline.core.errors import LogFormatError, NotFinite, PeriodMismatch, RecordError

SECONDS = ("t_s", "t", "time")
"""Names of clock columns in seconds."""
NANOSECONDS = ("t_ns", "timestamp_ns")
"""Names of clock columns in nanoseconds."""
TIMESTAMPS = ("timestamp", "datetime")
"""Names of clock columns in ISO 8601 text, in addition to the names in seconds."""
UNWRAPPED = "_unwrapped_rad"
"""Name suffix of unwrapped angles, which may exceed π."""
MOST_GAPS = 0.2
"""Largest accepted fraction of rows with NaN."""
MOST_NAMED = 12
"""Largest number of names listed in an error message."""
LONGEST_NAME = 80
"""Largest number of characters of a name in an error message."""


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

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def where(self, k: int) -> str:
        """Return the location of a row: file and line, or file and row."""
        return f"{self.file}{self.spot.format(self.marks[k])}"


@runtime_checkable
class Log(Protocol):
    """File open for streaming: an iterable of consecutive tables."""

    def __iter__(self) -> Iterator[Table]:
        """Yield the tables in the order of the rows."""

    @property
    def fraction(self) -> float:
        """Fraction of the file read so far."""


def clock_of(there: Sequence[str], wanted: Sequence[str]) -> str | None:
    """Return the clock column: ``t_s``, ``t``, ``time`` in seconds, ``t_ns``, ``timestamp_ns`` in nanoseconds."""
    return next((name for name in (*SECONDS, *NANOSECONDS) if name in there and name not in wanted), None)


def seconds_of(ticks: Shaped[np.ndarray, " n"], origin: int) -> Float64[np.ndarray, " n"]:
    """Return a clock in seconds; integers are nanoseconds, counted from the origin because a float rounds the time since 1970."""
    return (ticks - origin) / 1e9 if ticks.dtype.kind == "i" else ticks.astype(float)


def missing(file: Path, name: str, there: Iterable[str]) -> LogFormatError:
    """Return the error for a column missing in the file."""
    return LogFormatError(f"{file}: no column '{name}' (there are: {listed(there)}); name columns with --inputs and --outputs")


def no_clock(table: Table) -> PeriodMismatch:
    """Return the error for a table without a clock column."""
    given = next((name for name in table.names if name in (*SECONDS, *NANOSECONDS)), None)
    if given is not None:
        return PeriodMismatch(
            f"{table.file}: column '{given}' is the time: leave it out of --inputs and --outputs, or give --period"
        )
    there = f" (there are: {listed(table.header)})" if table.header else ""
    return PeriodMismatch(
        f"{table.file}: no column '{SECONDS[0]}'{there}; give --period, or name the time in seconds {' or '.join(SECONDS)}, in "
        f"nanoseconds {' or '.join(NANOSECONDS)}, in ISO 8601 text {' or '.join(TIMESTAMPS)}"
    )


def listed(names: Iterable[str]) -> str:
    """Return names as a list of limited length on one line."""
    every = [" ".join(name.split())[:LONGEST_NAME] for name in names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return (", ".join(every[:MOST_NAMED]) + more) if every else "none"


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


def gaps_in(table: Table) -> int:
    """Return the number of rows with NaN."""
    return int(np.isnan(table.values).any(axis=1).sum())


def check_gaps(file: Path, gaps: int, rows: int) -> None:
    """Reject a record with too many gaps."""
    if gaps > MOST_GAPS * rows:
        raise NotFinite(
            f"{file}: {gaps / rows:.0%} of the rows hold NaN or are missing; at most {MOST_GAPS:.0%} may: repair the recording"
        )


def _check_finite(
    table: Table,
    names: tuple[str, ...],
    values: Float[np.ndarray, "n k"],
    *,
    allow_gaps: bool,
    nan: str = "pass --allow-gaps, which leaves out the windows with NaN",
) -> None:
    if np.isfinite(values).all():
        return
    for test, word, remedy in (
        (np.isinf, "Inf", "repair the recording"),
        (np.isnan, "NaN", nan),
    ):
        bad = np.argwhere(test(values))
        if bad.size and not (word == "NaN" and allow_gaps):
            i, j = bad[0].tolist()
            raise NotFinite(f"{table.where(i)}: column '{names[j]}' holds {word}; {remedy}")
