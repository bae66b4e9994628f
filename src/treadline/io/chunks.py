"""Records longer than the memory: consecutive chunks of one experiment, each checked as a whole record would be.

A chunk starts where the one before it ended; time must increase and keep the period across the border too. The share of rows
with NaN is known at the end: too many of them are an error after the last chunk.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.errors import LogFormatError, SettingsError
from treadline.io.records import file_of, joined, open_log
from treadline.io.resample import MOST_ROWS, Times, period_of, places_of, spread, uneven
from treadline.io.tables import Log, Table, check_gaps, check_period, check_values, no_clock
from treadline.models import InputOutputRecord

ROWS = 262_144
"""Rows of a chunk: 10 MB of five columns."""


def read_chunks(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    rows: int = ROWS,
    period_s: float | None = None,
    allow_gaps: bool = False,
) -> "ChunkReader":
    """Return an iterator over the chunks of a CSV or Parquet file; its ``fraction`` says how far it has come.

    Args:
        rows: Rows of each chunk at most; where none are missing, of all but the last.
        period_s: Sampling period; the median step of the first chunk when left out.
        allow_gaps: Accept rows with NaN, and rows that are missing where all times lie on the grid of the period: those become
            rows of NaN, in chunks of their own where they are many.

    Raises:
        RecordError: While it is iterated, with file, line and column.
        PeriodMismatch: If time is irregular: a stream is not resampled.
    """
    check_period(period_s)
    if rows < 2:
        raise SettingsError(f"chunks of {rows} rows; a chunk needs two")
    file = file_of(path)
    log = open_log(file, (*inputs, *outputs))
    if log is None:
        raise LogFormatError(f"{file}: only CSV and Parquet are read in chunks; read it whole")
    return ChunkReader(log, inputs, outputs, rows, period_s, allow_gaps=allow_gaps)


class ChunkReader:
    """Chunks of one experiment, in order; iterating again starts again."""

    def __init__(
        self, log: Log, inputs: tuple[str, ...], outputs: tuple[str, ...], rows: int, period_s: float | None, *, allow_gaps: bool
    ) -> None:
        self._log = log
        self._names = inputs, outputs
        self._rows = rows
        self._period_s = period_s
        self._allow_gaps = allow_gaps

    @property
    def fraction(self) -> float:
        """Share of the file that has been read."""
        return self._log.fraction

    def __iter__(self) -> Iterator[InputOutputRecord]:
        inputs, outputs = self._names
        m = len(inputs)
        before_s, period_s = None, self._period_s
        gaps = rows = 0
        for table in _of_length(self._log, self._rows):
            check_values(table, allow_gaps=self._allow_gaps)
            places = None
            if table.t_s is not None:
                period_s = period_of(table, table.t_s, period_s, before_s)
                places = self._places(table, table.t_s, period_s, before_s)
                before_s = float(table.t_s[-1])
            if period_s is None:
                raise no_clock(table)
            for values in [table.values] if places is None else spread(table.values, places, self._rows):
                gaps += int(np.isnan(values).any(axis=1).sum())
                rows += len(values)
                yield InputOutputRecord(u=values[:, :m], y=values[:, m:], dt_s=period_s, input_names=inputs, output_names=outputs)
        if rows:
            check_gaps(table.file, gaps, rows)

    def _places(self, table: Table, t_s: Times, period_s: float, before_s: float | None) -> Times | None:
        """Return where the rows belong if some are missing between them, or None where each follows the one before."""
        error = uneven(table, t_s, period_s, before_s, remedy="read it whole: a stream is not resampled")
        if error is None:
            return None
        places = places_of(t_s, period_s, before_s) if self._allow_gaps else None
        # One wild time stamp would have nothing made for days.
        if places is None or places[-1] > MOST_ROWS:
            raise error
        return places


def _of_length(tables: Iterable[Table], rows: int) -> Iterator[Table]:
    """Yield the same rows in tables of one length; the last may be shorter."""
    waiting: list[Table] = []
    for table in tables:
        waiting.append(table)
        while sum(len(part) for part in waiting) >= rows:
            whole = joined(waiting)
            yield _part(whole, 0, rows)
            waiting = [_part(whole, rows, len(whole))]
    if waiting and sum(len(part) for part in waiting):
        yield joined(waiting)


def _part(table: Table, first: int, last: int) -> Table:
    t_s = None if table.t_s is None else table.t_s[first:last]
    return replace(table, values=table.values[first:last], t_s=t_s, marks=table.marks[first:last])
