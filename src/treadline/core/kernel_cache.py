"""Compiled kernels whose files on disk mend themselves: ``njit`` as numba's, with a cache that removes damaged files.

numba trusts its files: a truncated one ends every later call, and a wrong byte in machine code runs. A file of this cache carries
the SHA-256 of its content, the kernel's name and the hash of its source. If a file fails these checks or cannot be read, the files
of that kernel are removed, one line of the log says so, and numba compiles the kernel again.

numba has no public hook for the cache of a function: ``njit`` sets the dispatcher's attribute ``_cache``, as numba's own
``enable_caching`` does. Functions of other packages keep numba's cache.
"""

import glob
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

REMEDY = "set NUMBA_CACHE_DIR to a folder that can be written; until then each process compiles anew"
"""Remedy for a folder without write permission."""
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
            except RuntimeError:  # numba finds no folder that can be written
                _warn_once(f"compiled kernels cannot be kept: {REMEDY}")
            else:
                _CACHES.append(dispatcher._cache)  # noqa: SLF001 - the same
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
        """Return numba's data; None if they are of another source: a killed process can leave a new index next to old data.

        Raises:
            ValueError: If the checksum does not match.
        """
        origin, digest, data = payload
        if hashlib.sha256(data).digest() != digest:
            raise ValueError("wrong checksum")
        return bytes(data) if origin == self._origin else None


class _MendingCache(FunctionCache):
    """Cache of one kernel."""

    _impl_class = _SealedKernel

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel of a signature; None if it is to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception while they are unpickled
            self.remove(error)
            return None
        # A wrong byte of the index can name the file of another signature.
        return found if found is None or found.signature.args == normalize_signature(sig)[0] else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; where that fails, the run goes on without."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn_once(f"{self.cache_path}: compiled kernels cannot be kept: {error.strerror or error}; {REMEDY}")
        except Exception as error:  # noqa: BLE001 - the index was damaged since it was loaded
            self.remove(error)

    @property
    def name(self) -> str:
        """Name of the kernel."""
        return f"{self._py_func.__module__}.{self._py_func.__name__}"

    def files(self) -> list[Path]:
        """Return the files of this kernel: index, data, and what a killed process left of them."""
        return sorted(Path(self.cache_path).glob(f"{glob.escape(self._impl.filename_base)}.*nb[ic]*"))

    def state(self) -> bool | Exception:
        """Return whether a compiled form of the present source is on disk, after reading each; the error of a damaged file."""
        try:
            super().load_overload((), cpu_target.target_context)  # no kernel is without arguments: this reads the index alone
            contents = [pickle.loads(path.read_bytes()) for path in self.files() if path.suffix == ".nbc"]  # noqa: S301 - our own
            return [self._impl.opened(content) for content in contents].count(None) < len(contents)
        except Exception as error:  # noqa: BLE001 - as in ``load_overload``
            return error

    def remove(self, error: Exception) -> None:
        """Remove the files of this kernel, because of an error in one of them."""
        said = f"{self.name}: a damaged file of the compiled kernel ({type(error).__name__}: {' '.join(str(error).split())[:80]})"
        try:
            for path in self.files():
                path.unlink(missing_ok=True)
        except OSError as failure:
            self.disable()
            _warn_once(f"{said} cannot be removed: {failure.strerror}; remove {failure.filename} by hand")
        else:
            logging.getLogger("treadline").warning("treadline: %s was removed; the kernel is compiled again", said)


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
