"""MAT files of versions 4 to 7: columns by ``name``, ``name[0]`` and ``struct.field``."""

import io
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Shaped

from treadline.core.errors import LogFormatError
from treadline.io.arrays import MAX_ARRAY_BYTES, check_bytes, check_kind, name_of, table_of
from treadline.io.mat5 import variables
from treadline.io.tables import Table, missing

_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_mat(file: Path, wanted: tuple[str, ...]) -> Table:
    """Return the requested columns of a MAT file.

    Raises:
        LogFormatError: If the file is damaged, too large, of version 7.3, or has non-numeric columns.
    """
    there = dict(_paths("", load_mat(file)))
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


def load_mat(file: Path) -> dict[str, Any]:
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
            return variables(data, MAX_ARRAY_BYTES)
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
