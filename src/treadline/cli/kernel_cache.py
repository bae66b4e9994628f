"""Marker of a complete compiled-kernel cache, and a lock so that one process at a time fills the cache.

numba writes each kernel that it compiles next to the source file, or into ``NUMBA_CACHE_DIR``, and loads it in later processes.
Two processes that start with an empty cache compile every kernel twice; the lock prevents that.
"""

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import treadline

SUFFIX = ".nbs"
"""Suffix of the marker: removing numba's files ``*.nb?`` removes the marker too."""


def marker_path() -> Path:
    """Return the marker's path; its name changes with the kernels' sources, the compiler and the processor."""
    from treadline.core.fma import dot

    return Path(dot.stats.cache_path) / f"compiled-{_fingerprint()}{SUFFIX}"


def _fingerprint() -> str:
    """Return a hash of what numba's index depends on: times and sizes of the kernels' sources, versions, processor."""
    import llvmlite
    import numba
    from llvmlite import binding

    host: Any = binding  # llvmlite has no type hints
    processor = [host.get_host_cpu_name(), host.get_host_cpu_features().flatten()]
    parts = [numba.__version__, llvmlite.__version__, sys.version, *processor]
    for path in sorted(Path(treadline.__file__).parent.rglob("*.py")):
        if b"njit" in path.read_bytes():
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
