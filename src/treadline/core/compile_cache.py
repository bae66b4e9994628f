"""Compiled kernels: the time that this process spends compiling, a mark that the cache is complete, and a lock to fill it once.

numba compiles a kernel at its first call on a machine and writes the result next to the source file, or into ``NUMBA_CACHE_DIR``.
Measured speeds exclude this time, and a command that compiles for long says so. Two processes that start with an empty cache
compile every kernel twice; the lock prevents that.
"""

import hashlib
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba.core.event import Event, Listener, register

from treadline.core.errors import TreadlineError
from treadline.core.kernel_cache import REMEDY, kernel_sources

SUFFIX = ".nbs"
"""Suffix of the marker: removing numba's files ``*.nb?`` removes the marker too."""
LONG_S = 1.0
"""CPU time of compiling that counts as long [s]; loading every kernel from disk compiles nothing."""


class CompileTimer(Listener):
    """Sum of the CPU time of compiling; kernels compiled on behalf of another kernel count once."""

    def __init__(self) -> None:
        self._spent_s = 0.0
        self._begun_s = 0.0
        self._depth = 0
        self._on_long: Callable[[], None] | None = None
        self._on_kernel: Callable[[], None] | None = None
        self._kernels = set[Any]()

    @property
    def spent_s(self) -> float:
        """CPU time of compiling so far [s]."""
        return self._spent_s

    def call_once_if_long(self, on_long: Callable[[], None]) -> None:
        """Call ``on_long`` once, when more than ``LONG_S`` was spent and another kernel is to be compiled."""
        self._on_long = on_long

    def call_for_each(self, on_kernel: Callable[[], None]) -> None:
        """Call ``on_kernel`` after the first compilation of each kernel; numba's own functions do not count."""
        self._on_kernel = on_kernel

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Start the clock at the outermost kernel."""
        self._depth += 1
        if self._depth > 1:
            return
        self._begun_s = time.process_time()
        if self._on_long is not None and self._spent_s > LONG_S:
            self._on_long()
            self._on_long = None

    def on_end(self, event: Event) -> None:
        """Stop the clock at the outermost kernel."""
        self._depth -= 1
        if self._depth == 0:
            self._spent_s += time.process_time() - self._begun_s
        kernel = event.data["dispatcher"].py_func
        if self._on_kernel is not None and kernel.__module__.startswith("treadline.") and kernel not in self._kernels:
            self._kernels.add(kernel)
            self._on_kernel()


@cache
def compiling() -> CompileTimer:
    """Return this process's timer, which counts from the first call of this function."""
    timer = CompileTimer()
    register("numba:compile", timer)
    return timer


def marker_path() -> Path:
    """Return the marker's path; its name changes with the kernels' sources, the compiler and the processor.

    Raises:
        TreadlineError: If no folder for compiled kernels can be written.
    """
    try:
        place: Any = numba.njit(cache=True)(marker_path).stats.cache_path  # where numba keeps the kernels of this folder
    except RuntimeError:
        raise TreadlineError(f"no folder for compiled kernels can be written: {REMEDY}") from None
    return Path(place) / f"compiled-{_fingerprint()}{SUFFIX}"


def _fingerprint() -> str:
    """Return a hash of what numba's index depends on: times and sizes of the kernels' sources, versions, processor."""
    host: Any = binding  # llvmlite has no type hints
    processor = [host.get_host_cpu_name(), host.get_host_cpu_features().flatten()]
    parts = [numba.__version__, llvmlite.__version__, sys.version, *processor]
    for path in kernel_sources():
        source = path.stat()
        parts.append(f"{path}:{source.st_mtime_ns}:{source.st_size}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file; another process that asks for the lock waits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if sys.platform == "win32":
            import msvcrt

            file.seek(0)
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
