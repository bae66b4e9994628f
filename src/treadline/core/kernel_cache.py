"""Compiled kernels: ``njit`` as numba's, with files on disk that mend themselves, and the time that a process spends compiling.

numba compiles a kernel at its first call on a machine and keeps the result next to the source file, or in ``NUMBA_CACHE_DIR``. It
trusts these files: a truncated one ends every later call, and a wrong byte in machine code runs. Here each file is sealed with the
SHA-256 of the kernel's name, the stamp of its source, its signature and the content. If a file cannot be decoded, or its seal is
broken, the files of that kernel are removed; if the system refuses to read or write a file, none is removed. In both cases one
line of the log says so, and numba compiles the kernel again.

numba has no public hook for the cache of a function: ``njit`` sets the dispatcher's attribute ``_cache``, as numba's own
``enable_caching`` does. Functions of other packages keep numba's cache.
"""

import hashlib
import logging
import pickle
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.event import Event, Listener, register
from numba.core.serialize import dumps

REMEDY = "if that stays so, set NUMBA_CACHE_DIR to a folder that can be read and written"
"""Remedy for a folder without permission."""
COMPILING_TEXT = "compiling for this machine; this takes about half a minute, and treadline compile does it once for all"
LONG_S = 1.0
"""CPU time of compiling that is reported [s]; loading every kernel from disk compiles nothing."""


def njit(*, cache: bool, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as ``numba.njit`` does.

    Args:
        cache: Whether to keep the compiled function on disk.
        options: Further options of ``numba.njit``.
    """
    compiling()

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher: Any = numba.njit(**options)(function)
        if cache:
            try:
                dispatcher._cache = _MendingCache(function)  # noqa: SLF001 - see the module's docstring
            except RuntimeError:  # numba finds no folder that can be written
                warn_once(f"compiled kernels cannot be kept, and each process compiles anew; {REMEDY}")
        return dispatcher

    return compiled


class _SealedFiles(IndexDataCacheFile):
    """Index and data of one kernel; a killed process can leave a new index next to the data of another source."""

    def load(self, key: Any) -> Any:
        """Return the data of a signature; None if there are none.

        Raises:
            ValueError: If the seal is broken.
        """
        sealed = super().load(key)
        if sealed is None:
            return None
        seal, content = sealed
        if seal != self._seal(key, content):
            raise ValueError("wrong checksum")
        return pickle.loads(content)  # noqa: S301 - written by this cache

    def save(self, key: Any, data: Any) -> None:
        """Keep the data of a signature."""
        content = dumps(data)
        super().save(key, (self._seal(key, content), content))

    def _seal(self, key: Any, content: bytes) -> bytes:
        return hashlib.sha256(repr((self._index_name, self._source_stamp, key)).encode() + content).digest()


class _MendingCache(FunctionCache):
    """Cache of one kernel."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _SealedFiles(self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._cache_file._version += ", sealed"  # noqa: SLF001 - numba's own files under this name are those of another version

    @contextmanager
    def _guard_against_spurious_io_errors(self) -> Iterator[None]:
        """Let a run go on without a file that cannot be loaded or kept; numba loads and keeps kernels in this context."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception while they are unpickled
            if not isinstance(error, OSError | MemoryError):
                with suppress(OSError):
                    for path in Path(self.cache_path).glob(f"{self._impl.filename_base}.*nb[ic]*"):
                        path.unlink(missing_ok=True)
            cause = getattr(error, "strerror", f"damaged, {type(error).__name__}")
            warn_once(f"{self.cache_path}: a kernel's file cannot be read or kept ({cause}); it is compiled again; {REMEDY}")


@cache
def warn_once(text: str) -> None:
    """Write a line to the log, unless this process has written the line before."""
    logging.getLogger("treadline").warning("treadline: %s", text)


class CompileTimer(Listener):
    """CPU time of compiling, which measured speeds exclude; kernels compiled on behalf of another kernel count once."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        """CPU time of compiling so far [s]; the log says once that it has become long."""
        self._begun_s, self._depth = 0.0, 0
        register("numba:compile", self)

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Start the clock at the outermost kernel."""
        self._depth += 1
        if self._depth == 1:
            self._begun_s = time.process_time()

    def on_end(self, event: Event) -> None:  # noqa: ARG002
        """Stop the clock at the outermost kernel."""
        self._depth -= 1
        if self._depth == 0:
            self.spent_s += time.process_time() - self._begun_s
            if self.spent_s > LONG_S:
                warn_once(COMPILING_TEXT)


compiling = cache(CompileTimer)
"""Return the timer of this process, which counts from the first use of ``njit``."""
