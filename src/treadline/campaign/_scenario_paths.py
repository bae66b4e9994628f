"""Access to scenario values by path: ``stair.slope_deg``, ``chair.payload_offset_m.0``, and two derived values."""

import math
from collections.abc import Mapping
from typing import Any

from pydantic import create_model

from treadline.core.errors import SettingsError
from treadline.core.settings import Settings, settings_of
from treadline.scenario.scenario import Scenario, Stair

LABEL = "label"
"""Key outside the scenario: a free label for conditions of other draws, and a column of the results."""
DERIVED = ("stair.slope_deg", "stair.tan_slope")
DEFAULTS: dict[str, Any] = Scenario().model_dump()
LISTS = tuple(key for key, value in DEFAULTS.items() if isinstance(value, tuple))
"""Keys of lists of tables; a draw replaces the whole list."""

Tables = dict[str, Any]


def check_path(key: str, where: str) -> None:
    """Raise SettingsError unless the scenario has a value at the path."""
    table, _, rest = key.partition(".")
    field, _, index = rest.partition(".")
    if key == LABEL or table in LISTS:
        return
    if table not in DEFAULTS:
        raise SettingsError(f"{where}: no table '{table}' in a scenario; there are {', '.join(DEFAULTS)}, and 'label'")
    fields = list(_table_model(table).model_fields)
    if field not in fields:
        raise SettingsError(f"{where}: [{table}] has no key '{field}'; it has {', '.join(fields)}")
    items = DEFAULTS[table].get(field)
    if index and not (isinstance(items, tuple) and index.isdecimal() and int(index) < len(items)):
        has = f"its items are 0 to {len(items) - 1}" if isinstance(items, tuple) and items else "it has no items"
        raise SettingsError(f"{where}: '{table}.{field}' has no item '{index}'; {has}")


def check_value(key: str, value: object, where: str) -> None:
    """Raise SettingsError unless the scenario's validation of the key allows the value."""
    table, _, rest = key.partition(".")
    field = rest.partition(".")[0]
    if key == LABEL:
        return
    if not field or table in LISTS:
        settings_of({table: value} if not field else {}, Scenario, where=where)
        return
    # A scenario with only this key; rules across several keys are checked on complete scenarios.
    info = _table_model(table).model_fields[field]
    one: Any = _model(table, {field: (info.annotation, info)})
    whole: Any = _model("Scenario", {table: (one, ...)})
    alone: Tables = {}
    set_value(alone, key, value)
    settings_of(alone, whole, where=where)


def is_integer(key: str) -> bool:
    """Whether the value at the path is an integer."""
    table, _, field = key.partition(".")
    return table in DEFAULTS and isinstance(DEFAULTS[table], dict) and type(DEFAULTS[table].get(field)) is int


def get_value(tables: Mapping[str, Any], key: str) -> Any:
    """Return the value at a path of sparse tables, or the scenario's default."""
    if key in DERIVED:
        slope_deg = _slope_deg(tables.get("stair", {}))
        return slope_deg if key == DERIVED[0] else math.tan(math.radians(slope_deg))
    for whole in (tables, DEFAULTS):
        here: Any = whole
        for part in key.split("."):
            here = _step(here, part)
        if here is not None:
            return here
    return None


def set_value(tables: Tables, key: str, value: object) -> None:
    """Set the value at a path; a missing list is initialised with the scenario's default."""
    *parents, last = key.split(".")
    here: Any = tables
    for depth, part in enumerate(parents):
        if isinstance(here, list):
            here = here[int(part)]
            continue
        default = get_value({}, ".".join(parents[: depth + 1]))
        here = here.setdefault(part, list(default) if isinstance(default, tuple) else {})
    here[int(last) if isinstance(here, list) else last] = value


def _step(here: Any, part: str) -> Any:
    if isinstance(here, Mapping):
        return here.get(part)
    if isinstance(here, list | tuple) and part.isdecimal() and int(part) < len(here):
        return here[int(part)]
    return None


def _slope_deg(stair: Mapping[str, Any]) -> float:
    if stair.get("slope_deg") is not None:
        return float(stair["slope_deg"])
    shape = Stair().model_dump() | dict(stair)
    return math.degrees(math.atan2(shape["rise_m"], shape["run_m"]))


def _model(name: str, fields: dict[str, Any]) -> Any:
    return create_model(name, __base__=Settings, **fields)


def _table_model(table: str) -> type[Settings]:
    model = Scenario.model_fields[table].annotation
    if not (isinstance(model, type) and issubclass(model, Settings)):
        raise SettingsError(f"'{table}' is not a table")
    return model
