"""Parquet files, read in batches by pyarrow (the extra ``parquet``)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Shaped

from treadline.core.errors import LogFormatError
from treadline.io._tables import NANOSECONDS, Log, Table, check_count, clock_of, missing, seconds_of

BATCH_ROWS = 65_536
"""Rows per batch."""


class ParquetLog(Log):
    """Streaming reader of the requested columns of a Parquet file."""

    def __iter__(self) -> Iterator[Table]:
        try:
            from pyarrow import ArrowException, parquet
        except ImportError:
            raise LogFormatError(
                f"{self._file}: Parquet needs pyarrow: pip install '.[parquet]' in treadline's folder, or save it as CSV"
            ) from None
        try:
            # pre_buffer would keep all batches in memory until the end.
            with parquet.ParquetFile(self._file, page_checksum_verification=True, pre_buffer=False) as file:
                yield from self._tables(file)
        except (ArrowException, OSError, ValueError, MemoryError) as error:
            raise LogFormatError(f"{self._file}: not a valid Parquet file: {str(error).splitlines()[0]}") from None

    def _tables(self, file: Any) -> Iterator[Table]:
        there = file.schema_arrow.names
        doubled = sorted({name for name in self._wanted if there.count(name) > 1})
        if doubled:
            raise LogFormatError(f"{self._file}: column '{doubled[0]}' occurs twice; rename one of the two")
        for name in self._wanted:
            if name not in there:
                raise missing(self._file, name, there)
        clock = clock_of(there, self._wanted)
        columns = [*self._wanted, *([clock] if clock else [])]
        self._size, self._done, origin = max(file.metadata.num_rows, 1), 0, 0
        for batch in file.iter_batches(BATCH_ROWS, columns=list(dict.fromkeys(columns)), use_threads=False):
            values = np.empty((len(batch), len(self._wanted)))
            for j, name in enumerate(self._wanted):
                values[:, j] = _numbers(self._file, name, batch.column(name))
            ticks = None if clock is None else _ticks(self._file, clock, batch.column(clock))
            if ticks is not None and ticks.dtype.kind == "i" and self._done == 0:
                origin = int(ticks[0])
            first = self._done
            self._done += len(batch)
            yield Table(
                file=self._file,
                names=self._wanted,
                values=values,
                clock=clock,
                t_s=None if ticks is None else seconds_of(ticks, origin),
                marks=np.arange(first + 1, self._done + 1),
            )
        check_count(self._file, self._done)


def _numbers(file: Path, name: str, column: Any) -> Float64[np.ndarray, " n"]:
    """Return a column as floats; a null is NaN."""
    from pyarrow import types

    kind = column.type
    if not (types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)):
        raise LogFormatError(f"{file}: column '{name}' holds {kind}, not numbers")
    values: Float64[np.ndarray, " n"] = column.cast("float64", safe=False).to_numpy(zero_copy_only=False)
    return values


def _ticks(file: Path, clock: str, column: Any) -> Shaped[np.ndarray, " n"]:
    """Return the clock column: seconds as floats, or nanoseconds as integers."""
    from pyarrow import timestamp, types

    is_stamp = types.is_timestamp(column.type)
    if not is_stamp and clock not in NANOSECONDS:
        return _numbers(file, clock, column)
    if column.null_count or not (is_stamp or types.is_integer(column.type)):
        raise LogFormatError(
            f"{file}: column '{clock}' holds {column.type} with {column.null_count} nulls; whole numbers are needed"
        )
    stamps = column.cast(timestamp("ns", column.type.tz)) if is_stamp else column
    ticks: Shaped[np.ndarray, " n"] = stamps.cast("int64").to_numpy(zero_copy_only=False)
    return ticks
