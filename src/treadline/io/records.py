"""Input-output records: logs of any kind in, checked rows out.

The suffix says which kind: CSV (.csv, .txt, .tsv), NPZ, MAT, Parquet, MCAP, ROS bags; a folder is a run or a bag. Errors name the
file and the place. A row with NaN is refused unless gaps are allowed; then it stays, and identification leaves out the
windows that hold it.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.errors import LogFormatError
from treadline.io.resample import period_of, resampled, uneven, with_gaps
from treadline.io.tables import Log, Table, check_gaps, check_period, check_values, gaps_in, no_clock
from treadline.models import InputOutputRecord, write_whole

TIME = "t_s"
RECORD = "record.csv"
LOG = "log.mcap"
DELIMITED = (".csv", ".txt", ".tsv")
BAGS = (".mcap", ".bag", ".db3")
KINDS = ".csv, .txt, .tsv, .npz, .mat, .parquet, .mcap, .bag, .db3"


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
        inputs: Columns that drove the system. In MCAP and bags ``topic.field``: ``/imu.angular_velocity.z``, ``/tracks.data[0]``.
        outputs: Columns that answered.
        period_s: Sampling period; read from the clock when left out (``t_s``, ``t``, ``time``, ``t_ns``, ``timestamp_ns``).
        resample: Bring an irregular time axis to the period: inputs are held, outputs interpolated. Channels of a bag, each with
            times of its own, are always brought to one.
        allow_gaps: Accept rows with NaN (an empty cell, ``nan``, or a pause in a channel of a bag), and rows that are missing where
            all times lie on the grid of the period: those become rows of NaN.

    Raises:
        RecordError: With file, line and column.
        PeriodMismatch: If time is irregular and ``resample`` is off.
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
    """Write a record as CSV, numbers as exact as they are."""
    lines = [",".join((TIME, *record.input_names, *record.output_names))]
    for k in range(len(record)):
        row = (first_t_s + k * record.dt_s, *record.u[k].tolist(), *record.y[k].tolist())
        lines.append(",".join(repr(round(value, 9) if i == 0 else value) for i, value in enumerate(row)))
    write_whole(path, "\n".join(lines) + "\n")


def file_of(path: Path) -> Path:
    """Return the file to read: a run folder's record or log, a bag's folder as it is."""
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
        f"{path}: a folder without {RECORD}, {LOG} or a bag (.zstd: unpack it); give a log, or a folder that excite wrote"
    )


def _of_a_run(path: Path, error: LogFormatError) -> LogFormatError:
    """Return what is wrong with a log; of a run folder's, also that the record is missing, and why."""
    if not (path / "manifest.json").is_file():
        return error
    return LogFormatError(
        f"{path}: no {RECORD}: the run was interrupted, or is a climb's; make a record with treadline excite, or name topics "
        f"of its log ({error})"
    )


def _check_readable(file: Path) -> None:
    try:
        file.open("rb").close()
    except OSError as error:
        raise LogFormatError(f"{file}: {error.strerror or error}") from None


def open_log(file: Path, wanted: tuple[str, ...]) -> Log | None:
    """Return a file that can be read row by row, open for reading; None for other kinds."""
    suffix = file.suffix.lower()
    if suffix in DELIMITED:
        from treadline.io.delimited import CsvLog

        return CsvLog(file, wanted)
    if suffix == ".parquet":
        from treadline.io.parquet import ParquetLog

        return ParquetLog(file, wanted)
    return None


def _tables(file: Path, wanted: tuple[str, ...]) -> Iterable[Table]:
    """Return a file of columns as tables that follow one another."""
    log = open_log(file, wanted)
    if log is not None:
        return log
    if file.suffix.lower() == ".npz":
        from treadline.io.npz import read_npz

        return [read_npz(file, wanted)]
    if file.suffix.lower() == ".mat":
        from treadline.io.mat import read_mat

        return [read_mat(file, wanted)]
    raise LogFormatError(f"{file}: '{file.suffix}' is no kind of log that is read: {KINDS}, a run folder or a bag's folder")


def joined(tables: list[Table]) -> Table:
    """Return tables that follow one another as one."""
    if len(tables) == 1:
        return tables[0]
    times = [table.t_s for table in tables if table.t_s is not None]
    return replace(
        tables[0],
        values=np.concatenate([table.values for table in tables]),
        t_s=np.concatenate(times) if times else None,
        marks=np.concatenate([table.marks for table in tables]),
    )
