"""NPZ files: arrays read directly from the archive, with header sizes checked against the archive directory.

Nothing is unpickled; object arrays are rejected.
"""

import zipfile
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Shaped
from numpy.lib import format as npy

from treadline.core.errors import LogFormatError
from treadline.io.arrays import check_bytes, check_kind, name_of, table_of
from treadline.io.tables import Table, missing

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
