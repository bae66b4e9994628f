"""Parquet and Feather files, read in batches by pyarrow (the extra ``parquet``)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from treadline.core.arrays import BLOCK_ROWS
from treadline.core.errors import LogFormatError
from treadline.io._clock import Seconds, Ticks, TimeColumn, clocks_of
from treadline.io._tables import Log, Table, check_count, place_of


class ArrowLog(Log):
    """Streaming reader of the requested columns of a Parquet or Feather file."""

    def __iter__(self) -> Iterator[Table]:
        try:
            from pyarrow import ArrowException
        except ImportError:
            raise LogFormatError(
                f"{self._file}: it needs pyarrow: pip install '.[parquet]' in treadline's folder, or save it as CSV"
            ) from None
        try:
            yield from self._tables()
        except (ArrowException, OSError, ValueError, MemoryError) as error:
            kind = self._file.suffix[1:].capitalize()
            raise LogFormatError(f"{self._file}: not a valid {kind} file: {str(error).splitlines()[0]}") from None

    def _tables(self) -> Iterator[Table]:
        data = _dataset(self._file)
        there = data.schema.names
        names = [there[place_of(self._file, name, there)] for name in self._wanted]
        clock = _clock(data.schema, names)
        ticking = () if clock is None else clock.columns
        seconds = None if clock is None else Seconds(self._file, clock, self._period_s)
        self._size, self._done = max(data.count_rows(), 1), 0
        columns = list(dict.fromkeys([*names, *ticking]))
        for batch in data.to_batches(columns=columns, batch_size=BLOCK_ROWS, use_threads=False, batch_readahead=0):
            batch.validate(full=True)
            values = np.empty((len(batch), len(names)))
            for j, name in enumerate(names):
                values[:, j] = _numbers(self._file, name, batch.column(name))
            ticks = [_ticks(self._file, name, batch.column(name)) for name in ticking]
            first, self._done = self._done, self._done + len(batch)
            if len(batch):
                yield self._table(values, seconds, ticks, np.arange(first + 1, self._done + 1), header=tuple(there))
        check_count(self._file, self._done)


def _dataset(file: Path) -> Any:
    from pyarrow import dataset

    if file.suffix.lower() != ".parquet":
        return dataset.dataset(file, format="feather")
    # pre_buffer would keep all batches in memory until the end.
    scan = dataset.ParquetFragmentScanOptions(page_checksum_verification=True, pre_buffer=False)
    return dataset.dataset(file, format=dataset.ParquetFileFormat(default_fragment_scan_options=scan))


def _clock(schema: Any, wanted: list[str]) -> TimeColumn | None:
    """Return the clock by the names, else the only column of times."""
    from pyarrow import types

    times = [field.name for field in schema if types.is_temporal(field.type) and field.name not in wanted]
    clock = next(iter(clocks_of(schema.names, wanted)), TimeColumn(columns=tuple(times)) if len(times) == 1 else None)
    return replace(clock, per_s=1e9) if clock is not None and clock.columns[0] in times else clock


def _numbers(file: Path, name: str, column: Any) -> Float64[np.ndarray, " n"]:
    """Return a column as floats; a null is NaN."""
    from pyarrow import types

    kind = column.type
    if not (types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)):
        raise LogFormatError(f"{file}: column '{name}' holds {kind}, not numbers")
    values: Float64[np.ndarray, " n"] = column.cast("float64", safe=False).to_numpy(zero_copy_only=False)
    return values


def _ticks(file: Path, name: str, column: Any) -> Ticks:
    """Return a column of the clock; times as whole nanoseconds."""
    from pyarrow import duration, timestamp, types

    kind = column.type
    if column.null_count or types.is_floating(kind) or types.is_decimal(kind):
        return _numbers(file, name, column)
    if types.is_timestamp(kind):
        column = column.cast(timestamp("ns", kind.tz))
    elif types.is_duration(kind):
        column = column.cast(duration("ns"))
    elif not types.is_integer(kind):
        raise LogFormatError(f"{file}: column '{name}' holds {kind}, not a time")
    ticks: Ticks = column.cast("int64").to_numpy(zero_copy_only=False)
    return ticks
