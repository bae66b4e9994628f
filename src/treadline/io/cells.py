"""Conversion of the cells of a CSV file to numbers, block by block.

A block is parsed by numpy, or by pyarrow if installed and the file is long (three times faster, identical results). If the fast
parser fails, a cell is quoted, or rows differ in length, the block is parsed cell by cell; this gives the line and column of an
error, and reads number formats unknown to the fast parsers.
"""

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int, Shaped

from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.io.tables import NANOSECONDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Layout of a CSV file from its header: delimiter, columns, requested columns, clock."""

    file: Path
    delimiter: str
    header: list[str]
    places: list[int]
    """Indices of the requested columns."""
    clock: int | None
    """Index of the clock column, or None."""
    has_timestamps: bool = False
    """Whether the clock column holds ISO 8601 text."""

    @property
    def clock_name(self) -> str | None:
        """Name of the clock column, or None."""
        return None if self.clock is None else self.header[self.clock]


Parser = Callable[[Sheet, bytes, list[int], type], Shaped[np.ndarray, "n k"]]
"""Function from sheet, block, column indices and number type to an array of numbers."""
Cells = tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None, Int[np.ndarray, " n"]]
"""Requested columns, clock values, and the line number of each row."""


def cells_of(sheet: Sheet, block: bytes, line: int, parse: Parser) -> Cells:
    """Return the requested cells of a block whose first line has the number ``line``."""
    rows = _rows_of_one_length(sheet, block)
    if rows and sheet.places and not sheet.has_timestamps:
        try:
            values, ticks = _taken(sheet, lambda places, kind: parse(sheet, block, places, kind))
        except ValueError:  # base class of pyarrow's errors
            pass
        else:
            if len(values) == rows:
                return values, ticks, np.arange(line, line + rows)
    text = decoded(sheet.file, block, line)
    numbered = [(number, row) for number, row in enumerate(parted(sheet.file, text, sheet.delimiter), start=line) if row]
    for number, row in numbered:
        if len(row) != len(sheet.header):
            raise ShapeMismatch(f"{sheet.file}:{number}: {len(row)} cells, the header has {len(sheet.header)}")
    values, ticks = _taken(sheet, lambda places, kind: _one_by_one(sheet, numbered, places, kind))
    return values, ticks, np.array([number for number, _ in numbered], dtype=int)


def _taken(
    sheet: Sheet, numbers: Callable[[list[int], type], Shaped[np.ndarray, "n k"]]
) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None]:
    """Return the requested columns and the clock; nanoseconds as integers, because a float rounds them."""
    if sheet.clock is None:
        return numbers(sheet.places, float), None
    if sheet.has_timestamps:
        return numbers(sheet.places, float), numbers([sheet.clock], datetime)[:, 0]
    if sheet.clock_name in NANOSECONDS:
        return numbers(sheet.places, float), numbers([sheet.clock], int)[:, 0]
    both = numbers([*sheet.places, sheet.clock], float)
    return both[:, :-1], both[:, -1]


def _rows_of_one_length(sheet: Sheet, block: bytes) -> int:
    """Return the number of rows, or 0 if rows differ in length or a cell is quoted."""
    marks = np.frombuffer(block, np.uint8)
    ends = np.flatnonzero(marks == ord("\n"))
    if not block.endswith(b"\n"):
        ends = np.append(ends, len(block))
    parting = np.flatnonzero(marks == ord(sheet.delimiter))
    per_row = len(sheet.header) - 1
    if b'"' in block or len(parting) != per_row * len(ends):
        return 0
    grid = parting.reshape(len(ends), per_row)
    return len(ends) if (grid < ends[:, None]).all() and (grid[1:] > ends[:-1, None]).all() else 0


def by_numpy(sheet: Sheet, block: bytes, places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    """Return columns of an unquoted block, parsed by numpy; an invalid cell raises ValueError."""
    text = io.StringIO(block.decode("ascii", "replace"))
    return np.loadtxt(text, dtype=kind, delimiter=sheet.delimiter, comments=None, usecols=places, ndmin=2)


def fastest() -> Parser:
    """Return pyarrow's parser if installed, else numpy's."""
    try:
        from pyarrow import csv as arrow
    except ImportError:
        return by_numpy

    def by_arrow(sheet: Sheet, block: bytes, places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
        names = [str(i) for i in range(len(sheet.header))]
        wanted = [names[place] for place in places]
        types: dict[str, Any] = dict.fromkeys(wanted, np.dtype(kind).name.replace("float64", "double"))
        table = arrow.read_csv(
            io.BytesIO(block),
            read_options=arrow.ReadOptions(column_names=names, use_threads=False, block_size=len(block) + 1),
            parse_options=arrow.ParseOptions(delimiter=sheet.delimiter, quote_char=False),
            convert_options=arrow.ConvertOptions(column_types=types, include_columns=wanted, null_values=["", "nan"]),
        )
        return np.column_stack([column.to_numpy() for column in table.columns])

    return by_arrow


def _one_by_one(sheet: Sheet, numbered: list[tuple[int, list[str]]], places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    values: Shaped[np.ndarray, "n k"] = np.empty((len(numbered), len(places)), dtype=float if kind is float else int)
    convert = nanoseconds_of if kind is datetime else kind
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


def nanoseconds_of(text: str) -> int:
    """Return an ISO 8601 time as nanoseconds since 1970, to the microsecond; a time without an offset is taken as UTC."""
    time = datetime.fromisoformat(text)
    since = (time if time.tzinfo else time.replace(tzinfo=UTC)) - datetime.fromtimestamp(0, UTC)
    return since // timedelta(microseconds=1) * 1000


def decoded(file: Path, block: bytes, line: int) -> str:
    """Return a block as text; ``line`` is the number of its first line."""
    try:
        return block.decode("utf-8")
    except UnicodeDecodeError as error:
        near = line + block[: error.start].count(b"\n")
        raise LogFormatError(f"{file}:{near}: not UTF-8 (byte {block[error.start]:#04x}); save it as CSV in UTF-8") from None


def parted(file: Path, text: str, delimiter: str) -> list[list[str]]:
    """Return the cells of each line."""
    try:
        return list(csv.reader(text.splitlines(), delimiter=delimiter))
    except csv.Error as error:
        raise LogFormatError(f"{file}: not CSV: {error}") from None
