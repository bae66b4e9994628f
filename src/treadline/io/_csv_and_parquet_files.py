"""Tables in files: CSV, read by numpy in blocks of lines so that a file can exceed the memory, and Parquet, read in batches.

The delimiter of a CSV file is a comma, a semicolon or a tab, as in the header. Where numpy fails, a cell is quoted, or rows differ
in length, the block is read cell by cell; this gives the line and column of an error, and reads number formats unknown to numpy.
Parquet is read by pyarrow (the extra ``parquet``).
"""

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from jaxtyping import Float64, Int, Shaped

from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.io._tables import NANOSECONDS, SECONDS, TIMESTAMPS, Log, Table, check_count, clock_of, missing

BLOCK_ROWS = 65_536
"""Number of lines per block: 5 MB with five columns."""
MAX_LINE = 1 << 20
"""Longest accepted line [characters]: 50,000 columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sheet:
    """Layout of a file from its header: delimiter, columns, requested columns, clock."""

    file: Path
    delimiter: str
    header: list[str]
    places: list[int]
    """Indices of the requested columns."""
    clock: str | None
    """Name of the clock column, or None."""
    has_timestamps: bool
    """Whether the clock column holds ISO 8601 text."""


_Columns = Callable[[list[int], type], Shaped[np.ndarray, "n k"]]
"""Function from column indices and number type to an array of numbers."""


class CsvLog(Log):
    """Streaming reader of the requested columns of a file delimited by commas, semicolons or tabs."""

    def __init__(self, file: Path, wanted: tuple[str, ...]) -> None:
        super().__init__(file, wanted)
        self._size = max(file.stat().st_size, 1)

    def __iter__(self) -> Iterator[Table]:
        rows, self._done, self._origin = 0, 0, None
        with self._file.open("rb") as raw, TextIOWrapper(raw, encoding="utf-8-sig", errors="surrogateescape") as text:
            line, head = 1, _block(self._file, text, 1)
            while head == ["\n"]:
                line, head = line + 1, _block(self._file, text, 1)
            if not head:
                raise LogFormatError(f"{self._file}: empty; a header and at least two rows are needed")
            block = _block(self._file, text, BLOCK_ROWS)
            sheet = _sheet(self._file, line, head[0], block, self._wanted)
            line += 1
            while block:
                values, ticks, marks = _cells(sheet, block, line)
                rows, line = rows + len(values), line + len(block)
                self._done = raw.tell()
                yield self._table(values, sheet.clock, ticks, marks, spot=":{}", header=tuple(sheet.header))
                block = _block(self._file, text, BLOCK_ROWS)
        check_count(self._file, rows)


def _block(file: Path, text: TextIO, rows: int) -> list[str]:
    """Return the next lines of a file, at most ``rows``; a file without line ends is never read whole."""
    block = list(islice(iter(partial(text.readline, MAX_LINE), ""), rows))
    if max(map(len, block), default=0) == MAX_LINE:
        raise LogFormatError(f"{file}: a line is longer than {MAX_LINE} characters; is it a CSV file?")
    return block


def _sheet(file: Path, number: int, head: str, block: list[str], wanted: tuple[str, ...]) -> _Sheet:
    """Return the layout from the header; the first row of data shows whether the clock is ISO 8601 text."""
    delimiter = next((mark for mark in (",", ";", "\t") if mark in head), ",") if file.suffix.lower() != ".tsv" else "\t"
    header = [name.strip() for row in _parted(file, [head], number, delimiter) for name in row]
    if head.lstrip().startswith("#"):
        raise LogFormatError(f"{file}:{number}: a comment before the header; remove it: the first line must name the columns")
    if all(_is_number(name) for name in header):
        raise LogFormatError(f"{file}:{number}: no header, the first line holds numbers; add a first line with the column names")
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise LogFormatError(f"{file}:{number}: column '{doubled[0]}' occurs twice; rename one of the two")
    for name in wanted:
        if name not in header and len(header) == 1 and " " in head:
            raise LogFormatError(
                f"{file}:{number}: names separated by blanks '{head.strip()[:80]}'; use commas, semicolons or tabs"
            )
        if name not in header:
            raise missing(file, name, header)
    first = next((line for line in block if line.strip("\n")), "")
    cells = dict(zip(header, next(iter(_parted(file, [first], number + 1, delimiter)), []), strict=False))
    stamps = [name for name, cell in cells.items() if name in (*SECONDS, *TIMESTAMPS) and _is_timestamp(cell)]
    clock = clock_of(header, wanted) or next((name for name in TIMESTAMPS if name in stamps and name not in wanted), None)
    return _Sheet(
        file=file,
        delimiter=delimiter,
        header=header,
        places=[header.index(name) for name in wanted],
        clock=clock,
        has_timestamps=clock in stamps,
    )


def _cells(
    sheet: _Sheet, block: list[str], line: int
) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None, Int[np.ndarray, " n"]]:
    """Return the requested columns of a block, its clock, and the line number of each row; the first line has number ``line``."""
    # A blank line has no delimiter, and a single column none to count.
    even = len(sheet.header) > 1 and {row.count(sheet.delimiter) for row in block} == {len(sheet.header) - 1}
    if even and not any('"' in row for row in block) and sheet.places and not sheet.has_timestamps:
        try:
            values, ticks = _taken(
                sheet,
                lambda places, kind: np.loadtxt(
                    block, dtype=kind, delimiter=sheet.delimiter, comments=None, usecols=places, ndmin=2
                ),
            )
            return values, ticks, np.arange(line, line + len(block))
        except ValueError:
            pass
    numbered = [(number, row) for number, row in enumerate(_parted(sheet.file, block, line, sheet.delimiter), start=line) if row]
    for number, row in numbered:
        if len(row) != len(sheet.header):
            raise ShapeMismatch(f"{sheet.file}:{number}: {len(row)} cells, the header has {len(sheet.header)}")
    values, ticks = _taken(sheet, partial(_one_by_one, sheet, numbered))
    return values, ticks, np.array([number for number, _ in numbered], dtype=int)


def _taken(sheet: _Sheet, columns: _Columns) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None]:
    """Return the requested columns and the clock; nanoseconds as integers, because a float rounds them."""
    if sheet.clock is None:
        return columns(sheet.places, float), None
    place = sheet.header.index(sheet.clock)
    if sheet.has_timestamps or sheet.clock in NANOSECONDS:
        return columns(sheet.places, float), columns([place], datetime if sheet.has_timestamps else int)[:, 0]
    both = columns([*sheet.places, place], float)
    return both[:, :-1], both[:, -1]


def _one_by_one(sheet: _Sheet, numbered: list[tuple[int, list[str]]], places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    values: Shaped[np.ndarray, "n k"] = np.empty((len(numbered), len(places)), dtype=float if kind is float else int)
    convert = _nanoseconds if kind is datetime else kind
    for i, (line, row) in enumerate(numbered):
        for j, place in enumerate(places):
            text = row[place].strip()
            try:
                values[i, j] = convert(text) if text or kind is not float else math.nan
            except (ValueError, OverflowError):
                number = "a number (decimals have a point)" if "," in text else "a number"
                what = {int: "a whole number", datetime: "an ISO 8601 time"}.get(kind, number)
                raise LogFormatError(f"{sheet.file}:{line}: column '{sheet.header[place]}' holds '{text}', not {what}") from None
    return values


def _parted(file: Path, lines: list[str], line: int, delimiter: str) -> list[list[str]]:
    """Return the cells of each line; ``line`` is the number of the first."""
    for number, text in enumerate(lines, start=line):
        try:
            text.encode()
        except UnicodeEncodeError as error:  # a byte that is not UTF-8 was read as a surrogate
            byte = ord(text[error.start]) - 0xDC00
            raise LogFormatError(f"{file}:{number}: not UTF-8 (byte {byte:#04x}); save it as CSV in UTF-8") from None
    try:
        return list(csv.reader(lines, delimiter=delimiter))
    except csv.Error as error:
        raise LogFormatError(f"{file}: not CSV: {error}") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_timestamp(cell: str) -> bool:
    if _is_number(cell):
        return False
    try:
        _nanoseconds(cell.strip())
    except ValueError:
        return False
    return True


def _nanoseconds(text: str) -> int:
    """Return an ISO 8601 time as nanoseconds since 1970, to the microsecond; a time without an offset is taken as UTC."""
    time = datetime.fromisoformat(text)
    since = (time if time.tzinfo else time.replace(tzinfo=UTC)) - datetime.fromtimestamp(0, UTC)
    return since // timedelta(microseconds=1) * 1000


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
        self._size, self._done, self._origin = max(file.metadata.num_rows, 1), 0, None
        for batch in file.iter_batches(BLOCK_ROWS, columns=list(dict.fromkeys(columns)), use_threads=False):
            values = np.empty((len(batch), len(self._wanted)))
            for j, name in enumerate(self._wanted):
                values[:, j] = _numbers(self._file, name, batch.column(name))
            ticks = None if clock is None else _ticks(self._file, clock, batch.column(clock))
            first = self._done
            self._done += len(batch)
            yield self._table(values, clock, ticks, np.arange(first + 1, self._done + 1))
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
