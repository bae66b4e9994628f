"""Records larger than the memory: consecutive chunks of one experiment, checked like a whole record.

Each chunk continues the previous one; time must increase with the same period across the border. The fraction of rows with NaN is
known at the end only: too many of them raise an error after the last chunk.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.models import InputOutputRecord
from treadline.io.records import file_of, joined, open_log
from treadline.io.resample import MOST_ROWS, Times, period_of, places_of, spread, uneven
from treadline.io.tables import Log, Table, check_gaps, check_period, check_values, no_clock

ROWS = 262_144
"""Default number of rows per chunk: 10 MB with five columns."""


def read_chunks(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    rows: int = ROWS,
    period_s: float | None = None,
    allow_gaps: bool = False,
) -> "ChunkReader":
    """Return an iterator over the chunks of a CSV or Parquet file; its ``fraction`` is the progress.

    Args:
        rows: Largest number of rows per chunk; without missing rows, all chunks but the last have this length.
        period_s: Sampling period; by default the median step of the first chunk.
        allow_gaps: Accept rows with NaN, and missing rows if all times lie on the grid of the period: missing rows become rows of
            NaN, in separate chunks for long gaps.

    Raises:
        RecordError: During iteration, with file, line and column.
        PeriodMismatch: If the time axis is irregular: a stream is not resampled.
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
    """Iterable over the chunks of one experiment, in order; a second iteration starts from the beginning."""

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
        """Fraction of the file read so far."""
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
        """Return the grid indices of the rows if rows are missing between them, else None."""
        error = uneven(table, t_s, period_s, before_s, remedy="read it whole: a stream is not resampled")
        if error is None:
            return None
        places = places_of(t_s, period_s, before_s) if self._allow_gaps else None
        # A single wrong time stamp would otherwise produce rows of NaN for days.
        if places is None or places[-1] > MOST_ROWS:
            raise error
        return places


def _of_length(tables: Iterable[Table], rows: int) -> Iterator[Table]:
    """Yield the same rows in tables of equal length; the last can be shorter."""
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
