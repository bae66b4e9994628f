"""Journal of a sweep: one JSON line per finished run, synchronised to disk before the run counts as done.

The first line identifies the sweep; runs of another sweep are rejected. Each line carries a checksum. An incomplete last line, left
by a kill, is dropped.
"""

import errno
import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from treadline.campaign._pool import Row
from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.io.runs import JOURNAL

CHECKSUM = b', "crc32": "'
"""Text in front of a line's checksum, which is the last value of its object."""

NOT_OURS = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR)
"""Errors of a folder without write permission, independent of free space."""


class Journal:
    """Journal of a folder, open for appending."""

    def __init__(self, folder: Path, sweep: Mapping[str, Any], *, resume: bool) -> None:
        """Open or create the journal.

        Args:
            folder: Folder of the sweep.
            sweep: Identity of the sweep.
            resume: Whether to continue an existing journal.

        Raises:
            SettingsError: If a journal exists and ``resume`` is false, or the journal belongs to another sweep.
            LogFormatError: If a line of the journal is damaged.
        """
        self._path = folder / JOURNAL
        self._sweep = sweep
        self.rows: dict[int, Row] = {}
        there = self._path.exists()
        if there and not resume:
            raise SettingsError(f"{self._path}: a sweep is there already; go on with --resume, or give another --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = self._path.open("ab", buffering=0)
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            self._lock()  # before reading, so that lines appended by another process until it ends are included
            kept = self._read(sweep) if there else 0
            self._file.truncate(kept)
            if not kept:
                self._append(sweep)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._file.close()

    def add(self, row: Row) -> None:
        """Append a finished run.

        Raises:
            TreadlineError: If the file cannot be written, for example on a full disk; earlier lines stay readable.
        """
        self._append(row)
        self.rows[row["index"]] = row

    def reload(self) -> None:
        """Read the rows from disk again: an interrupt may have come between the write and the update of ``rows``."""
        self._read(self._sweep)

    def _append(self, value: Mapping[str, Any]) -> None:
        line = _sealed(json.dumps(value, allow_nan=False).encode()) + b"\n"
        whole = os.fstat(self._file.fileno()).st_size
        try:
            # A disk may fill up within a line: an unbuffered write returns the bytes written, and the next write the error.
            written = self._file.write(line)
            while written < len(line):
                written += self._file.write(line[written:])
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(whole)
            raise self._unwritable(error) from None

    def _read(self, sweep: Mapping[str, Any]) -> int:
        """Read the rows; return the length in bytes without an incomplete last line."""
        data = self._path.read_bytes()
        whole = data.rfind(b"\n") + 1
        for number, line in enumerate(data[:whole].splitlines(), 1):
            value = self._value(number, line)
            if number == 1:
                self._check_identity(sweep, value)
            else:
                self.rows[value["index"]] = value
        return whole

    def _value(self, number: int, line: bytes) -> dict[str, Any]:
        content, found, checksum = line.rpartition(CHECKSUM)
        if checksum != _crc(content + b"}") + b'"}':
            problem = "the checksum does not match" if found else "the line has no checksum"
            raise LogFormatError(f"{self._path}:{number}: {problem}; remove the line to run it again, or give another --out")
        value: dict[str, Any] = json.loads(content + b"}")
        return value

    def _check_identity(self, sweep: Mapping[str, Any], there: Mapping[str, Any]) -> None:
        for name, value in sweep.items():
            if there.get(name) != value:
                raise SettingsError(
                    f"{self._path}: the sweep there has {name} {there.get(name)}, this one {value}; "
                    "resume with what it was started with, or give another --out"
                )

    def _lock(self) -> None:
        """Lock the journal against a second process, on systems with file locks."""
        try:
            import fcntl
        except ImportError:
            return
        try:
            fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SettingsError(f"{self._path}: another sweep is writing it; wait for its end, or give another --out") from None

    def _unwritable(self, error: OSError) -> TreadlineError:
        remedy = "give another --out" if error.errno in NOT_OURS else "make room and go on with --resume"
        return TreadlineError(
            f"{self._path}: cannot be written: {error.strerror or error}; {len(self.rows)} runs are kept there: {remedy}"
        )


def _sealed(line: bytes) -> bytes:
    """Return a JSON object with the CRC-32 of its text as last value."""
    return line[:-1] + CHECKSUM + _crc(line) + b'"}'


def _crc(line: bytes) -> bytes:
    return f"{zlib.crc32(line):08x}".encode()
