"""What is done, kept whatever happens: one JSON line per finished run, on disk before the next is counted.

The first line says which sweep it is; another may not be added to it. A last line cut short by a kill is dropped.
"""

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from treadline.campaign.run import Row
from treadline.errors import SettingsError, TreadlineError

NAME = "journal.jsonl"

NOT_OURS = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR)
"""Errors of a folder that nobody may write to, however much room there is."""


class Journal:
    """The journal of a folder, open for more."""

    def __init__(self, folder: Path, sweep: Mapping[str, Any], *, resume: bool) -> None:
        """Open it.

        Raises:
            SettingsError: If there is one and ``resume`` is not asked for, or it is another sweep's, or broken.
        """
        self._path = folder / NAME
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
            self._lock()  # before it is read: what another sweep adds until it ends is kept
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
        """Keep a finished run.

        Raises:
            TreadlineError: If the disk takes no more; what was kept before stays readable.
        """
        self._append(row)
        self.rows[row["index"]] = row

    def look_again(self) -> None:
        """Take what is on disk for what is done: Ctrl-C may have fallen between a line and the note of it."""
        self._read(self._sweep)

    def _append(self, value: Mapping[str, Any]) -> None:
        line = json.dumps(value, allow_nan=False).encode() + b"\n"
        whole = os.fstat(self._file.fileno()).st_size
        try:
            # A disk may fill in the middle of a line: an unbuffered write says how much it took, and the next one why.
            written = self._file.write(line)
            while written < len(line):
                written += self._file.write(line[written:])
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(whole)
            raise self._unwritable(error) from None

    def _read(self, sweep: Mapping[str, Any]) -> int:
        """Read what is kept; return its length in bytes, a line cut short left out."""
        data = self._path.read_bytes()
        whole = data.rfind(b"\n") + 1
        lines = data[:whole].splitlines()
        for number, line in enumerate(lines, 1):
            try:
                value = json.loads(line)
            except ValueError:
                value = None
            if not isinstance(value, dict) or (number > 1 and not isinstance(value.get("index"), int)):
                raise SettingsError(f"{self._path}:{number}: no line of a sweep's journal; give another --out")
            if number > 1:
                self.rows[value["index"]] = value
            else:
                self._must_be(sweep, value)
        return whole

    def _must_be(self, sweep: Mapping[str, Any], there: Mapping[str, Any]) -> None:
        for name, value in sweep.items():
            if there.get(name) != value:
                raise SettingsError(
                    f"{self._path}: the sweep there has {name} {there.get(name)}, this one {value}; "
                    "resume with what it was started with, or give another --out"
                )

    def _lock(self) -> None:
        """Two sweeps must not write one journal; where the system has no such locks, nothing tells."""
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
