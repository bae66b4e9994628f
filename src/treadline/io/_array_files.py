"""Files of named arrays: NPZ files, and MAT files of versions 4 to 7.

A vector is a column by its name, a column of a matrix is ``name[0]``, ``name[1]`` (rows are samples), a struct field is
``struct.field``. Header sizes are checked against the archive directory; nothing is unpickled, object arrays are rejected.

MAT version 5 (MATLAB's -v6 and -v7) is parsed here: scipy's compiled parser trusts type codes of a damaged file and crashes the
process (decision 0008). A variable is never larger than its bytes in the file, and decompression has a size limit. Format:
MathWorks, MAT-File Format, level 5. An element is a tag (type, bytes) and its data, padded to 8 bytes.
"""

import io
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Shaped
from numpy.lib import format as npy

from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.io._clock import Seconds, Ticks, clocks_of, period_in
from treadline.io._tables import MAX_BYTES, Table, check_count, listed, place_of

_Read = Callable[[str], Shaped[np.ndarray, "..."]]
"""Function from the name of an array to the array."""
_PLACE = re.compile(r"\[(\d{1,6})\]$")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_COMPRESSED = 15
"""Type of an element that holds another one, compressed."""
_OPAQUE = 17
"""Class of a variable that holds an object."""
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}


def _if_numeric(array: _Read, name: str) -> np.ndarray:
    """Return an array; one without numbers, as a clock of text, is empty: no channel, and no reason to reject the file."""
    try:
        return array(name)
    except LogFormatError:
        return np.empty(0)


def _table_of(file: Path, wanted: tuple[str, ...], there: Sequence[str], array: _Read, period_s: float | None) -> Table:
    """Return the requested columns as one table; a matrix asked for by its name gives all its columns."""
    names = [there[place_of(file, _PLACE.sub("", column), there)] for column in wanted]
    chosen = [_columns(file, column, array(name)) for column, name in zip(wanted, names, strict=True)]
    columns = [item for part in chosen for item in part]
    for name, values in columns:
        _check_kind(file, name, values.dtype)
    read = {clock: [_if_numeric(array, name) for name in clock.columns] for clock in clocks_of(there, names)}
    clock = next((clock for clock, found in read.items() if min(values.size for values in found) > 1), None)
    ticks = []
    if clock is not None:
        ticks = [_columns(file, name, values)[0] for name, values in zip(clock.columns, read[clock], strict=True)]
        clock = replace(clock, per_s=1e9) if ticks[0][1].dtype.kind in "mM" else clock
    lengths = [(name, len(values)) for name, values in (*columns, *ticks)]
    other = next((item for item in lengths if item[1] != lengths[0][1]), None)
    if other is not None:
        raise ShapeMismatch(
            f"{file}: '{lengths[0][0]}' has {lengths[0][1]} rows, '{other[0]}' has {other[1]}; cut them to one length"
        )
    rows = lengths[0][1] if lengths else 0
    check_count(file, rows)
    stated = [(name, _if_numeric(array, name)) for name in there if period_in(name, 1.0) is not None]
    periods = [period_in(name, float(values.item())) for name, values in stated if values.size == 1]
    return Table(
        file=file,
        names=tuple(name for name, _ in columns),
        values=np.column_stack([column.astype(float) for _, column in columns] or [np.empty((rows, 0))]),
        clock=None if clock is None else clock.name,
        t_s=None if clock is None else Seconds(file, clock, period_s).of([_ticks(values) for _, values in ticks]),
        marks=np.arange(1, rows + 1),
        header=tuple(there),
        widths=tuple(map(len, chosen)),
        period_s=next(iter(periods), None),
    )


def _check_kind(file: Path, name: str, kind: np.dtype, kinds: str = "biuf") -> None:
    """Reject arrays of other types than real numbers."""
    if kind.kind not in kinds:
        raise LogFormatError(f"{file}: '{name}' holds {kind}, not real numbers; save it as a plain array of numbers")


def _check_bytes(file: Path, size: int) -> None:
    """Reject data larger than the memory limit."""
    if size > MAX_BYTES:
        raise LogFormatError(f"{file}: unpacks to {size} bytes; at most {MAX_BYTES} are read: save it as Parquet or CSV")


def _columns(file: Path, column: str, values: Shaped[np.ndarray, "..."]) -> list[tuple[str, Shaped[np.ndarray, " n"]]]:
    """Return the column that a name means, or all columns of a matrix, with their names."""
    name, found = _PLACE.sub("", column), _PLACE.search(column)
    place = int(found[1]) if found else None
    if values.ndim <= 2 and values.size == max(values.shape, default=0) and place in {None, 0}:
        return [(column, values.reshape(-1))]  # MATLAB stores a vector as a matrix with one row or one column
    if values.ndim != 2:
        raise ShapeMismatch(f"{file}: '{name}' has {values.ndim} dimensions; a vector or a matrix is needed")
    rows, count = values.shape
    if rows < count:
        raise ShapeMismatch(f"{file}: '{name}' is {rows} x {count}, but rows are samples; is it transposed?")
    if place is None:
        return [(f"{name}[{k}]", values[:, k]) for k in range(count)]
    if place >= count:
        raise LogFormatError(f"{file}: '{column}': '{name}' has {count} columns: {name}[0] to [{count - 1}]")
    return [(column, values[:, place])]


def _ticks(values: Shaped[np.ndarray, " n"]) -> Ticks:
    """Return a column of the clock; numpy's times as whole nanoseconds."""
    kind = values.dtype.kind
    return values.astype(f"{kind}8[ns]").astype(np.int64) if kind in "mM" else values


# Exceptions raised for damaged archives; zipfile has no common base class.
_BROKEN = (zipfile.BadZipFile, zlib.error, ValueError, EOFError, OSError, RuntimeError, OverflowError, MemoryError)


def read_npz(file: Path, wanted: tuple[str, ...], period_s: float | None) -> Table:
    """Return the requested columns of an NPZ file.

    Raises:
        LogFormatError: If the file is damaged, too large, or has non-numeric columns.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = {item.filename.removesuffix(".npy"): item for item in archive.infolist() if item.filename.endswith(".npy")}
            return _table_of(file, wanted, list(members), lambda name: _array(file, archive, members[name]), period_s)
    except _BROKEN as error:
        raise LogFormatError(f"{file}: not a valid NPZ file: {listed((str(error),))}; is it truncated or modified?") from None


def _array(file: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Shaped[np.ndarray, "..."]:
    name = member.filename.removesuffix(".npy")
    _check_bytes(file, member.file_size)
    with archive.open(member) as stream:
        header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        shape, in_columns, kind = header(stream)
        _check_kind(file, name, kind, "biufmM")
        data = stream.read()  # zipfile verifies the checksum, and stops at the size in the directory
    return np.frombuffer(data, kind).reshape(shape, order="F" if in_columns else "C")


def read_mat(file: Path, wanted: tuple[str, ...], period_s: float | None) -> Table:
    """Return the requested columns of a MAT file.

    Raises:
        LogFormatError: If the file is damaged, too large, of version 7.3, or has non-numeric columns.
    """
    there = dict(_paths("", _load(file)))

    def array(path: str) -> Shaped[np.ndarray, "..."]:
        value = there[path]
        if not isinstance(value, np.ndarray):
            raise LogFormatError(f"{file}: '{path}' is not a numeric array; save it as one")
        _check_kind(file, path, value.dtype)
        return value

    return _table_of(file, wanted, list(there), array, period_s)


def _load(file: Path) -> dict[str, Any]:
    """Return the variables of a MAT file.

    Raises:
        LogFormatError: If the file is damaged, too large or of version 7.3.
    """
    _check_bytes(file, file.stat().st_size)
    data = file.read_bytes()
    try:
        if _HDF5 in (data[:8], data[512:520]):
            return _load_hdf5(file)
        if data[124:128] in {b"\x00\x01IM", b"\x01\x00MI"}:
            return _variables(data, MAX_BYTES)
        from scipy.io import loadmat

        # Version 4. A stream in memory limits every read to the file size, whatever length a damaged file declares.
        found = loadmat(cast("Any", io.BytesIO(data)))
    except LogFormatError:
        raise
    except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception in the parsers
        raise LogFormatError(
            f"{file}: not a valid MAT file: {listed((str(error) or 'it ends early',))}; is it truncated or modified?"
        ) from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _load_hdf5(file: Path) -> dict[str, Any]:
    """Return the arrays of a MAT file of version 7.3, which holds them transposed."""
    try:
        import h5py
    except ImportError:
        raise LogFormatError(
            f"{file}: MAT version 7.3 (HDF5) needs h5py: pip install h5py, or in MATLAB: save('{file.name}', …, '-v7')"
        ) from None
    found: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            _check_bytes(file, item.nbytes + sum(values.nbytes for values in found.values()))
            found[name.replace("/", ".")] = item[()].T

    with h5py.File(file) as archive:
        archive.visititems(take)
    return found


def _paths(prefix: str, values: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return all variables and struct fields with their paths."""
    every: list[tuple[str, Any]] = []
    for name, value in values.items():
        every += _paths(f"{prefix}{name}.", value) if isinstance(value, dict) else [(prefix + name, value)]
    return every


def _variables(data: bytes, most_bytes: int) -> dict[str, Any]:
    """Return the variables of a file by name.

    Raises:
        ValueError: If an element is damaged, or the decompressed size exceeds ``most_bytes``.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    found: dict[str, Any] = {}
    for element in _elements(memoryview(data)[128:], order):
        kind, body = element
        if kind == _COMPRESSED:
            plain = _inflated(body, most_bytes)
            most_bytes -= len(plain)
            kind, body = next(_elements(memoryview(plain), order))
        if kind != 14:  # a matrix
            raise ValueError(f"an element of type {kind} where a variable belongs")
        name, value = _variable(body, order, 0)
        found[name] = value
    return found


def _inflated(data: memoryview, most_bytes: int) -> bytes:
    inflate = zlib.decompressobj()
    plain = inflate.decompress(data, most_bytes + 1)
    if len(plain) > most_bytes:
        raise ValueError(f"it unpacks to more than the {most_bytes} bytes that are read")
    if not inflate.eof:
        raise ValueError("a compressed variable ends early")
    return plain


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and data of consecutive elements."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise ValueError("a tag ends early")
        kind, size = np.frombuffer(data[at : at + 8], order + "u4").tolist()
        small = kind >> 16
        if small:  # data of up to four bytes are stored inside the tag
            kind, size, at = kind & 0xFFFF, small, at + 4
            padded = 4
        else:
            at += 8
            padded = size if kind == _COMPRESSED else -(-size // 8) * 8
        if size > len(data) - at or (small and size > 4):
            raise ValueError("an element is longer than what holds it")
        yield kind, data[at : at + size]
        at += padded


def _variable(data: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Return name and value of a matrix element: array, dict (struct with one element), or None for others (text, cells)."""
    if depth > 16:
        raise ValueError("structs within structs, more than 16 deep")
    if not data:
        return "", np.empty((0, 0))
    parts = _elements(data, order)
    flags = int(_numbers(next(parts), order)[0])
    if flags & 0xFF == _OPAQUE:
        return bytes(next(parts)[1]).decode("latin-1"), None
    shape = tuple(_numbers(next(parts), order).tolist())
    name = bytes(next(parts)[1]).decode("latin-1")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"'{name}' has the shape {shape}")
    return name, _value(flags, shape, parts, order, depth)


def _value(flags: int, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], order: str, depth: int) -> Any:
    kind = flags & 0xFF
    if 6 <= kind <= 15:  # double to unsigned 64-bit integers
        values = _numbers(next(parts), order)
        is_complex = flags & 0x800
        return (values + 1j * _numbers(next(parts), order) if is_complex else values).reshape(shape, order="F")
    if kind == 2 and shape == (1, 1):  # a struct
        width = int(_numbers(next(parts), order)[0])
        names = bytes(next(parts)[1])
        fields = [names[at : at + width].split(b"\0")[0].decode("latin-1") for at in range(0, len(names), max(width, 1))]
        return {field: _variable(next(parts)[1], order, depth + 1)[1] for field in fields}
    return None


def _numbers(element: tuple[int, memoryview], order: str) -> np.ndarray:
    kind, data = element
    if kind not in _NUMBERS:
        raise ValueError(f"numbers of type {kind}")
    return np.frombuffer(data, order + _NUMBERS[kind])
