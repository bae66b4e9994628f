"""Journal of a sweep: one JSON line per finished run, synchronised to disk before the run counts as done.

The first line identifies the sweep; runs of another sweep are rejected. Each line carries a checksum, and the seed that
belongs to its index. An incomplete last line, left by a kill, is dropped.

Rows stay in the file: memory holds eight bytes per run, the place of its line.
"""

import errno
import json
import os
import zlib
from array import array
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from treadline.campaign._pool import Row
from treadline.campaign._sobol_sampling import run_seed
from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.io.runs import JOURNAL

CHECKSUM = b', "crc32": "'
"""Text in front of a line's checksum, which is the last value of its object."""

NOT_OURS = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR)
"""Errors of a folder without write permission, independent of free space."""


class Journal:
    """Journal of a folder, open for appending; iteration yields the rows by index."""

    def __init__(self, folder: Path, sweep: Mapping[str, Any], runs: int, *, resume: bool) -> None:
        """Open or create the journal.

        Args:
            folder: Folder of the sweep.
            sweep: Identity of the sweep.
            runs: Number of runs of the sweep; further runs of a longer sweep are checked and left out.
            resume: Whether to continue an existing journal.

        Raises:
            SettingsError: If a journal exists and ``resume`` is false, or the journal belongs to another sweep.
            LogFormatError: If a line of the journal is damaged, or is not a run of the sweep.
        """
        self._path = folder / JOURNAL
        self._sweep = sweep
        self._places = array("q", bytes(8 * runs))
        self._read_up_to = 0
        if self._path.exists() and not resume:
            raise SettingsError(f"{self._path}: a sweep is there already; go on with --resume, or give another --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("ab", buffering=0)
            self._lines = self._path.open("rb")
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            self._lock()  # before reading, so that lines appended by another process until it ends are included
            self.reload()
            self._file.truncate(self._read_up_to)
            if not self._read_up_to:
                self.add(sweep)
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._lines.close()

    def __len__(self) -> int:
        return sum(place > 0 for place in self._places)

    def __contains__(self, index: int) -> bool:
        return self._places[index] > 0

    def __getitem__(self, index: int) -> Row:
        self._lines.seek(self._places[index])
        row: Row = json.loads(self._lines.readline())
        del row["crc32"]
        return row

    def __iter__(self) -> Iterator[Row]:
        return (self[index] for index in range(len(self._places)) if index in self)

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a finished run.

        Raises:
            TreadlineError: If the file cannot be written, for example on a full disk; earlier lines stay readable.
        """
        content = json.dumps(row, allow_nan=False).encode()
        line = content[:-1] + CHECKSUM + _crc(content) + b'"}\n'
        try:
            # A disk may fill up within a line: an unbuffered write returns the bytes written, and the next write the error.
            written = self._file.write(line)
            while written < len(line):
                written += self._file.write(line[written:])
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(self._read_up_to)
            raise self._unwritable(error) from None
        self.reload()

    def reload(self) -> None:
        """Read the lines that are new on disk: an interrupt may have come between writing and reading a line."""
        self._lines.seek(self._read_up_to)
        for number, line in enumerate(self._lines, 1):
            if not line.endswith(b"\n"):
                return
            value = self._value(number, line)
            if self._read_up_to:
                self._place(number, value)
            else:
                self._check_identity(value)
            self._read_up_to += len(line)

    def _place(self, number: int, row: Row) -> None:
        """Check a row against the sweep, and keep the place of its line."""
        index, seed = row.get("index"), row.get("seed")
        problem = None
        if type(index) is not int or index < 0:
            problem = f"no run has the index {index}"
        elif not isinstance(row.get("verdict"), str):
            problem = f"run {index} has no verdict"
        elif seed != (expected := run_seed(self._sweep["seed"], index)):
            problem = f"run {index} has the seed {seed}, in this sweep {expected}"
        elif index < len(self._places):
            if self._places[index] not in (0, self._read_up_to):
                problem = f"run {index} is there twice"
            else:
                self._places[index] = self._read_up_to
        if problem:
            raise self._damaged(number, problem)

    def _value(self, number: int, line: bytes) -> dict[str, Any]:
        content, found, checksum = line.rpartition(CHECKSUM)
        if checksum != _crc(content + b"}") + b'"}\n':
            raise self._damaged(number, "the checksum does not match" if found else "the line has no checksum")
        try:
            value: dict[str, Any] = json.loads(content + b"}")
        except (ValueError, RecursionError) as error:
            raise self._damaged(number, f"not JSON that can be read: {error}") from None
        return value

    def _damaged(self, number: int, problem: str) -> LogFormatError:
        return LogFormatError(f"{self._path}:{number}: {problem}; remove the line to run it again, or give another --out")

    def _check_identity(self, there: Mapping[str, Any]) -> None:
        for name, value in self._sweep.items():
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
            f"{self._path}: cannot be written: {error.strerror or error}; {len(self)} runs are kept there: {remedy}"
        )


def _crc(line: bytes) -> bytes:
    return f"{zlib.crc32(line):08x}".encode()
