"""Compiled kernels whose files on disk mend themselves: ``njit`` as numba's, with a cache that removes damaged files.

numba trusts its files: a truncated one ends every later call, and a wrong byte in machine code runs. A file of this cache carries
the SHA-256 of its content, and first its origin: the kernel's name and the hash of its source. A file that does not begin with
this origin, as numba's own, is compiled again and overwritten. If a file cannot be decoded, the files of that kernel are removed,
one line of the log says so, and numba compiles the kernel again. If the system refuses to read or write a file, nothing is removed:
the process compiles the kernel without the cache.

numba has no public hook for the cache of a function: ``njit`` sets the dispatcher's attribute ``_cache``, as numba's own
``enable_caching`` does. Functions of other packages keep numba's cache.
"""

import hashlib
import logging
import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

REMEDY = "if that stays so, set NUMBA_CACHE_DIR to a folder that can be read and written; until then each process compiles anew"
"""Remedy for a folder without permission."""
_CACHES = list["_MendingCache"]()


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
                _CACHES.append(dispatcher._cache)  # noqa: SLF001 - the same
            except RuntimeError:  # numba finds no folder that can be written
                _warn_once(f"compiled kernels cannot be kept: {REMEDY}")
        return dispatcher

    return compiled


class _SealedKernel(CompileResultCacheImpl):
    """Content of a kernel's file: name and source of the kernel, checksum, and numba's data."""

    @property
    def _origin(self) -> tuple[str, str, object]:
        return numba.__version__, self.filename_base, self.locator.get_source_stamp()

    def reduce(self, cres: Any) -> tuple[Any, ...]:
        """Return the content for a compiled kernel."""
        data = dumps(super().reduce(cres))
        return self._origin, hashlib.sha256(data).digest(), data

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the compiled kernel, or None if the content is of another source.

        Raises:
            ValueError: If the checksum does not match.
        """
        data = self.opened(payload)
        return None if data is None else super().rebuild(target_context, pickle.loads(data))  # noqa: S301 - written by this cache

    def opened(self, payload: Any) -> bytes | None:
        """Return numba's data; None if there are none or they are of another source.

        A killed process can leave a new index next to old data, and numba's own files have these names too.

        Raises:
            ValueError: If the checksum does not match.
        """
        if payload is None or payload[0] != self._origin:
            return None
        _, digest, data = payload
        if hashlib.sha256(data).digest() != digest:
            raise ValueError("wrong checksum")
        return bytes(data)


class _MendingCache(FunctionCache):
    """Cache of one kernel."""

    _impl_class = _SealedKernel

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel of a signature; None if it is to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception while they are unpickled
            if not self._refused(error):
                self.remove(error)
            return None
        # A wrong byte of the index can name the file of another signature.
        return found if found is None or found.signature.args == normalize_signature(sig)[0] else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; where that fails, the run goes on without."""
        try:
            super().save_overload(sig, data)
        except Exception as error:  # noqa: BLE001 - the index was damaged since it was loaded
            if not self._refused(error):
                self.remove(error)

    @property
    def name(self) -> str:
        """Name of the kernel."""
        return f"{self._py_func.__module__}.{self._py_func.__name__}"

    def state(self) -> bool | Exception:
        """Return whether a compiled form of the present source is on disk for this processor, after reading each.

        Returns:
            The error of a damaged file. What the system refuses to read counts as not compiled.
        """
        try:
            target = self._index_key((), cpu_target.target_context.codegen())[1:]
            keys = [key for key in self._cache_file._load_index() if key[1:] == target]  # noqa: SLF001 - numba names no keys
            return bool({self._impl.opened(self._cache_file.load(key)) for key in keys} - {None})
        except Exception as error:  # noqa: BLE001 - as in ``load_overload``
            return False if self._refused(error) else error

    def _refused(self, error: Exception) -> bool:
        """Return whether the system, not the content of a file, is the cause of an error; if so, say it once."""
        if refused := isinstance(error, OSError | MemoryError):
            _warn_once(f"{self.cache_path}: kernels cannot be read or kept: {getattr(error, 'strerror', 'no memory')}; {REMEDY}")
        return refused

    def remove(self, error: Exception) -> None:
        """Remove this kernel's index, data, and what a killed process left of them, because of an error in one of them."""
        said = f"{self.name}: a damaged file of the compiled kernel ({type(error).__name__}: {' '.join(str(error).split())[:80]})"
        try:
            for path in Path(self.cache_path).glob(f"{self._impl.filename_base}.*nb[ic]*"):
                path.unlink(missing_ok=True)
            logging.getLogger("treadline").warning("treadline: %s was removed; the kernel is compiled again", said)
        except OSError as failure:
            _warn_once(f"{said} cannot be removed: {failure.strerror}; remove {failure.filename} by hand")


def kernel_caches() -> list[_MendingCache]:
    """Return the cache of each kernel; kernels of packages that are not installed are left out."""
    for path in kernel_sources():
        with suppress(ImportError):
            import_module(".".join(path.relative_to(Path(__file__).parents[2]).with_suffix("").parts))
    return list(_CACHES)


@cache
def kernel_sources() -> dict[Path, bytes]:
    """Return the text of each source file with compiled functions."""
    texts = {path: path.read_bytes() for path in sorted(Path(__file__).parents[1].rglob("*.py"))}
    return {path: text for path, text in texts.items() if b"\nfrom numba" in text or b"\nfrom treadline.core.kernel_cache" in text}


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("treadline").warning("treadline: %s", text)
