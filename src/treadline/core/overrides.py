"""Values by dotted key, such as ``stair.slope_deg=30``, over the tables of a settings file: one mechanism for every ``--set``.

A set value takes precedence: it replaces the value of the file, and keys that cannot stand next to it are left out.
"""

import tomllib
from collections.abc import Iterable, Mapping
from os import PathLike, fspath
from typing import Any, get_args

from treadline.core.errors import SettingsError
from treadline.core.settings import Settings

Keys = tuple[str, ...]
"""Dotted key in its parts: table names and list indices, then the key name."""
ABSENT = object()
"""Value of a key that is to be removed."""


def parse_items(items: Iterable[str]) -> dict[str, object]:
    """Return the values of ``key=value`` items by key; of two items with one key, the later applies.

    A value is TOML; anything else is text without quotes.

    Raises:
        SettingsError: If an item has no equals sign.
    """
    values = {}
    for item in items:
        key, sign, text = item.partition("=")
        if not sign:
            raise SettingsError(f"--set {item}: must be key=value, such as {item.strip()}=1")
        values[key.strip()] = _value(text.strip())
    return values


def _value(text: str) -> object:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def overridden(tables: Mapping[str, object], values: Mapping[str, object], model: type[Settings]) -> dict[str, object]:
    """Return the tables of a settings file with values set by dotted key; a table among the values is merged.

    Raises:
        SettingsError: If an index lies outside its list.
    """
    given = leaves(values)
    defaults = model().model_dump()
    gone = {rival: ABSENT for keys in given for rival in _rivals(keys, model)}
    changed: Any = tables
    for keys, value in (gone | given).items():
        changed = put(changed, keys, value, defaults)
    return dict(changed)


def put(here: object, keys: Keys, value: object, defaults: object, depth: int = 0) -> Any:
    """Return a table or a list with one value set, or removed where the value is ``ABSENT``.

    Args:
        here: Table or list; None where the file has none: a list then begins as its default.
        keys: Key from the root of the file.
        defaults: Default value at the same place.
        depth: Number of parts of the key that lead to ``here``.

    Raises:
        SettingsError: If an index lies outside the list; one item may be added.
    """
    if depth == len(keys):
        return value
    part = keys[depth]
    here = defaults if here is None and isinstance(defaults, list | tuple) else here
    if isinstance(here, list | tuple):
        if not (part.isdecimal() and int(part) <= len(here)):
            raise SettingsError(f"set {'.'.join(keys)}: '{part}' must be the index of an item, from 0 to {len(here)}")
        items = [*here, None] if int(part) == len(here) else list(here)
        items[int(part)] = put(items[int(part)], keys, value, None, depth + 1)
        return items
    table = dict(here) if isinstance(here, Mapping) else {}
    inner = defaults.get(part) if isinstance(defaults, Mapping) else None
    table[part] = put(table.get(part), keys, value, inner, depth + 1)
    return {key: item for key, item in table.items() if item is not ABSENT}


def _rivals(keys: Keys, model: type[Settings]) -> list[Keys]:
    """Return the keys that cannot stand next to a key."""
    owner: type[Settings] | None = model
    for part in keys[:-1]:
        if owner is not None and not part.isdecimal():
            owner = table_of(owner.model_fields[part].annotation) if part in owner.model_fields else None
    pairs = () if owner is None else owner.alternatives
    return [(*keys[:-1], two if one == keys[-1] else one) for one, two in pairs if keys[-1] in (one, two)]


def table_of(hint: Any) -> type[Settings] | None:
    """Return the settings class in the type of a key: a table, or one item of a list of tables; None for a value."""
    if isinstance(hint, type) and issubclass(hint, Settings):
        return hint
    return next((found for part in get_args(hint) if (found := table_of(part)) is not None), None)


def leaves(values: Mapping[str, object], above: Keys = ()) -> dict[Keys, object]:
    """Return the values by key; a table stands for its values, an array for a list, and a path for its text.

    Raises:
        SettingsError: If the values are not given by key.
    """
    if not isinstance(values, Mapping):
        raise SettingsError(f"set is {values!r}; give values by key, as {{'stair.slope_deg': 30}}")
    found: dict[Keys, object] = {}
    for key, value in values.items():
        keys = (*above, *str(key).split("."))
        plain = fspath(value) if isinstance(value, PathLike) else value.tolist() if hasattr(value, "tolist") else value
        found |= leaves(value, keys) if isinstance(value, Mapping) and value else {keys: plain}
    return found
