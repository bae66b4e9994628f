"""Input-output records from logs of all supported formats.

The suffix selects the format: CSV (.csv, .txt, .tsv), NPZ, MAT, Parquet, MCAP, ROS bags; a folder is a run folder or a bag. Error
messages name the file and the location. Rows with NaN are rejected unless gaps are allowed; allowed gaps stay in the record, and
identification leaves out the windows that contain them.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.core.errors import LogFormatError
from treadline.core.models import InputOutputRecord, write_whole
from treadline.io.resample import period_of, resampled, uneven, with_gaps
from treadline.io.tables import Log, Table, check_gaps, check_period, check_values, gaps_in, no_clock

TIME = "t_s"
"""Name of the time column of a record."""
RECORD = "record.csv"
"""File name of the record in a run folder."""
LOG = "log.mcap"
"""File name of the MCAP log in a run folder."""
DELIMITED = (".csv", ".txt", ".tsv")
"""Suffixes of delimited text files."""
BAGS = (".mcap", ".bag", ".db3")
"""Suffixes of message logs."""
KINDS = ".csv, .txt, .tsv, .npz, .mat, .parquet, .mcap, .bag, .db3"
"""Supported suffixes, for error messages."""


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
        period_s: Sampling period; by default the median step of the clock column (``t_s``, ``t``, ``time``, ``t_ns``,
            ``timestamp_ns``).
        resample: Resample an irregular time axis to the period: inputs by sample-and-hold, outputs by linear interpolation.
            Channels of a bag have separate time axes and are always resampled.
        allow_gaps: Accept rows with NaN (an empty cell, ``nan``, or a pause in a channel of a bag), and missing rows if all times
            lie on the grid of the period: missing rows become rows of NaN.

    Raises:
        RecordError: With file, line and column.
        PeriodMismatch: If the time axis is irregular and ``resample`` is off.
    """
    check_period(period_s)
    file = file_of(path)
    wanted = (*inputs, *outputs)
    if file.is_dir() or file.suffix.lower() in BAGS:
        from treadline.io.bags import read_bag

        try:
            table, period_s = read_bag(file, inputs, outputs, period_s)
        except LogFormatError as lacking:
            raise _of_a_run(path, lacking) from None
    else:
        table = joined(list(_tables(file, wanted)))
    check_values(table, allow_gaps=allow_gaps)
    check_gaps(file, gaps_in(table), len(table))
    values = table.values
    if table.t_s is not None:
        period_s = period_of(table, table.t_s, period_s)
        error = uneven(table, table.t_s, period_s)
        if error is not None:
            whole = with_gaps(table, table.t_s, period_s) if allow_gaps and not resample else None
            if whole is None and not resample:
                raise error
            values = resampled(table, table.t_s, len(inputs), period_s) if whole is None else whole
    if period_s is None:
        raise no_clock(table)
    m = len(inputs)
    return InputOutputRecord(u=values[:, :m], y=values[:, m:], dt_s=period_s, input_names=inputs, output_names=outputs)


def write_record(path: Path, record: InputOutputRecord, first_t_s: float) -> None:
    """Write a record as CSV with full floating-point precision."""
    lines = [",".join((TIME, *record.input_names, *record.output_names))]
    for k in range(len(record)):
        row = (first_t_s + k * record.dt_s, *record.u[k].tolist(), *record.y[k].tolist())
        lines.append(",".join(repr(round(value, 9) if i == 0 else value) for i, value in enumerate(row)))
    write_whole(path, "\n".join(lines) + "\n")


def file_of(path: Path) -> Path:
    """Return the file to read: the record or log of a run folder; the folder itself for a bag."""
    if not path.exists():
        raise LogFormatError(f"{path}: no such file")
    if path.is_file():
        _check_readable(path)
        return path
    if not path.is_dir():
        raise LogFormatError(f"{path}: neither a file nor a folder")
    for name in (RECORD, LOG):
        if (path / name).exists():
            return path / name
    if any(item.suffix in BAGS for item in path.iterdir()):
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


def _check_readable(file: Path) -> None:
    try:
        file.open("rb").close()
    except OSError as error:
        raise LogFormatError(f"{file}: {error.strerror or error}") from None


def open_log(file: Path, wanted: tuple[str, ...]) -> Log | None:
    """Return a streaming reader for a delimited or Parquet file; None for other formats."""
    suffix = file.suffix.lower()
    if suffix in DELIMITED:
        from treadline.io.delimited import CsvLog

        return CsvLog(file, wanted)
    if suffix == ".parquet":
        from treadline.io.parquet import ParquetLog

        return ParquetLog(file, wanted)
    return None


def _tables(file: Path, wanted: tuple[str, ...]) -> Iterable[Table]:
    """Return a columnar file as consecutive tables."""
    log = open_log(file, wanted)
    if log is not None:
        return log
    if file.suffix.lower() == ".npz":
        from treadline.io.npz import read_npz

        return [read_npz(file, wanted)]
    if file.suffix.lower() == ".mat":
        from treadline.io.mat import read_mat

        return [read_mat(file, wanted)]
    raise LogFormatError(f"{file}: unsupported log format '{file.suffix}'; supported: {KINDS}, a run folder or a bag folder")


def joined(tables: list[Table]) -> Table:
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
