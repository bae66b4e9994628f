"""Messages of invalid settings: key, value, allowed values and what was probably meant; and the line of a key in its file."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from treadline.core.angles import DEG
from treadline.core.errors import closest

Place = tuple[int | str, ...]
"""Path from the root of a file to a value: keys and list indices."""
JsonSchema = dict[str, Any]

ONE_OF = {"number": "a number", "integer": "a whole number", "boolean": "true or false", "string": "text"}
"""Names of scalar types in error messages."""
MANY_OF = {"number": "numbers", "integer": "whole numbers"}
"""Names of list item types in error messages."""
COUNTS = ("no", "one", "two", "three", "four")
"""Numerals of tuple lengths in error messages."""
UNITS: Mapping[str, Mapping[str, float]] = {
    "_deg_s": {"rad/s": 1.0 / DEG},
    "_deg": {"rad": 1.0 / DEG},
    "_m_s": {"mm/s": 1e-3},
    "_n_m": {},
    "_m": {"mm": 1e-3, "cm": 1e-2},
    "_s": {"ms": 1e-3},
}
"""Units in which a quantity may have been given by mistake, with their factors to the unit of its key; the first suffix counts."""
LEAST_CONVERTED = 0.01
"""Smallest converted value that is suggested: a centimetre, 10 ms or 1 cm/s; less is meant in no file."""
LONGEST_SHOWN = 60
"""Largest number of characters of a wrong value repeated in an error message."""
_TABLE = re.compile(r"\s*(\[{1,2})\s*([\w.-]+)\s*\]{1,2}\s*(#.*)?$")
_KEY = re.compile(r"\s*([\w-]+(?:\.[\w-]+)*)\s*=")


def message_of(error: ValidationError, model: type[BaseModel], where: str, text: str | None) -> str:
    """Return the first error of invalid settings, in one line.

    Args:
        where: Name of the settings.
        text: TOML text of the settings, for the line number; None for settings that are no file.
    """
    # Unknown keys first: a misspelt key is also a missing one.
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    first, place = problems[0], _place(problems[0])
    line = None if text is None else line_of(text, place)
    key = ".".join(part if isinstance(part, str) and part.isprintable() else repr(part) for part in place)
    others = {_place(problem) for problem in problems} - {place}
    more = f" (and {len(others)} more)" if others else ""
    named = f"{key}: " if first["loc"] else ""
    return f"{where}{'' if line is None else f':{line}'}: {named}{_what_is_wrong(first, key, model)}{more}"


def line_of(text: str, place: Place) -> int | None:
    """Return the line of a value in a TOML text, or of its table's header; None if the location is ambiguous."""
    here: Place = ()
    begun: Counter[str] = Counter()
    table_line = None
    for number, line in enumerate(text.splitlines(), start=1):
        if (table := _TABLE.match(line)) is not None:
            here = tuple(table[2].split("."))
            if table[1] == "[[":
                here = (*here, begun[table[2]])
                begun[table[2]] += 1
            table_line = number if here == place[: len(here)] or here[: len(place)] == place else table_line
        elif (key := _KEY.match(line)) is not None:
            path = (*here, *key[1].split("."))
            if path == place[: len(path)]:
                return number
    return table_line


def allowed_at(model: type[BaseModel], place: Place) -> str:
    """Return the allowed values of a key in words: ``a number from 0.05 to 0.3``."""
    return _wanted(_schema_at(model, place), ".".join(str(part) for part in place))


def _place(problem: ErrorDetails) -> Place:
    """Return where the value to correct stands: of a short list, the list; of a rule of several tables, the key named first."""
    place = problem["loc"] or tuple(problem["msg"].removeprefix("Value error, ").partition(" ")[0].split("."))
    return place[:-1] if problem["type"] == "missing" and isinstance(place[-1], int) else place


def _what_is_wrong(problem: ErrorDetails, key: str, model: type[BaseModel]) -> str:
    if problem["type"] == "value_error":
        return problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        return _unknown(problem, model)
    place = _place(problem)
    wanted = _wanted(_schema_at(model, place), key)
    if problem["type"] == "missing" and place == problem["loc"]:
        return f"missing; give {wanted}"
    meant = _meant(problem["input"], _schema_at(model, place), key)
    return f"must be {wanted} (got {_shown(problem['input'])})" + (f"; did you mean {meant}?" if meant else "")


def _unknown(problem: ErrorDetails, model: type[BaseModel]) -> str:
    """Return what to write in place of an unknown key: a similar one, the table that has it, or the known ones."""
    *above, last = problem["loc"]
    key, known, tables = str(last), list(_schema_at(model, tuple(above))["properties"]), _tables(model)
    # ``rise`` means rise_m.
    meant = next((name for name in known if name.startswith(f"{key}_")), None) or closest(key, known)
    if meant is not None:
        header = next((header for header in tables if not above and header.strip("[]") == meant), None)
        return f"unknown table; did you mean {header}?" if header else f"unknown key; did you mean {meant}?"
    owners = [header for header, keys in tables.items() if key in keys]
    return f"unknown key here; it belongs to {' or '.join(owners)}" if owners else f"unknown key; known here: {', '.join(known)}"


def _tables(model: type[BaseModel]) -> dict[str, set[str]]:
    """Return the keys of each table of a file by its header in TOML."""
    found: dict[str, set[str]] = {}
    for name in model.model_fields:
        schema = _schema_at(model, (name,))
        if "properties" in schema:
            found[f"[{name}]"] = set(schema["properties"])
        elif "$ref" in schema.get("items", {}):
            found[f"[[{name}]]"] = set(_schema_at(model, (name, 0))["properties"])
    return found


def _meant(value: object, schema: JsonSchema, key: str) -> str | None:
    """Return what a wrong value probably means: a similar word, or the same quantity in another unit."""
    if isinstance(value, str) and "enum" in schema:
        word = closest(value, [choice for choice in schema["enum"] if isinstance(choice, str)])
        return None if word is None else _shown(word)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    names = [part for part in key.split(".") if not part.isdigit()]
    units = next((units for suffix, units in UNITS.items() if names[-1].endswith(suffix)), {})
    converted = {unit: value * factor for unit, factor in units.items()}
    return next((f"{number:.3g}, for {value:g} {unit}" for unit, number in converted.items() if _is_within(number, schema)), None)


def _is_within(number: float, schema: JsonSchema) -> bool:
    """Return whether a number is allowed, and large enough to be meant."""
    return (
        abs(number) >= LEAST_CONVERTED
        and schema.get("minimum", -math.inf) <= number <= schema.get("maximum", math.inf)
        and schema.get("exclusiveMinimum", -math.inf) < number < schema.get("exclusiveMaximum", math.inf)
    )


def _schema_at(model: type[BaseModel], place: Place) -> JsonSchema:
    """Return the JSON schema of the value at a path."""
    root = model.model_json_schema()
    here: JsonSchema = root
    for part in place:
        if isinstance(part, str):
            here = here["properties"][part]
        else:
            here = here["prefixItems"][part] if "prefixItems" in here else here["items"]
        # An optional value is "anyOf": itself, or null; a table is a reference to its definition.
        here = here.get("anyOf", [here])[0]
        if "$ref" in here:
            here = root["$defs"][here["$ref"].rpartition("/")[2]]
    return here


def _wanted(schema: JsonSchema, key: str) -> str:
    """Return the allowed values of a schema in words: ``a number from 0.05 to 0.3``."""
    if "enum" in schema:
        *rest, last = (_shown(choice) for choice in schema["enum"])
        return f"{', '.join(rest)} or {last}"
    kind = schema["type"]
    if kind == "object":
        return "a table" if key[-1:].isdigit() else f"a table, [{key}]"
    if kind != "array":
        return ONE_OF[kind] + _range(schema)
    items = schema.get("prefixItems", [schema.get("items")])
    if "$ref" in items[0]:
        return f"a list of tables, [[{key}]]"
    if "enum" in items[0]:
        return f"a list of {_wanted(items[0], key)}"
    count = COUNTS[len(items)] if "prefixItems" in schema else "a list of"
    return f"{count} {MANY_OF[items[0]['type']]}{_range(items[0])}"


def _range(schema: JsonSchema) -> str:
    if "minimum" in schema and "maximum" in schema:
        return f" from {schema['minimum']:g} to {schema['maximum']:g}"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = [f"{sign} {schema[name]:g}" for name, sign in signs.items() if name in schema]
    return f" {' and '.join(bounds)}" if bounds else ""


def _shown(value: object) -> str:
    """Return a value in TOML notation, on one line and truncated."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, tuple):
        text = f"[{', '.join(_shown(item) for item in value)}]"
    elif isinstance(value, dict):
        text = "a table"
    else:
        text = repr(value) if isinstance(value, str | int | float) else str(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"
