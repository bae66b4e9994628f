"""Compiled kernels: ``njit`` as numba's, with files on disk that mend themselves, and the time that a process spends compiling.

numba compiles a kernel at its first call on a machine and keeps the result next to the source file, or in ``NUMBA_CACHE_DIR``. It
trusts these files: a truncated one ends every later call, and a wrong byte in machine code runs. A file of this cache is sealed
with the SHA-256 of the kernel's name, the stamp of its source and the content. If a file cannot be decoded, or its seal is
broken, the files of that kernel are removed, one line of the log says so, and numba compiles the kernel again. If the system
refuses to read or write a file, nothing is removed: the process compiles the kernel without the cache.

numba has no public hook for the cache of a function: ``njit`` sets the dispatcher's attribute ``_cache``, as numba's own
``enable_caching`` does. Functions of other packages keep numba's cache.
"""

import hashlib
import logging
import pickle
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.event import Event, Listener, register
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

REMEDY = "if that stays so, set NUMBA_CACHE_DIR to a folder that can be read and written; until then each process compiles anew"
"""Remedy for a folder without permission."""


def njit(*, cache: bool, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as ``numba.njit`` does.

    Args:
        cache: Whether to keep the compiled function on disk.
        options: Further options of ``numba.njit``.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher: Any = numba.njit(**options)(function)
        if cache:
            try:
                dispatcher._cache = _MendingCache(function)  # noqa: SLF001 - see the module's docstring
            except RuntimeError:  # numba finds no folder that can be written
                _warn_once(f"compiled kernels cannot be kept: {REMEDY}")
        return dispatcher

    return compiled


class _SealedKernel(CompileResultCacheImpl):
    """Content of a kernel's file: seal and numba's data."""

    def _seal(self, data: bytes) -> bytes:
        """Return the seal of data; a killed process can leave a new index next to the data of another source."""
        origin = repr((numba.__version__, self.filename_base, self.locator.get_source_stamp()))
        return hashlib.sha256(origin.encode() + data).digest()

    def reduce(self, cres: Any) -> tuple[bytes, bytes]:
        """Return the content for a compiled kernel."""
        data = dumps(super().reduce(cres))
        return self._seal(data), data

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """Return the compiled kernel; None for a file of numba's own, or of another version, under this name.

        Raises:
            ValueError: If the seal is broken.
        """
        if len(payload) != 2:
            return None
        seal, data = payload
        if self._seal(data) != seal:
            raise ValueError("wrong checksum")
        return super().rebuild(target_context, pickle.loads(data))  # noqa: S301 - written by this cache


class _MendingCache(FunctionCache):
    """Cache of one kernel."""

    _impl_class = _SealedKernel

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel of a signature; None if it is to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception while they are unpickled
            self._mend(error)
            return None
        # A wrong byte of the index can name the file of another signature.
        return found if found is None or found.signature.args == normalize_signature(sig)[0] else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; where that fails, the run goes on without."""
        try:
            super().save_overload(sig, data)
        except Exception as error:  # noqa: BLE001 - the index was damaged since it was loaded
            self._mend(error)

    def _mend(self, error: Exception) -> None:
        """Remove this kernel's files because of an error in one of them; where the system is the cause, say so once."""
        if isinstance(error, OSError | MemoryError):
            _warn_once(f"{self.cache_path}: kernels cannot be read or kept: {getattr(error, 'strerror', 'no memory')}; {REMEDY}")
            return
        name = f"{self._py_func.__module__}.{self._py_func.__name__}"
        said = f"{name}: a damaged file of the compiled kernel ({type(error).__name__}: {' '.join(str(error).split())[:80]})"
        try:
            for path in Path(self.cache_path).glob(f"{self._impl.filename_base}.*nb[ic]*"):
                path.unlink(missing_ok=True)
            logging.getLogger("treadline").warning("treadline: %s was removed; the kernel is compiled again", said)
        except OSError as failure:
            _warn_once(f"{said} cannot be removed: {failure.strerror}; remove {failure.filename} by hand")


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("treadline").warning("treadline: %s", text)


class CompileTimer(Listener):
    """CPU time of compiling, which measured speeds exclude; kernels compiled on behalf of another kernel count once."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        """CPU time of compiling so far [s]."""
        self.on_kernel: Callable[[], None] | None = None
        """Called after the first compilation of each kernel; numba's own functions do not count."""
        self._begun_s, self._depth = 0.0, 0
        self._kernels = set[Any]()

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Start the clock at the outermost kernel."""
        self._depth += 1
        if self._depth == 1:
            self._begun_s = time.process_time()

    def on_end(self, event: Event) -> None:
        """Stop the clock at the outermost kernel."""
        self._depth -= 1
        if self._depth == 0:
            self.spent_s += time.process_time() - self._begun_s
        kernel = event.data["dispatcher"].py_func
        if self.on_kernel is not None and kernel.__module__.startswith("treadline.") and kernel not in self._kernels:
            self._kernels.add(kernel)
            self.on_kernel()


@cache
def compiling() -> CompileTimer:
    """Return this process's timer, which counts from the first call of this function."""
    timer = CompileTimer()
    register("numba:compile", timer)
    return timer
