"""Input-output records from logs of all supported formats, whole or in chunks.

The suffix selects the format: CSV (.csv, .txt, .tsv), NPZ, MAT, Parquet, MCAP, ROS bags; a folder is a run folder or a bag. Error
messages name the file and the location. Rows with NaN are rejected unless gaps are allowed; allowed gaps stay in the record, and
identification leaves out the windows that contain them.

Records larger than the memory are read as consecutive chunks of one experiment, checked like a whole record. Time must increase
with the same period across the border of two chunks. The fraction of rows with NaN is known at the end only: too many of them raise
an error after the last chunk.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.files import write_whole
from treadline.core.models import BAG_SUFFIXES, LOG_SUFFIXES, InputOutputRecord
from treadline.io._tables import (
    MOST_ROWS,
    RESAMPLE,
    Log,
    Table,
    check_gaps,
    check_period,
    check_values,
    no_clock,
    period_of,
    places_of,
    resampled,
    spread,
    uneven,
)
from treadline.io.runs import LOG, RECORD, chair_of_folder

TIME = "t_s"
"""Name of the time column of a record."""
DELIMITED = (".csv", ".txt", ".tsv", ".dat", ".gz")
"""Suffixes of delimited text files."""
ARROW = (".parquet", ".feather")
"""Suffixes of files that pyarrow reads."""


def read_record(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    period_s: float | None = None,
    resample: bool = False,
    allow_gaps: bool = False,
) -> InputOutputRecord:
    """Return the record in a file, a run folder or a bag.

    Args:
        inputs: Input columns. In MCAP files and bags ``topic.field``: ``/imu.angular_velocity.z``, ``/tracks.data[0]``.
        outputs: Output columns.
        period_s: Sampling period; by default the median step of the clock column (``treadline.io._clock``), or what an array
            file states as ``Ts`` or ``dt``.
        resample: Resample an irregular time axis to the period: inputs by sample-and-hold, outputs by linear interpolation.
            Channels of a bag have separate time axes and are always resampled.
        allow_gaps: Accept rows with NaN (an empty cell, ``nan``, or a pause in a channel of a bag), and missing rows if all times
            lie on the grid of the period: missing rows become rows of NaN.

    Raises:
        RecordError: With file, line and column.
        PeriodMismatch: If the time axis is irregular and ``resample`` is off.
    """
    check_period(period_s)
    file = _file_of(path)
    wanted = (*inputs, *outputs)
    if file.is_dir() or file.suffix.lower() in BAG_SUFFIXES:
        from treadline.io._bag_columns import read_bag

        try:
            table, period_s = read_bag(file, inputs, outputs, period_s)
        except LogFormatError as lacking:
            raise _of_a_run(path, lacking) from None
    else:
        table = _joined(list(_tables(file, wanted, period_s)))
    if resample and table.t_s is not None:
        table = resampled(table, len(inputs), period_s, allow_gaps=allow_gaps)
    (record,) = _chunks([table], len(inputs), MOST_ROWS, period_s, allow_gaps=allow_gaps)
    return replace(record, vehicle=_vehicle_of(file))


def _vehicle_of(file: Path) -> str:
    """Return the name of the vehicle that drove, by its run's manifest; empty where there is none, or the chair's file is gone."""
    with suppress(SettingsError):
        chair = chair_of_folder(file)
        return "" if chair is None else chair.name
    return ""


def write_record(path: Path, record: InputOutputRecord, first_t_s: float) -> None:
    """Write a record as CSV with full floating-point precision."""
    lines = [",".join((TIME, *record.input_names, *record.output_names))]
    for k in range(len(record)):
        row = (first_t_s + k * record.dt_s, *record.u[k].tolist(), *record.y[k].tolist())
        lines.append(",".join(repr(round(value, 9) if i == 0 else value) for i, value in enumerate(row)))
    write_whole(path, "\n".join(lines) + "\n")


class ChunkReader:
    """Iterable over the chunks of a CSV, Parquet or Feather file, one experiment, in order.

    A second iteration starts from the beginning.

    Args:
        rows: Largest number of rows per chunk, by default 10 MB with five columns; without missing rows, all chunks but the last
            have this length.
        period_s: Sampling period; by default the median step of the first chunk.
        allow_gaps: Accept rows with NaN, and missing rows if all times lie on the grid of the period: missing rows become rows of
            NaN, in separate chunks for long gaps.

    Raises:
        RecordError: During iteration, with file, line and column.
        PeriodMismatch: If the time axis is irregular: a stream is not resampled.
    """

    def __init__(
        self,
        path: Path,
        inputs: tuple[str, ...],
        outputs: tuple[str, ...],
        *,
        rows: int = 262_144,
        period_s: float | None = None,
        allow_gaps: bool = False,
    ) -> None:
        check_period(period_s)
        if rows < 2:
            raise SettingsError(f"chunks of {rows} rows; a chunk needs two")
        file = _file_of(path)
        log = _open_log(file, (*inputs, *outputs), period_s)
        if log is None:
            raise LogFormatError(f"{file}: only CSV, Parquet and Feather are read in chunks; read it whole")
        self._log, self._inputs, self._rows = log, len(inputs), rows
        self._period_s, self._allow_gaps = period_s, allow_gaps

    @property
    def fraction(self) -> float:
        """Fraction of the file read so far."""
        return self._log.fraction

    def __iter__(self) -> Iterator[InputOutputRecord]:
        tables = _of_length(self._log, self._rows)
        remedy = "read it whole: a stream is not resampled"
        return _chunks(tables, self._inputs, self._rows, self._period_s, allow_gaps=self._allow_gaps, remedy=remedy)


def _chunks(
    tables: Iterable[Table], inputs: int, rows: int, period_s: float | None, *, allow_gaps: bool, remedy: str = RESAMPLE
) -> Iterator[InputOutputRecord]:
    """Yield consecutive tables as records of at most ``rows`` rows, with rows of NaN where rows are missing."""
    before_s: float | None = None
    gaps = count = 0
    for table in tables:
        check_values(table, allow_gaps=allow_gaps)
        places, m = None, table.columns_of(inputs)
        if table.t_s is None:
            period_s = table.period_s if period_s is None else period_s
        else:
            period_s = period_of(table, table.t_s, period_s, before_s)
            error = uneven(table, table.t_s, period_s, before_s, remedy=remedy)
            if error is not None:
                places = places_of(table.t_s, period_s, before_s) if allow_gaps else None
                # A single wrong time stamp would otherwise produce rows of NaN for days.
                if places is None or places[-1] >= MOST_ROWS:
                    raise error
            before_s = float(table.t_s[-1])
        if period_s is None:
            raise no_clock(table)
        for values in [table.values] if places is None else spread(table.values, places, rows):
            gaps, count = gaps + int(np.isnan(values).any(axis=1).sum()), count + len(values)
            names = table.names
            yield InputOutputRecord(u=values[:, :m], y=values[:, m:], dt_s=period_s, input_names=names[:m], output_names=names[m:])
    if count:
        check_gaps(table.file, gaps, count)


def _of_length(tables: Iterable[Table], rows: int) -> Iterator[Table]:
    """Yield the same rows in tables of equal length; the last can be shorter."""
    waiting: list[Table] = []
    for table in tables:
        waiting.append(table)
        while sum(len(part) for part in waiting) >= rows:
            whole = _joined(waiting)
            yield _part(whole, 0, rows)
            waiting = [_part(whole, rows, len(whole))]
    if waiting and sum(len(part) for part in waiting):
        yield _joined(waiting)


def _part(table: Table, first: int, last: int) -> Table:
    t_s = None if table.t_s is None else table.t_s[first:last]
    return replace(table, values=table.values[first:last], t_s=t_s, marks=table.marks[first:last])


def _file_of(path: Path) -> Path:
    """Return the file to read: the record or log of a run folder; the folder itself for a bag."""
    if not path.exists():
        raise LogFormatError(f"{path}: no such file")
    if path.is_file():
        try:
            path.open("rb").close()
        except OSError as error:
            raise LogFormatError(f"{path}: {error.strerror or error}") from None
        return path
    if not path.is_dir():
        raise LogFormatError(f"{path}: neither a file nor a folder")
    for name in (RECORD, LOG):
        if (path / name).exists():
            return path / name
    if any(item.suffix in BAG_SUFFIXES for item in path.iterdir()):
        return path
    raise LogFormatError(
        f"{path}: a folder without {RECORD}, {LOG} or a bag (.zstd: unpack it); give a log, or a folder written by excite"
    )


def _of_a_run(path: Path, error: LogFormatError) -> LogFormatError:
    """Return the error of a log; for a run folder, with a note on the missing record."""
    if not (path / "manifest.json").is_file():
        return error
    return LogFormatError(
        f"{path}: no {RECORD}: the run was interrupted, or made by climb; make a record with treadline excite, or name topics "
        f"of its log ({error})"
    )


def _open_log(file: Path, wanted: tuple[str, ...], period_s: float | None) -> Log | None:
    """Return a streaming reader for a delimited, Parquet or Feather file; None for other formats."""
    suffix = file.suffix.lower()
    if suffix in DELIMITED:
        from treadline.io._csv_files import CsvLog

        return CsvLog(file, wanted, period_s)
    if suffix in ARROW:
        from treadline.io._arrow_files import ArrowLog

        return ArrowLog(file, wanted, period_s)
    return None


def _tables(file: Path, wanted: tuple[str, ...], period_s: float | None) -> Iterable[Table]:
    """Return a columnar file as consecutive tables."""
    log = _open_log(file, wanted, period_s)
    if log is not None:
        return log
    if file.suffix.lower() in {".npz", ".mat"}:
        from treadline.io._array_files import read_mat, read_npz

        return [(read_npz if file.suffix.lower() == ".npz" else read_mat)(file, wanted, period_s)]
    raise LogFormatError(
        f"{file}: unsupported log format '{file.suffix}'; supported: {', '.join(LOG_SUFFIXES)}, .mat, a run folder or a bag "
        "folder; save a spreadsheet as CSV"
    )


def _joined(tables: list[Table]) -> Table:
    """Return consecutive tables as one table."""
    if len(tables) == 1:
        return tables[0]
    times = [table.t_s for table in tables if table.t_s is not None]
    return replace(
        tables[0],
        values=np.concatenate([table.values for table in tables]),
        t_s=np.concatenate(times) if times else None,
        marks=np.concatenate([table.marks for table in tables]),
    )
