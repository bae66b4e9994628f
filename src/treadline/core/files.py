"""Files written whole, JSON read strictly, and users' modules: no part of a file is ever seen, and no number that is not finite."""

import importlib
import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from treadline.core.errors import SettingsError, TreadlineError
from treadline.core.printing import plain

DATA = Path(__file__).parents[1] / "data"
"""Folder of the files that are shipped with the package."""


def write_whole(path: Path, data: str | bytes) -> None:
    """Write a file atomically: a reader sees the old content or the new content, never a part."""
    with written_whole(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values as a JSON file, atomically: arrays as lists, non-finite numbers as null."""
    write_whole(path, json.dumps(plain(values), indent=1, allow_nan=False) + "\n")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose content atomically replaces the file on success and is discarded on error.

    Raises:
        TreadlineError: If the file cannot be written.
    """
    temporary = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise TreadlineError(f"{path}: cannot be written: {error.strerror or error}") from None


def bytes_of(path: Path, kind: str, refused: type[TreadlineError] = SettingsError) -> bytes:
    """Return the bytes of a file.

    Args:
        kind: Expected kind of file, for the error message.
        refused: Class of the error.

    Raises:
        TreadlineError: Of the class ``refused``, if the file is missing, a folder or cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise refused(f"{path}: no such file") from None
    except IsADirectoryError:
        raise refused(f"{path}: is a folder, not {kind}") from None
    except OSError as error:
        raise refused(f"{path}: {error.strerror}") from None


def text_of(path: Path, kind: str, refused: type[TreadlineError] = SettingsError) -> str:
    """Return the text of a file; arguments and errors are those of ``bytes_of``, and text that is not UTF-8 is an error too."""
    try:
        return bytes_of(path, kind, refused).decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError as error:
        raise refused(f"{path}: not UTF-8 (byte {error.start}); save it as UTF-8 text") from None


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises:
        SettingsError: If the file is missing, a folder, not UTF-8, not JSON or not an object.
    """
    return json_of(text_of(path, "a JSON file"), str(path))


def json_of(text: str, path: str) -> dict[str, Any]:
    """Return the object in a JSON text; errors name ``path``.

    Raises:
        SettingsError: If the text is not JSON or not an object.
    """
    if not text.strip():
        raise SettingsError(f"{path}: empty; wanted JSON, as treadline writes it")
    try:
        value = json.loads(text, parse_constant=_finite, parse_float=_finite, parse_int=_whole)
    except json.JSONDecodeError as error:
        raise SettingsError(f"{path}:{error.lineno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: not JSON that can be read: {error}") from None
    if not isinstance(value, dict):
        raise SettingsError(f"{path}: holds a {type(value).__name__}, not an object")
    return value


def _finite(text: str) -> float:
    """Return the number of a JSON text; NaN and Infinity, which Python reads, are none, and 1e999 is too large."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text[:20]} is not finite")
    return number


def _whole(text: str) -> int:
    """Return the whole number of a JSON text, which must be small enough to become a float."""
    _finite(text)
    return int(text)


def own_module(name: str) -> ModuleType:
    """Return a user's own module by its name, sought in the working folder first.

    Raises:
        ImportError: If there is none, or it imports what is missing; also whatever its own code raises.
    """
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    finally:
        if added:
            sys.path.remove(here)
