"""CSV files, read by numpy in blocks of lines so that a file can exceed the memory (decision 0008).

Where numpy fails, a cell is quoted, or rows differ in length, the block is read cell by cell; this gives the line and column of an
error, and reads what numpy does not know. A byte order mark distinguishes UTF-16 from UTF-8; a file that ends in .gz is unpacked.
"""

import codecs
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import datetime
from functools import partial
from gzip import GzipFile
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from jaxtyping import Int, Shaped

from treadline.core.arrays import BLOCK_ROWS
from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.io._clock import Seconds
from treadline.io._sheet import Row, Sheet, sheet_of
from treadline.io._tables import MAX_BYTES, Log, Table, check_count, listed

MAX_LINE = 1 << 20
"""Longest accepted line [characters]: 50,000 columns."""


class CsvLog(Log):
    """Streaming reader of the requested columns of a text file."""

    def __init__(self, file: Path, wanted: tuple[str, ...], period_s: float | None) -> None:
        super().__init__(file, wanted, period_s)
        self._is_packed = file.suffix.lower() == ".gz"

    def __iter__(self) -> Iterator[Table]:
        self._size, self._done = max(self._file.stat().st_size, 1), 0
        try:
            with self._file.open("rb") as packed, self._text(packed) as text:
                yield from self._tables(packed, text)
        except (UnicodeError, EOFError, OSError, zlib.error) as error:
            raise LogFormatError(f"{self._file}: not a whole text file: {error}") from None

    def _text(self, packed: BinaryIO) -> TextIOWrapper:
        plain = cast("BinaryIO", GzipFile(fileobj=packed)) if self._is_packed else packed
        head = plain.read(2)
        plain.seek(0)
        low, high = head.endswith(b"\0"), head.startswith(b"\0")
        is_marked = head in {codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE}
        wide = "utf-16" if is_marked else "utf-16-le" if low else "utf-16-be" if high else None
        return TextIOWrapper(plain, wide or "utf-8-sig", "strict" if wide else "surrogateescape")

    def _tables(self, packed: BinaryIO, text: TextIOWrapper) -> Iterator[Table]:
        block = _block(self._file, text)
        sheet = sheet_of(self._file, block, self._wanted, self._period_s)
        seconds = None if sheet.clock is None else Seconds(self._file, sheet.clock, self._period_s)
        rows, line, block = 0, sheet.first + 1, block[sheet.first :]
        while block:
            values, ticks, marks = _cells(sheet, block, line)
            rows, line = rows + len(values), line + len(block)
            self._done = packed.tell()
            if self._is_packed and cast("GzipFile", text.buffer).tell() > MAX_BYTES:
                raise LogFormatError(f"{self._file}: unpacks to more than {MAX_BYTES} bytes; unpack it, and read it in chunks")
            if len(values):
                yield self._table(values, seconds, list(ticks.T), marks, spot=":{}", header=tuple(sheet.header))
            block = _block(self._file, text)
        check_count(self._file, rows)


def _block(file: Path, text: TextIOWrapper) -> list[str]:
    """Return the next lines of a file; a file without line ends is never read whole."""
    block = list(islice(iter(partial(text.readline, MAX_LINE), ""), BLOCK_ROWS))
    if max(map(len, block), default=0) == MAX_LINE:
        raise LogFormatError(f"{file}: a line is longer than {MAX_LINE} characters; is it a CSV file?")
    return block


def _cells(
    sheet: Sheet, block: list[str], line: int
) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, "n c"], Int[np.ndarray, " n"]]:
    """Return the requested columns of a block, its clock, and the line number of each row; the first line has number ``line``."""
    with suppress(ValueError):
        values, ticks = _by_numpy(sheet, block)
        if len(values) == len(block):  # numpy passes over blank lines
            return values, ticks, np.arange(line, line + len(block))
    rows, width = sheet.style.data(block, line), len(sheet.header)
    for number, row in rows:
        if len(row) < width or any(row[width:]):
            raise ShapeMismatch(f"{sheet.style.file}:{number}: {len(row)} cells, the header has {width}; mend or remove the line")
    values = _one_by_one(sheet, rows, sheet.places, float)
    return values, _one_by_one(sheet, rows, sheet.clock_places, sheet.kind), np.array([number for number, _ in rows], dtype=int)


def _by_numpy(sheet: Sheet, block: list[str]) -> tuple[Shaped[np.ndarray, "n k"], Shaped[np.ndarray, "n c"]]:
    """Return the requested columns and the clock of a block of rows of the same length, without quotes.

    Raises:
        ValueError: If the rows are others.
    """
    mark, width = sheet.style.separator, len(sheet.header)
    if sheet.kind is datetime or mark is None or {row.count(mark) for row in block} != {width - 1} or '"' in "".join(block):
        raise ValueError
    lines = [row.replace(",", ".") for row in block] if sheet.style.decimal == "," else block
    take = partial(np.loadtxt, lines, delimiter=mark, comments=None, ndmin=2)
    if sheet.kind is int:
        return take(usecols=sheet.places), take(dtype=int, usecols=sheet.clock_places)
    both = take(usecols=[*sheet.places, *sheet.clock_places])
    return both[:, : len(sheet.places)], both[:, len(sheet.places) :]


def _one_by_one(sheet: Sheet, rows: list[Row], places: list[int], kind: type) -> Shaped[np.ndarray, "n k"]:
    """Return columns cell by cell."""
    convert: Callable[[str], float] = {float: sheet.style.number, datetime: sheet.style.moment}.get(kind, int)
    values = np.empty((len(rows), len(places)), dtype=float if kind is float else int)
    for j, place in enumerate(places):
        for i, (line, row) in enumerate(rows):
            try:
                values[i, j] = convert(row[place])
            except (ValueError, OverflowError):
                number = "a number (decimals have a point)" if "," in row[place] else "a number"
                what = {int: "a whole number", datetime: "an ISO 8601 time; or give --period"}.get(kind, number)
                where, text = f"{sheet.style.file}:{line}: column '{sheet.header[place]}'", listed((row[place],))
                raise LogFormatError(f"{where} holds '{text}', not {what}") from None
    return values
