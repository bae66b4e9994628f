"""Input-output records: CSV files and run folders in, checked rows out.

Errors name file, line and column. A row with NaN is refused unless gaps are allowed; then it stays, and identification
leaves out the windows that hold it.
"""

import csv
import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.errors import LogFormatError, NotFinite, PeriodMismatch, RecordError, ShapeMismatch
from treadline.models import InputOutputRecord, write_whole

TIME = "t_s"
RECORD = "record.csv"
IRREGULAR = 0.05
"""Largest deviation of a sampling interval from the period, as a share of it."""
MOST_ROWS = 10_000_000
"""Most rows that resampling makes: four weeks at 4 Hz; one wild time stamp asks for more."""
MOST_GAPS = 0.2
"""Largest share of rows with NaN."""


def read_record(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    period_s: float | None = None,
    resample: bool = False,
    allow_gaps: bool = False,
) -> InputOutputRecord:
    """Return the record in a CSV file with a header, or in a run folder.

    Args:
        period_s: Sampling period; read from the column ``t_s`` when left out.
        resample: Bring an irregular time axis to the period: inputs are held, outputs interpolated.
        allow_gaps: Accept rows with NaN (an empty cell or ``nan``).

    Raises:
        RecordError: With file, line and column.
        PeriodMismatch: If time is irregular and ``resample`` is off.
    """
    file = _file_of(path)
    if period_s is not None and not (math.isfinite(period_s) and period_s > 0.0):
        raise PeriodMismatch(f"--period is {period_s}; it must be positive")
    header, lines, cells = _cells(file)
    wanted = [*inputs, *outputs]
    for name in wanted:
        if name not in header:
            raise LogFormatError(f"{file}: no column '{name}' (there are: {', '.join(header)})")
    places = [header.index(name) for name in wanted]
    values = _numbers(file, header, lines, cells, places, allow_gaps=allow_gaps)
    _check_gaps(file, values)
    _check_units(file, wanted, values)
    m = len(inputs)
    u, y = values[:, :m], values[:, m:]
    if TIME in header:
        t = _numbers(file, header, lines, cells, [header.index(TIME)], allow_gaps=False)[:, 0]
        u, y, period_s = _on_a_grid(file, lines, t, u, y, period_s, resample=resample)
    elif period_s is None:
        raise PeriodMismatch(f"{file}: no column '{TIME}'; give --period")
    return InputOutputRecord(u=u, y=y, dt_s=period_s, input_names=inputs, output_names=outputs)


def write_record(path: Path, record: InputOutputRecord, first_t_s: float) -> None:
    """Write a record as CSV, numbers as exact as they are."""
    lines = [",".join((TIME, *record.input_names, *record.output_names))]
    for k in range(len(record)):
        row = (first_t_s + k * record.dt_s, *record.u[k].tolist(), *record.y[k].tolist())
        lines.append(",".join(repr(round(value, 9) if i == 0 else value) for i, value in enumerate(row)))
    write_whole(path, "\n".join(lines) + "\n")


def _file_of(path: Path) -> Path:
    if path.is_dir():
        file = path / RECORD
        if not file.exists():
            raise LogFormatError(f"{path}: a folder without {RECORD}; give a CSV file or a folder that excite wrote")
        return file
    if not path.exists():
        raise LogFormatError(f"{path}: no such file")
    return path


def _cells(file: Path) -> tuple[list[str], list[int], list[list[str]]]:
    """Return the header, the line number of each row, and the rows as text."""
    try:
        text = file.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise LogFormatError(f"{file}: not UTF-8 (byte {error.start}); is it a CSV file?") from None
    try:
        rows = [(number, row) for number, row in enumerate(csv.reader(text.splitlines()), start=1) if row]
    except csv.Error as error:
        raise LogFormatError(f"{file}: not CSV: {error}") from None
    if not rows:
        raise LogFormatError(f"{file}: empty; a header and at least two rows are needed")
    header = [name.strip() for name in rows[0][1]]
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise LogFormatError(f"{file}:1: column '{doubled[0]}' stands twice")
    if len(rows) < 3:
        raise LogFormatError(f"{file}: {len(rows) - 1} rows of data; at least two rows are needed")
    for number, row in rows[1:]:
        if len(row) != len(header):
            raise ShapeMismatch(f"{file}:{number}: {len(row)} cells, the header has {len(header)}")
    return header, [number for number, _ in rows[1:]], [row for _, row in rows[1:]]


def _numbers(
    file: Path, header: list[str], lines: list[int], cells: list[list[str]], places: list[int], *, allow_gaps: bool
) -> Float[np.ndarray, "n k"]:
    values = np.empty((len(cells), len(places)))
    for i, row in enumerate(cells):
        for j, place in enumerate(places):
            text = row[place].strip()
            try:
                values[i, j] = float(text) if text else math.nan
            except ValueError:
                raise LogFormatError(f"{file}:{lines[i]}: column '{header[place]}' holds '{text}', not a number") from None
    for test, word, remedy in (
        (np.isinf, "Inf", "mend the recording"),
        (np.isnan, "NaN", "drop the row or pass --allow-gaps"),
    ):
        bad = np.argwhere(test(values))
        if bad.size and not (word == "NaN" and allow_gaps):
            i, j = bad[0]
            raise NotFinite(f"{file}:{lines[int(i)]}: column '{header[places[int(j)]]}' holds {word}; {remedy}")
    return values


def _check_gaps(file: Path, values: Float[np.ndarray, "n k"]) -> None:
    share = float(np.isnan(values).any(axis=1).mean())
    if share > MOST_GAPS:
        raise NotFinite(f"{file}: {share:.0%} of the rows hold NaN; at most {MOST_GAPS:.0%} may: mend the recording")


def _check_units(file: Path, names: list[str], values: Float[np.ndarray, "n k"]) -> None:
    for name, column in zip(names, values.T, strict=True):
        largest = float(np.nanmax(np.abs(column), initial=0.0))
        if name.endswith("_rad") and largest > math.pi:
            raise RecordError(f"{file}: column '{name}' reaches {largest:.1f}, beyond π: degrees? convert it to radians")
        if name.endswith("_m_s") and largest > 50.0:
            raise RecordError(f"{file}: column '{name}' reaches {largest:.0f} m/s: millimetres? convert it to metres")


def _on_a_grid(
    file: Path,
    lines: list[int],
    t: Float[np.ndarray, " n"],
    u: Float[np.ndarray, "n m"],
    y: Float[np.ndarray, "n p"],
    period_s: float | None,
    *,
    resample: bool,
) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "k p"], float]:
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0.0)
    if back.size:
        raise RecordError(f"{file}:{lines[int(back[0]) + 1]}: column '{TIME}' does not increase")
    period = float(np.median(steps)) if period_s is None else period_s
    uneven = np.flatnonzero(np.abs(steps - period) > IRREGULAR * period)
    if not uneven.size:
        return u, y, period
    if not resample:
        raise PeriodMismatch(
            f"{file}:{lines[int(uneven[0]) + 1]}: a step of {steps[uneven[0]]:.4g} s where the period is {period:.4g} s; "
            "pass --resample"
        )
    count = (t[-1] - t[0]) / period + 1.0
    if not count <= MOST_ROWS:
        raise RecordError(f"{file}: {count:.3g} rows at {period:.4g} s; at most {MOST_ROWS} are made: give a longer --period")
    grid = t[0] + period * np.arange(int(count))
    held = np.clip(np.searchsorted(t, grid + 1e-9 * period, side="right") - 1, 0, len(t) - 1)
    between = np.column_stack([np.interp(grid, t, column) for column in y.T])
    return u[held], between, period
