"""MAT files of versions 4 to 7, by scipy. What is compressed in one is unpacked once to be measured before scipy may read it."""

import io
import struct
import zlib
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Shaped
from scipy.io import loadmat

from treadline.errors import LogFormatError
from treadline.io.arrays import check_bytes, check_kind, name_of, table_of
from treadline.io.tables import Table, missing

_HEADER = 128
_COMPRESSED = 15
_PIECE = 1 << 20


def read_mat(file: Path, wanted: tuple[str, ...]) -> Table:
    """Return the wanted columns of a MAT file.

    Raises:
        LogFormatError: If it is broken, too large, of version 7.3, or holds something else.
    """
    every = load_mat(file)
    there = [path for name, value in every.items() for path in _paths(name, value)]
    for name in wanted:
        if name_of(name) not in there:
            raise missing(file, name, there)

    def array(path: str) -> Shaped[np.ndarray, "..."]:
        value = every
        for step in path.split("."):
            value = value[step] if isinstance(value, dict) else value[step].item()
        values: Any = value
        check_kind(file, path, values.dtype)
        return values

    return table_of(file, wanted, there, array)


def load_mat(file: Path) -> dict[str, Any]:
    """Return the variables of a MAT file as scipy gives them; structs stay structured arrays.

    Raises:
        LogFormatError: If it is broken, too large or of version 7.3.
    """
    try:
        check_bytes(file, file.stat().st_size)
        data = file.read_bytes()
        check_bytes(file, _unpacked(data))
        # A stream in memory gives no more than it has, whatever length a broken file asks for.
        found = loadmat(cast("Any", io.BytesIO(data)))
    except NotImplementedError:
        raise LogFormatError(f"{file}: MAT version 7.3 (HDF5) is not read; in MATLAB: save('{file.name}', …, '-v7')") from None
    except LogFormatError:
        raise
    except Exception as error:  # noqa: BLE001 - scipy's parser meets broken bytes with whatever they cause
        raise LogFormatError(
            f"{file}: not a whole MAT file: {' '.join(str(error).split())}; was it cut short or changed?"
        ) from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _paths(name: str, value: Any) -> list[str]:
    """Return the name of a variable, or those of the fields of a struct."""
    if not isinstance(value, np.ndarray) or value.dtype.names is None or value.size != 1:
        return [name]
    inner = value.reshape(-1)[0]
    return [path for field in value.dtype.names for path in _paths(f"{name}.{field}", inner[field])]


def _unpacked(data: bytes) -> int:
    """Return the size of all elements of a version 5 file; other versions are not compressed."""
    if len(data) < _HEADER or data[126:128] not in {b"IM", b"MI"} or data[:4] == b"\0\0\0\0":
        return len(data)
    order = "<" if data[126:128] == b"IM" else ">"
    total, at = 0, _HEADER
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        total += _inflated(data[at + 8 : at + 8 + size]) if kind == _COMPRESSED else size
        at += 8 + size
    return total


def _inflated(data: bytes) -> int:
    inflate, total = zlib.decompressobj(), 0
    piece = inflate.decompress(data, _PIECE)
    while piece:
        total += len(piece)
        piece = inflate.decompress(inflate.unconsumed_tail, _PIECE)
    return total
