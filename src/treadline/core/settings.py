"""Strict settings from TOML: unknown keys, wrong types and out-of-range values are errors with file, line, key and remedy.

Values are not coerced: ``"0.16"`` is text, ``true`` is not 1 and 20.0 is not an integer. Exceptions: an integer is accepted as a
real number, and a TOML list as a tuple.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from treadline.core.errors import SettingsError
from treadline.core.files import text_of

Pairs = Sequence[tuple[str, str]]
"""Pairs of keys of one table."""


class Settings(BaseModel):
    """Base of every settings model: frozen, strict, no unknown keys, no NaN or Inf."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    alternatives: ClassVar[Pairs] = ()
    """Pairs of keys that cannot stand next to each other, because they give the same value in two ways."""

    def changed(self, **tables: Mapping[str, object]) -> Self:
        """Return the settings with values of some tables replaced. The values are not checked."""
        return self.model_copy(update={name: getattr(self, name).model_copy(update=values) for name, values in tables.items()})

    @model_validator(mode="before")
    @classmethod
    def _lists_are_tuples(cls, tables: object) -> object:
        if not isinstance(tables, Mapping):
            return tables
        for one, other in cls.alternatives:
            if tables.get(one) is not None and tables.get(other) is not None:
                raise ValueError(f"give {one} or {other}, not both")
        return {key: _as_tuple(value) for key, value in tables.items()}


S = TypeVar("S", bound=Settings)


def read_toml(path: Path, model: type[S]) -> S:
    """Return the checked settings in a TOML file.

    Raises:
        SettingsError: If the file cannot be read or is invalid; one line with file, line, key and value.
    """
    return settings_of(parse_toml(path), model, where=str(path), file=path)


def parse_toml(path: Path) -> dict[str, object]:
    """Return the tables of a TOML file.

    Raises:
        SettingsError: If the file is missing, a folder, not UTF-8 or not TOML.
    """
    text = text_of(path, "a settings file")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError: base class of tomllib's error, and Python's own for an integer of thousands of digits.
        remedy = "; decimals have a point" if re.search(r"=\s*[+-]?\d+,\d", text) else ""
        raise SettingsError(f"{path}: not TOML: {error}{remedy if path.suffix == '.toml' else '; give a .toml file'}") from None


def settings_of(tables: Mapping[str, object], model: type[S], *, where: str, file: Path | None = None) -> S:
    """Return checked settings from parsed tables.

    Args:
        file: Source file of the unmodified tables; adds the line number to error messages.

    Raises:
        SettingsError: With ``where``, the key, its value and the allowed values.
    """
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        from treadline.core._setting_errors import message_of  # most files need none of it

        text = None if file is None else text_of(file, "a settings file")
        raise SettingsError(message_of(error, model, where, text)) from None


def _as_tuple(value: object) -> object:
    return tuple(_as_tuple(item) for item in value) if isinstance(value, list) else value
