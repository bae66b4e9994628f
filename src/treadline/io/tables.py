"""Tables: the wanted columns of a log side by side, with its clock, and the checks that hold for every format.

A log of any format becomes one table or several that follow one another; ``records`` and ``chunks`` make records of them.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64, Shaped

from treadline.errors import LogFormatError, NotFinite, PeriodMismatch, RecordError

SECONDS = ("t_s", "t", "time")
NANOSECONDS = ("t_ns", "timestamp_ns")
UNWRAPPED = "_unwrapped_rad"
"""What the name of an angle ends in that may pass π."""
MOST_GAPS = 0.2
"""Largest share of rows with NaN."""
MOST_NAMED = 12
"""Names that an error lists before it says how many more there are."""
LONGEST_NAME = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of one file, or of a part of it."""

    file: Path
    names: tuple[str, ...]
    values: Float64[np.ndarray, "n k"]
    clock: str | None
    """Name of the column that told the time."""
    t_s: Float64[np.ndarray, " n"] | None
    marks: Shaped[np.ndarray, " n"]
    """What each row is called in an error: its line or its number; data and not a function, for a stream may not remember."""
    spot: str = ": row {}"
    header: tuple[str, ...] = ()
    """All columns of the file, where it has a header."""

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def where(self, k: int) -> str:
        """Return where a row stands: file and line, or file and row."""
        return f"{self.file}{self.spot.format(self.marks[k])}"


@runtime_checkable
class Log(Protocol):
    """A file open for reading: tables one after the other."""

    def __iter__(self) -> Iterator[Table]:
        """Yield the tables in the order of the rows."""

    @property
    def fraction(self) -> float:
        """Share of the file that has been read."""


def clock_of(there: Sequence[str], wanted: Sequence[str]) -> str | None:
    """Return the column that tells the time: ``t_s``, ``t``, ``time`` in seconds, ``t_ns``, ``timestamp_ns`` in nanoseconds."""
    return next((name for name in (*SECONDS, *NANOSECONDS) if name in there and name not in wanted), None)


def seconds_of(ticks: Shaped[np.ndarray, " n"], origin: int) -> Float64[np.ndarray, " n"]:
    """Return a clock in seconds; whole numbers are nanoseconds and count from the origin: since 1970 a float rounds them."""
    return (ticks - origin) / 1e9 if ticks.dtype.kind == "i" else ticks.astype(float)


def missing(file: Path, name: str, there: Iterable[str]) -> LogFormatError:
    """Return the error for a column that the file does not have."""
    return LogFormatError(f"{file}: no column '{name}' (there are: {listed(there)})")


def no_clock(table: Table) -> PeriodMismatch:
    """Return the error for a table whose rows nothing tells the time of."""
    given = next((name for name in table.names if name in (*SECONDS, *NANOSECONDS)), None)
    if given is not None:
        return PeriodMismatch(
            f"{table.file}: column '{given}' is the time: leave it out of --inputs and --outputs, or give --period"
        )
    there = f" (there are: {listed(table.header)})" if table.header else ""
    return PeriodMismatch(
        f"{table.file}: no column '{SECONDS[0]}'{there}; give --period, or name the time in seconds {' or '.join(SECONDS)}, in "
        f"nanoseconds {' or '.join(NANOSECONDS)}"
    )


def listed(names: Iterable[str]) -> str:
    """Return names as a list of bearable length, on one line whatever a file calls its columns."""
    every = [" ".join(name.split())[:LONGEST_NAME] for name in names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return (", ".join(every[:MOST_NAMED]) + more) if every else "none"


def check_count(file: Path, rows: int) -> None:
    """Refuse what is too short to have a period."""
    if rows < 2:
        raise LogFormatError(f"{file}: {rows} rows of data; at least two rows are needed")


def check_period(period_s: float | None) -> None:
    """Refuse a period that is no time."""
    if period_s is not None and not (math.isfinite(period_s) and period_s > 0.0):
        raise PeriodMismatch(f"--period is {period_s}; it must be positive")


def check_values(table: Table, *, allow_gaps: bool) -> None:
    """Refuse Inf, NaN unless gaps are allowed, and columns in the wrong unit."""
    _check_finite(table, table.names, table.values, allow_gaps=allow_gaps)
    if table.t_s is not None:
        _check_finite(table, (str(table.clock),), table.t_s[:, None], allow_gaps=False, nan="mend the recording")
    for name, column in zip(table.names, table.values.T, strict=True):
        largest = float(np.nanmax(np.abs(column), initial=0.0))
        # An angle that was unwrapped passes π; only its name tells it from degrees, which move as smoothly.
        if name.endswith("_rad") and not name.endswith(UNWRAPPED) and largest > math.pi:
            raise RecordError(
                f"{table.file}: column '{name}' reaches {largest:.1f}, beyond π: degrees? convert it to radians; an angle "
                f"that was unwrapped is called …{UNWRAPPED}"
            )
        if name.endswith("_m_s") and largest > 50.0:
            raise RecordError(f"{table.file}: column '{name}' reaches {largest:.0f} m/s: millimetres? convert it to metres")


def gaps_in(table: Table) -> int:
    """Return the number of rows with NaN."""
    return int(np.isnan(table.values).any(axis=1).sum())


def check_gaps(file: Path, gaps: int, rows: int) -> None:
    """Refuse a record that is mostly holes."""
    if gaps > MOST_GAPS * rows:
        raise NotFinite(
            f"{file}: {gaps / rows:.0%} of the rows hold NaN or are missing; at most {MOST_GAPS:.0%} may: mend the recording"
        )


def _check_finite(
    table: Table,
    names: tuple[str, ...],
    values: Float[np.ndarray, "n k"],
    *,
    allow_gaps: bool,
    nan: str = "pass --allow-gaps, which leaves out what looks back on it",
) -> None:
    if np.isfinite(values).all():
        return
    for test, word, remedy in (
        (np.isinf, "Inf", "mend the recording"),
        (np.isnan, "NaN", nan),
    ):
        bad = np.argwhere(test(values))
        if bad.size and not (word == "NaN" and allow_gaps):
            i, j = bad[0].tolist()
            raise NotFinite(f"{table.where(i)}: column '{names[j]}' holds {word}; {remedy}")
