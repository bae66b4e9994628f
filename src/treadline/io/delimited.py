"""CSV: a header, then numbers; read in blocks, so that a file may be longer than the memory.

A block is parsed as a whole by numpy, or by pyarrow where it is installed and the file is long (four times as fast, the same
bits). Only a block that they refuse, or in which a cell is quoted or a row has another length, is read cell by cell: that
finds the line and the column of the fault, or the number that the fast parsers do not know.
"""

import csv
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from jaxtyping import Shaped

from treadline.errors import LogFormatError, ShapeMismatch
from treadline.io.tables import NANOSECONDS, Table, check_count, clock_of, missing, seconds_of

BLOCK_BYTES = 8 * 1024 * 1024
MAX_LINE_BYTES = 8 * BLOCK_BYTES
BOM = b"\xef\xbb\xbf"
"""Spreadsheets write it in front of the header."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sheet:
    """What the header says: how cells are parted, which there are, which are wanted."""

    file: Path
    delimiter: str
    header: list[str]
    places: list[int]
    clock: int | None

    @property
    def in_nanoseconds(self) -> bool:
        return self.clock is not None and self.header[self.clock] in NANOSECONDS


_Parser = Callable[[_Sheet, bytes, list[int], type], Shaped[np.ndarray, "n k"]]


class CsvLog:
    """The wanted columns of a file with commas, semicolons or tabs between its cells."""

    def __init__(self, file: Path, wanted: tuple[str, ...]) -> None:
        self._file = file
        self._wanted = wanted
        self._size = file.stat().st_size
        self._done = 0
        self._parse: _Parser = _by_numpy if self._size <= BLOCK_BYTES else _fastest()

    @property
    def fraction(self) -> float:
        """Share of the file that has been read."""
        return self._done / self._size if self._size else 1.0

    def __iter__(self) -> Iterator[Table]:
        sheet: _Sheet | None = None
        rows, line, origin = 0, 1, 0
        self._done = 0
        with self._file.open("rb") as file:
            for block in _blocks(self._file, file):
                body = block
                if sheet is None:
                    sheet, body = _opened(self._file, body, self._wanted)
                    line += block[: len(block) - len(body)].count(b"\n")
                values, ticks, lines = _cells(sheet, body, line, self._parse)
                line += body.count(b"\n")
                if rows == 0 and len(values) and ticks is not None and sheet.in_nanoseconds:
                    origin = int(ticks[0])
                rows += len(values)
                self._done = file.tell()
                yield _table(sheet, self._wanted, values, ticks, lines, origin)
        if sheet is None:
            raise LogFormatError(f"{self._file}: empty; a header and at least two rows are needed")
        check_count(self._file, rows)


def _table(
    sheet: _Sheet,
    wanted: tuple[str, ...],
    values: Shaped[np.ndarray, "n k"],
    ticks: Shaped[np.ndarray, " n"] | None,
    lines: Sequence[int],
    origin: int,
) -> Table:
    clock = None if sheet.clock is None else sheet.header[sheet.clock]
    return Table(
        file=sheet.file,
        names=wanted,
        values=values,
        clock=clock,
        t_s=None if ticks is None else seconds_of(ticks, origin),
        where=lambda k: f"{sheet.file}:{lines[k]}",
    )


def _blocks(path: Path, file: IO[bytes]) -> Iterator[bytes]:
    """Yield the file in blocks that end with a line; blank lines alone are no block."""
    rest = b""
    while piece := file.read(BLOCK_BYTES):
        rest += piece
        cut = rest.rfind(b"\n") + 1
        if len(rest) - cut > MAX_LINE_BYTES:
            raise LogFormatError(f"{path}: a line is longer than {MAX_LINE_BYTES} bytes; is it a CSV file?")
        if rest[:cut].strip():
            yield rest[:cut]
            rest = rest[cut:]
    if rest.strip():
        yield rest


def _opened(file: Path, block: bytes, wanted: tuple[str, ...]) -> tuple[_Sheet, bytes]:
    """Return what the header says, and the block behind it."""
    text = block.removeprefix(BOM)
    blank = len(text) - len(text.lstrip(b"\r\n"))
    head, _, body = text[blank:].partition(b"\n")
    number = text[:blank].count(b"\n") + 1
    if b"\r" in head.rstrip(b"\r"):  # lines end with a return alone, or it is no text: the reader of cells will tell
        head, _, body = text[blank:].partition(b"\r")
    line = _decoded(file, head, 0)
    delimiter = next((mark for mark in (",", ";", "\t") if mark in line), ",") if file.suffix.lower() != ".tsv" else "\t"
    header = [name.strip() for row in _parted(file, line, delimiter) for name in row]
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise LogFormatError(f"{file}:{number}: column '{doubled[0]}' stands twice")
    for name in wanted:
        if name not in header:
            raise missing(file, name, header)
    clock = clock_of(header, wanted)
    return _Sheet(
        file=file,
        delimiter=delimiter,
        header=header,
        places=[header.index(name) for name in wanted],
        clock=None if clock is None else header.index(clock),
    ), body


def _cells(
    sheet: _Sheet, block: bytes, line: int, parse: _Parser
) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None, Sequence[int]]:
    """Return the wanted columns, the clock's ticks, and the line of each row."""
    rows = _rows_of_one_length(sheet, block)
    if rows and sheet.places:
        try:
            values, ticks = _taken(sheet, lambda places, kind: parse(sheet, block, places, kind))
        except ValueError:  # pyarrow's are children of it
            pass
        else:
            if len(values) == rows:
                return values, ticks, range(line, line + rows)
    text = _decoded(sheet.file, block, line)
    numbered = [(number, row) for number, row in enumerate(_parted(sheet.file, text, sheet.delimiter), start=line) if row]
    for number, row in numbered:
        if len(row) != len(sheet.header):
            raise ShapeMismatch(f"{sheet.file}:{number}: {len(row)} cells, the header has {len(sheet.header)}")
    values, ticks = _taken(sheet, lambda places, kind: _one_by_one(sheet, numbered, places, kind))
    return values, ticks, [number for number, _ in numbered]


def _taken(
    sheet: _Sheet, numbers: Callable[[list[int], type], Shaped[np.ndarray, "n k"]]
) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, " n"] | None]:
    """Return the wanted columns and the clock; nanoseconds as whole numbers, for a float rounds them."""
    if sheet.clock is None:
        return numbers(sheet.places, float), None
    if sheet.in_nanoseconds:
        return numbers(sheet.places, float), numbers([sheet.clock], int)[:, 0]
    both = numbers([*sheet.places, sheet.clock], float)
    return both[:, :-1], both[:, -1]


def _rows_of_one_length(sheet: _Sheet, block: bytes) -> int:
    """Return the number of rows, or 0 where they differ in length or a cell is quoted."""
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


def _by_numpy(sheet: _Sheet, block: bytes, places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    text = io.StringIO(block.decode("ascii", "replace"))
    return np.loadtxt(text, dtype=kind, delimiter=sheet.delimiter, comments=None, usecols=places, ndmin=2)


def _fastest() -> _Parser:
    try:
        from pyarrow import csv as arrow
    except ImportError:
        return _by_numpy

    def by_arrow(sheet: _Sheet, block: bytes, places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
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


def _one_by_one(sheet: _Sheet, numbered: list[tuple[int, list[str]]], places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    values: Shaped[np.ndarray, "n k"] = np.empty((len(numbered), len(places)), dtype=kind)
    for i, (line, row) in enumerate(numbered):
        for j, place in enumerate(places):
            text = row[place].strip()
            try:
                values[i, j] = kind(text) if text or kind is int else math.nan
            except (ValueError, OverflowError):
                what = "a number" if kind is float else "a whole number"
                raise LogFormatError(f"{sheet.file}:{line}: column '{sheet.header[place]}' holds '{text}', not {what}") from None
    return values


def _decoded(file: Path, block: bytes, line: int) -> str:
    try:
        return block.decode("utf-8")
    except UnicodeDecodeError as error:
        near = line + block[: error.start].count(b"\n")
        raise LogFormatError(f"{file}:{near}: not UTF-8 (byte {block[error.start]:#04x}); is it a CSV file?") from None


def _parted(file: Path, text: str, delimiter: str) -> list[list[str]]:
    try:
        return list(csv.reader(text.splitlines(), delimiter=delimiter))
    except csv.Error as error:
        raise LogFormatError(f"{file}: not CSV: {error}") from None
