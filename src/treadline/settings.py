"""Strict settings from TOML: unknown keys, wrong types and values out of range are errors with file, key and remedy."""

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from treadline.errors import SettingsError


class Settings(BaseModel):
    """Base of every settings model: frozen, no unknown keys, no NaN or Inf."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=False)


S = TypeVar("S", bound=Settings)


def read_toml(path: Path, model: type[S]) -> S:
    """Return the settings in a TOML file, checked.

    Raises:
        SettingsError: If the file cannot be read or says something it must not; one line with file, key, value.
    """
    return settings_of(parse_toml(path), model, where=str(path))


def parse_toml(path: Path) -> dict[str, object]:
    """Return the tables of a TOML file.

    Raises:
        SettingsError: If it is missing, a folder, not UTF-8 or not TOML.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise SettingsError(f"{path}: is a folder, not a settings file") from None
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path}: not UTF-8 (byte {error.start}); save it as UTF-8 text") from None
    except OSError as error:
        raise SettingsError(f"{path}: {error.strerror}") from None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{path}: not TOML: {error}") from None


def settings_of(tables: dict[str, object], model: type[S], *, where: str) -> S:
    """Return checked settings from tables already parsed.

    Raises:
        SettingsError: With ``where``, the key, its value and what is allowed.
    """
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        raise SettingsError(_first_problem(error, where)) from None


def _first_problem(error: ValidationError, where: str) -> str:
    problems = error.errors(include_url=False)
    first = problems[0]
    key = ".".join(str(part) for part in first["loc"]) or "file"
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message = "unknown key; remove it or correct its spelling"
    elif first["type"] != "value_error":
        message = f"{message} (got {first['input']!r})"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{where}: {key}: {' '.join(message.split())}{more}"
