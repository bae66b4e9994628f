"""Layout of a text file with a table: separator, decimal mark, header, first row and clock, found from its first lines.

The separator and the decimal mark are those that make the most cells numbers. The header is the line that holds the columns asked
for, commented out or not; lines above it are a preamble. A line without numbers between header and data holds units. In a file
without a header, columns are numbered from 0.
"""

import csv
import math
import re
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from statistics import mode

from treadline.core.errors import LogFormatError
from treadline.io._clock import TimeColumn, clocks_of
from treadline.io._tables import alike_of, place_of

SAMPLE = 200
"""Number of lines in which a header is looked for: preambles of loggers have a screen or two."""
COUNTED = 20
"""Number of lines, the last of them, from which the separator is found."""
DIGITS = 15
"""Digits that a float keeps."""
_SEPARATORS = ("\t", ";", "|", ",", None)
"""Separators; None stands for blanks. A comma may also be the decimal mark."""
_COMMENT = re.compile(r"^\s*(#|%|//)\s*")
_BLANKS = re.compile(r"\s+(?![\[(])")
"""Separator of cells in a file with blanks; a unit in brackets belongs to its name."""
_WORDS = dict.fromkeys(("", "na", "n/a", "#n/a", "-", "--", "null", "none"), math.nan) | {"true": 1.0, "false": 0.0}
"""Values of words in the place of numbers."""

Row = tuple[int, list[str]]
"""Number of the line, and cells."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How a file writes cells and numbers."""

    file: Path
    separator: str | None
    decimal: str

    def number(self, text: str) -> float:
        """Return the number in a cell: the exponent may be a D, and words stand for true, false and a gap."""
        text = text.strip() if self.decimal == "." else text.strip().replace(",", ".")
        try:
            return float(text)
        except ValueError:
            word = text.casefold()
            return _WORDS[word] if word in _WORDS else float(word.replace("d", "e"))

    def moment(self, text: str) -> int:
        """Return an ISO 8601 time, or a time of day, in nanoseconds since 1970, to the microsecond; without an offset it is UTC."""
        text = text.strip().replace("/", "-")
        time = datetime.fromisoformat(f"1970-01-01T{text}" if text[2:3] == ":" else text)
        since = (time if time.tzinfo else time.replace(tzinfo=UTC)) - datetime.fromtimestamp(0, UTC)
        return since // timedelta(microseconds=1) * 1000

    def rows(self, lines: Sequence[str], line: int) -> list[Row]:
        """Return the rows that are not empty; ``line`` is the number of the first line."""
        for number, text in enumerate(lines, start=line):
            try:
                text.encode()
            except UnicodeEncodeError as error:  # a byte that is not UTF-8 was read as a surrogate
                byte = ord(text[error.start]) - 0xDC00
                raise LogFormatError(f"{self.file}:{number}: not UTF-8 (byte {byte:#04x}); save it as CSV in UTF-8") from None
        if self.separator is None:
            plain = ((number, _COMMENT.sub(r"\1", text).strip()) for number, text in enumerate(lines, start=line))
            return [(number, _BLANKS.split(text)) for number, text in plain if text]
        reader = csv.reader(lines, delimiter=self.separator)
        try:
            return [(line + reader.line_num - 1, row) for row in reader if any(map(str.strip, row))]
        except csv.Error as error:
            raise LogFormatError(f"{self.file}: not CSV: {error}") from None

    def score(self, lines: Sequence[str]) -> tuple[int, int]:
        """Return the number of cells with a number, and that of all cells where there is none."""
        with suppress(LogFormatError):
            cells = [cell for _, row in self.rows(lines, 1) for cell in row]
            numbers = sum(_holds(self.number, cell) for cell in cells)
            return numbers, 0 if numbers else len(cells)
        return 0, 0

    def data(self, lines: Sequence[str], line: int) -> list[Row]:
        """Return the rows that are neither empty nor commented out."""
        return [row for row in self.rows(lines, line) if not _is_comment(row)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Layout of a file."""

    style: Style
    header: list[str]
    first: int
    """Number of lines before the data."""
    places: list[int]
    """Places of the columns asked for."""
    clock: TimeColumn | None
    kind: type
    """Kind of the clock's cells: float, int or datetime (text)."""

    @property
    def clock_places(self) -> list[int]:
        """Places of the columns of the clock."""
        return [] if self.clock is None else [self.header.index(name) for name in self.clock.columns]


def sheet_of(file: Path, lines: Sequence[str], wanted: Sequence[str], period_s: float | None) -> Sheet:
    """Return the layout of a file from its first lines.

    Args:
        period_s: Period asked for; with it a clock that cannot be read is left out.

    Raises:
        LogFormatError: If a column asked for is not there.
    """
    styles = [Style(file=file, separator=mark, decimal=decimal) for mark in _SEPARATORS for decimal in ".,"]
    style = max(styles, key=lambda style: style.score(lines[:SAMPLE][-COUNTED:]))
    rows = style.rows(lines[:SAMPLE], 1)
    if not rows:
        raise LogFormatError(f"{file}: empty; a header and at least two rows are needed")
    head, first = _header(style, rows, wanted)
    data = [row for row in rows[first:] if not _is_comment(row)]
    if len(data) > 1 and not _is_data(style, data[0]) and _is_data(style, data[1]):
        first, data = rows.index(data[1]), data[1:]  # below a line of units
    header = [str(place) for place in range(len(data[0][1]))] if head is None else _names(rows[head])
    places = [place_of(file, name, header) for name in wanted]
    clock, kind = _clock(style, header, {header[place] for place in places}, data, period_s)
    return Sheet(style=style, header=header, first=rows[first - 1][0] if first else 0, places=places, clock=clock, kind=kind)


def _is_comment(row: Row) -> bool:
    return _COMMENT.match(row[1][0]) is not None


def _header(style: Style, rows: Sequence[Row], wanted: Sequence[str]) -> tuple[int | None, int]:
    """Return the index of the header, None without one, and that of the first row below it."""
    if not all(map(str.isdecimal, wanted)):
        order = sorted(range(len(rows)), key=lambda k: _is_comment(rows[k]))
        named = next((k for k in order if all(alike_of(name, _names(rows[k])) for name in wanted)), None)
        if named is not None:
            return named, named + 1
    width = mode(len(row[1]) for row in rows[-COUNTED:])
    first = next((k for k, row in enumerate(rows) if len(row[1]) == width and _is_data(style, row)), None)
    if first is None:
        return 0, 1
    is_named = first > 0 and len(_names(rows[first - 1])) in {width, len(_names(rows[first]))}
    return (first - 1 if is_named else None), first


def _names(row: Row) -> list[str]:
    """Return the names in a header, which may be commented out and end in empty cells."""
    names = [cell.strip() for cell in (_COMMENT.sub("", row[1][0]), *row[1][1:])]
    while not names[-1] and len(names) > 1:
        names.pop()
    return names


def _clock(
    style: Style, header: list[str], wanted: Collection[str], data: Sequence[Row], period_s: float | None
) -> tuple[TimeColumn | None, type]:
    """Return the clock and the kind of its cells: by name, else the only column of times, or the first of nameless ones."""
    cells = dict(zip(header, data[0][1], strict=False)) if data else {}
    free = [name for name in header if name not in wanted]
    numbers = [name for name in free if _holds(style.number, cells.get(name, ""))]
    times = [name for name in free if name not in numbers and _holds(style.moment, cells.get(name, ""))]
    clocks = [*clocks_of(free), *(TimeColumn(columns=(name,)) for name in times if len(times) == 1)]
    if header[0] == "0" in numbers and _are_times([row[1][0] for row in data], style):
        clocks.append(TimeColumn(columns=("0",), per_s=1.0))
    readable = [clock for clock in clocks if {*times, *numbers}.issuperset(clock.columns)]
    clock = next(iter(readable if readable or period_s is not None else clocks), None)
    if clock is None or not cells:
        return clock, float
    if clock.columns[0] not in numbers:
        return replace(clock, per_s=1e9), datetime
    digits = cells[clock.columns[0]].strip()
    return clock, int if digits.isdecimal() and (len(digits) > DIGITS or clock.per_s == 1e9) else float


def _are_times(cells: Sequence[str], style: Style) -> bool:
    """Return whether numbers are times: they increase, and are not whole as those of rows are."""
    values = [style.number(cell) for cell in cells if _holds(style.number, cell)]
    return all(b > a for a, b in pairwise(values)) and any(value % 1.0 for value in values)


def _is_data(style: Style, row: Row) -> bool:
    """Return whether a row holds a number or a time."""
    return not _is_comment(row) and any(_holds(style.number, cell) or _holds(style.moment, cell) for cell in row[1])


def _holds(convert: Callable[[str], float], cell: str) -> bool:
    """Return whether a cell is what a conversion takes, and no gap."""
    try:
        return not math.isnan(convert(cell))
    except (ValueError, OverflowError):
        return False
