"""MAT files of versions 4 to 7: columns by ``name``, ``name[0]`` and ``struct.field``.

Version 5 (MATLAB's -v6 and -v7) is parsed here: scipy's compiled parser trusts type codes of a damaged file and crashes the process
(decision 0028). A variable is never larger than its bytes in the file, and decompression has a size limit.

Format: MathWorks, MAT-File Format, level 5. An element is a tag (type, bytes) and its data, padded to 8 bytes.
"""

import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Shaped

from treadline.core.errors import LogFormatError
from treadline.io._array_files import MAX_ARRAY_BYTES, check_bytes, check_kind, name_of, table_of
from treadline.io._tables import Table, missing

_HDF5 = b"\x89HDF\r\n\x1a\n"
_COMPRESSED = 15
"""Type of an element that holds another one, compressed."""
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "latin-1", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def read_mat(file: Path, wanted: tuple[str, ...]) -> Table:
    """Return the requested columns of a MAT file.

    Raises:
        LogFormatError: If the file is damaged, too large, of version 7.3, or has non-numeric columns.
    """
    there = dict(_paths("", _load(file)))
    for name in wanted:
        if name_of(name) not in there:
            raise missing(file, name, there)

    def array(path: str) -> Shaped[np.ndarray, "..."]:
        value = there[path]
        if not isinstance(value, np.ndarray):
            raise LogFormatError(f"{file}: '{path}' is not a numeric array; save it as one")
        check_kind(file, path, value.dtype)
        return value

    return table_of(file, wanted, there, array)


def _load(file: Path) -> dict[str, Any]:
    """Return the variables of a MAT file.

    Raises:
        LogFormatError: If the file is damaged, too large or of version 7.3.
    """
    check_bytes(file, file.stat().st_size)
    data = file.read_bytes()
    if _HDF5 in (data[:8], data[512:520]):
        raise LogFormatError(f"{file}: MAT version 7.3 (HDF5) is not read; in MATLAB: save('{file.name}', …, '-v7')")
    try:
        if data[124:128] in {b"\x00\x01IM", b"\x01\x00MI"}:
            return _variables(data, MAX_ARRAY_BYTES)
        from scipy.io import loadmat

        # Version 4. A stream in memory limits every read to the file size, whatever length a damaged file declares.
        found = loadmat(cast("Any", io.BytesIO(data)))
    except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception in the parsers
        cause = " ".join(str(error).split())[:200] or "it ends early"
        raise LogFormatError(f"{file}: not a valid MAT file: {cause}; is it truncated or modified?") from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


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
    """Return name and value of a matrix element: array, text, list (cell), dict (struct with one element), or None for others."""
    if depth > 16:
        raise ValueError("structs within structs, more than 16 deep")
    if not data:
        return "", np.empty((0, 0))
    parts = _elements(data, order)
    flags = int(_numbers(next(parts), order)[0])
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
    if kind == 4 and shape[0] <= 1:  # text
        code, text = next(parts, (1, b""))
        codec = _TEXT[code] + {"<": "-le", ">": "-be"}[order] if _TEXT[code].startswith(("utf-16", "utf-32")) else _TEXT[code]
        return bytes(text).decode(codec, "replace")
    if kind == 1:  # cells
        return [_variable(body, order, depth + 1)[1] for _, body in parts]
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
