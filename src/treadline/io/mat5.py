"""Variables of a MAT file of version 5 (MATLAB's -v6 and -v7): numbers, text, cells and structs.

scipy's compiled parser trusts type codes of a damaged file and crashes the process; this parser checks them. A variable is never
larger than its bytes in the file, and decompression has a size limit.

Format: MathWorks, MAT-File Format, level 5. An element is a tag (type, bytes) and its data, padded to 8 bytes.
"""

import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "latin-1", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _CHAR = 1, 2, 4
_NUMERIC = range(6, 16)
_COMPLEX = 0x800
_DEEPEST = 16
"""Largest nesting depth of structs."""

Variable = Any
"""Array, text, list (cell), dict (struct with one element), or None for other types (sparse, functions, objects)."""


def variables(data: bytes, most_bytes: int) -> dict[str, Variable]:
    """Return the variables of a file by name.

    Raises:
        ValueError: If an element is damaged, or the decompressed size exceeds ``most_bytes``.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    found: dict[str, Variable] = {}
    for element in _elements(memoryview(data)[_HEADER:], order):
        kind, body = element
        if kind == _COMPRESSED:
            plain = _inflated(body, most_bytes)
            most_bytes -= len(plain)
            kind, body = next(_elements(memoryview(plain), order))
        if kind != _MATRIX:
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


def _variable(data: memoryview, order: str, depth: int) -> tuple[str, Variable]:
    """Return name and value of a matrix element."""
    if depth > _DEEPEST:
        raise ValueError(f"structs within structs, more than {_DEEPEST} deep")
    if not data:
        return "", np.empty((0, 0))
    parts = _elements(data, order)
    flags = int(_numbers(next(parts), order)[0])
    shape = tuple(_numbers(next(parts), order).tolist())
    name = bytes(next(parts)[1]).decode("latin-1")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"'{name}' has the shape {shape}")
    return name, _value(flags, shape, parts, order, depth)


def _value(flags: int, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], order: str, depth: int) -> Variable:
    kind = flags & 0xFF
    if kind in _NUMERIC:
        values = _numbers(next(parts), order)
        return (values + 1j * _numbers(next(parts), order) if flags & _COMPLEX else values).reshape(shape, order="F")
    if kind == _CHAR and shape[0] <= 1:
        code, text = next(parts, (1, b""))
        codec = _TEXT[code] + {"<": "-le", ">": "-be"}[order] if _TEXT[code].startswith(("utf-16", "utf-32")) else _TEXT[code]
        return bytes(text).decode(codec, "replace")
    if kind == _CELL:
        return [_variable(body, order, depth + 1)[1] for _, body in parts]
    if kind == _STRUCT and shape == (1, 1):
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
