"""NPZ files, and the columns of named arrays in NPZ and MAT files.

A vector is a column by its name, a column of a matrix is ``name[0]``, ``name[1]`` (rows are samples), a struct field is
``struct.field``. Header sizes are checked against the archive directory; nothing is unpickled, object arrays are rejected.
"""

import re
import zipfile
import zlib
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
from jaxtyping import Shaped
from numpy.lib import format as npy

from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.io._tables import NANOSECONDS, Table, check_count, clock_of, missing, seconds_of

MAX_ARRAY_BYTES = 1024**3
"""Largest decompressed size of all requested arrays of a file together [bytes]."""

_PLACE = re.compile(r"\[(\d{1,6})\]$")


def name_of(column: str) -> str:
    """Return the array name of a column."""
    return _PLACE.sub("", column)


def table_of(
    file: Path, wanted: tuple[str, ...], there: Collection[str], array: Callable[[str], Shaped[np.ndarray, "..."]]
) -> Table:
    """Return the requested columns as one table; ``array`` reads one array by name."""
    clock = clock_of(list(there), wanted)
    every = {name: array(name) for name in dict.fromkeys([*map(name_of, wanted), *([clock] if clock else [])])}
    columns = {name: _column(file, name, every[name_of(name)]) for name in wanted}
    ticks = None if clock is None else _ticks(file, clock, _column(file, clock, every[clock]))
    lengths = {name: len(values) for name, values in columns.items()} | ({} if ticks is None else {str(clock): len(ticks)})
    if len(set(lengths.values())) > 1:
        first, *others = lengths.items()
        name, length = next(item for item in others if item[1] != first[1])
        raise ShapeMismatch(f"{file}: '{first[0]}' has {first[1]} rows, '{name}' has {length}; cut them to one length")
    rows = next(iter(lengths.values()), 0)
    check_count(file, rows)
    values = np.column_stack([column.astype(float) for column in columns.values()] or [np.empty((rows, 0))])
    return Table(
        file=file,
        names=wanted,
        values=values,
        clock=clock,
        t_s=None if ticks is None else seconds_of(ticks, int(ticks[0]) if ticks.dtype.kind == "i" else 0),
        marks=np.arange(1, rows + 1),
    )


def check_kind(file: Path, name: str, kind: np.dtype) -> None:
    """Reject arrays of other types than real numbers."""
    if kind.kind not in "biuf":
        raise LogFormatError(f"{file}: '{name}' holds {kind}, not real numbers; save it as a plain array of numbers")


def check_bytes(file: Path, size: int) -> None:
    """Reject data larger than the memory limit."""
    if size > MAX_ARRAY_BYTES:
        raise LogFormatError(f"{file}: unpacks to {size} bytes; at most {MAX_ARRAY_BYTES} are read: save it as Parquet or CSV")


def _column(file: Path, column: str, values: Shaped[np.ndarray, "..."]) -> Shaped[np.ndarray, " n"]:
    name, found = name_of(column), _PLACE.search(column)
    place = int(found[1]) if found else None
    if values.ndim <= 2 and values.size == max(values.shape, default=0) and place in {None, 0}:
        return values.reshape(-1)  # MATLAB stores a vector as a matrix with one row or one column
    if values.ndim != 2:
        raise ShapeMismatch(f"{file}: '{name}' has {values.ndim} dimensions; a vector or a matrix is needed")
    rows, count = values.shape
    if rows < count:
        raise ShapeMismatch(f"{file}: '{name}' is {rows} x {count}, but rows are samples; is it transposed?")
    if place is None or place >= count:
        raise LogFormatError(f"{file}: '{column}': '{name}' has {count} columns: {name}[0] to [{count - 1}]")
    return values[:, place]


def _ticks(file: Path, clock: str, values: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, " n"]:
    if clock not in NANOSECONDS:
        return values.astype(float)
    if values.dtype.kind not in "iu":
        raise LogFormatError(f"{file}: '{clock}' holds {values.dtype}; nanoseconds are whole numbers: save them as int64")
    return values.astype(np.int64)


# Exceptions raised for damaged archives; zipfile has no common base class.
_BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    EOFError,
    OSError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
    MemoryError,
)


def read_npz(file: Path, wanted: tuple[str, ...]) -> Table:
    """Return the requested columns of an NPZ file.

    Raises:
        LogFormatError: If the file is damaged, too large, or has non-numeric columns.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = {item.filename.removesuffix(".npy"): item for item in archive.infolist() if item.filename.endswith(".npy")}
            for name in wanted:
                if name_of(name) not in members:
                    raise missing(file, name, members)
            check_bytes(file, sum(members[name].file_size for name in {name_of(name) for name in wanted}))
            return table_of(file, wanted, members, lambda name: _array(file, archive, members[name]))
    except _BROKEN as error:
        raise LogFormatError(f"{file}: not a valid NPZ file: {error}; is it truncated or modified?") from None


def _array(file: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Shaped[np.ndarray, "..."]:
    name = member.filename.removesuffix(".npy")
    check_bytes(file, member.file_size)
    with archive.open(member) as stream:
        header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        shape, in_columns, kind = header(stream)
        check_kind(file, name, kind)
        data = stream.read()  # zipfile verifies the checksum, and stops at the size in the directory
    return np.frombuffer(data, kind).reshape(shape, order="F" if in_columns else "C")
