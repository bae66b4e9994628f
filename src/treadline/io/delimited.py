"""CSV files, read in blocks, so that a file can exceed the memory.

The delimiter is a comma, a semicolon or a tab, as in the header.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import IO

from treadline.core.errors import LogFormatError
from treadline.io.cells import Parser, Sheet, by_numpy, cells_of, decoded, fastest, nanoseconds_of, parted
from treadline.io.tables import SECONDS, TIMESTAMPS, Table, check_count, clock_of, missing, seconds_of

BLOCK_BYTES = 8 * 1024 * 1024
"""Size of a block [bytes]."""
MAX_LINE_BYTES = 8 * BLOCK_BYTES
"""Longest accepted line [bytes]."""
BOM = b"\xef\xbb\xbf"
"""UTF-8 byte order mark, written by spreadsheet programs before the header."""


class CsvLog:
    """Streaming reader of the requested columns of a file delimited by commas, semicolons or tabs."""

    def __init__(self, file: Path, wanted: tuple[str, ...]) -> None:
        self._file = file
        self._wanted = wanted
        self._size = file.stat().st_size
        self._done = 0
        self._parse: Parser = by_numpy if self._size <= BLOCK_BYTES else fastest()

    @property
    def fraction(self) -> float:
        """Fraction of the file read so far."""
        return self._done / self._size if self._size else 1.0

    def __iter__(self) -> Iterator[Table]:
        sheet: Sheet | None = None
        rows, line, origin = 0, 1, 0
        self._done = 0
        with self._file.open("rb") as file:
            for block in _blocks(self._file, file):
                body = block
                if sheet is None:
                    sheet, body = _opened(self._file, block, self._wanted)
                    line += block[: len(block) - len(body)].count(b"\n")
                values, ticks, lines = cells_of(sheet, body, line, self._parse)
                line += body.count(b"\n")
                if rows == 0 and ticks is not None and ticks.dtype.kind == "i" and len(ticks):
                    origin = int(ticks[0])
                rows += len(values)
                self._done = file.tell()
                yield Table(
                    file=self._file,
                    names=self._wanted,
                    values=values,
                    clock=sheet.clock_name,
                    t_s=None if ticks is None else seconds_of(ticks, origin),
                    marks=lines,
                    spot=":{}",
                    header=tuple(sheet.header),
                )
        if sheet is None:
            raise LogFormatError(f"{self._file}: empty; a header and at least two rows are needed")
        check_count(self._file, rows)


def _blocks(path: Path, file: IO[bytes]) -> Iterator[bytes]:
    """Yield the file in blocks of whole lines; blocks of blank lines are skipped."""
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


def _opened(file: Path, block: bytes, wanted: tuple[str, ...]) -> tuple[Sheet, bytes]:
    """Return the layout from the header, and the rest of the block."""
    text = block.removeprefix(BOM)
    blank = len(text) - len(text.lstrip(b"\r\n"))
    head, _, body = text[blank:].partition(b"\n")
    number = text[:blank].count(b"\n") + 1
    if b"\r" in head.rstrip(b"\r"):  # line ends are carriage returns, or the file is binary: decoding reports the error
        head, _, body = text[blank:].partition(b"\r")
    line = decoded(file, head, number)
    delimiter = next((mark for mark in (",", ";", "\t") if mark in line), ",") if file.suffix.lower() != ".tsv" else "\t"
    header = [name.strip() for row in parted(file, line, delimiter) for name in row]
    _check_header(file, number, line, header)
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise LogFormatError(f"{file}:{number}: column '{doubled[0]}' occurs twice; rename one of the two")
    for name in wanted:
        if name not in header and len(header) == 1 and " " in line:
            raise LogFormatError(
                f"{file}:{number}: names separated by blanks '{line.strip()[:80]}'; use commas, semicolons or tabs"
            )
        if name not in header:
            raise missing(file, name, header)
    clock, has_timestamps = _clock(header, wanted, _first_row(file, body, number + 1, delimiter))
    return Sheet(
        file=file,
        delimiter=delimiter,
        header=header,
        places=[header.index(name) for name in wanted],
        clock=None if clock is None else header.index(clock),
        has_timestamps=has_timestamps,
    ), body


def _first_row(file: Path, body: bytes, number: int, delimiter: str) -> list[str]:
    """Return the cells of the first row of data; empty for a file without data."""
    line = body.lstrip(b"\r\n").partition(b"\n")[0]
    return next(iter(parted(file, decoded(file, line, number), delimiter)), [])


def _clock(header: list[str], wanted: tuple[str, ...], row: list[str]) -> tuple[str | None, bool]:
    """Return the clock column, and whether it holds ISO 8601 text, judged by the first row."""
    cells = dict(zip(header, row, strict=False))
    name = clock_of(header, wanted)
    if name is not None:
        return name, name in SECONDS and _is_timestamp(cells.get(name, ""))
    stamps = (name for name in TIMESTAMPS if name in cells and name not in wanted and _is_timestamp(cells[name]))
    stamp = next(stamps, None)
    return stamp, stamp is not None


def _is_timestamp(cell: str) -> bool:
    if _is_number(cell):
        return False
    try:
        nanoseconds_of(cell.strip())
    except ValueError:
        return False
    return True


def _check_header(file: Path, number: int, line: str, header: list[str]) -> None:
    """Reject a first line without column names."""
    if line.lstrip().startswith("#"):
        raise LogFormatError(f"{file}:{number}: a comment before the header; remove it: the first line must name the columns")
    if all(_is_number(name) for name in header):
        raise LogFormatError(f"{file}:{number}: no header, the first line holds numbers; add a first line with the column names")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
