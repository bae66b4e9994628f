"""Reference of all keys of a settings model, generated from the model: type, range, default and meaning.

The meaning of a key is the docstring under its field; the unit is taken from the suffix of its name.
"""

import ast
import inspect
import json
import textwrap
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from pydantic_core import PydanticUndefined

from treadline.core._setting_errors import Place, allowed_at
from treadline.core.overrides import table_of
from treadline.core.printing import UNITS, unit_ending
from treadline.core.settings import Settings


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """Documentation of one key of a settings file."""

    place: Place
    """Path of the key: table names, then the key name."""
    default: Any
    """Default value; None if unset, PydanticUndefined if required."""
    allowed: str
    """Allowed values with their unit: ``a number from 0.05 to 0.3``."""
    meaning: str
    """Meaning of the key; empty if the name is sufficient."""

    @property
    def line(self) -> str:
        """TOML line of the key with its documentation as a comment; a key without default is commented out."""
        given = self.default is not None and self.default is not PydanticUndefined
        text = f"{self.place[-1]} = {json.dumps(self.default)}" if given else f"# {self.place[-1]}:"
        range_text = self.allowed
        if not given:
            range_text = f"{'must be given' if self.default is PydanticUndefined else 'not set'}; {self.allowed}"
        return f"{text:<32} {'# ' if given else ''}{range_text}" + (f". {self.meaning}" if self.meaning else "")


def meanings(model: type) -> dict[str, str]:
    """Return the docstring of each field of a class and its bases, on one line each."""
    found: dict[str, str] = {}
    for part in reversed(model.__mro__):
        if "__annotations__" not in part.__dict__:
            continue
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        except (OSError, TypeError, SyntaxError):  # class created at run time, or source not available
            continue
        body = getattr(tree, "body", [])
        for field, after in pairwise(body):
            docstring = after.value if isinstance(after, ast.Expr) else None
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(docstring, ast.Constant):
                found[field.target.id] = " ".join(str(docstring.value).replace("``", "").split())
    return found


def tables_of(model: type[Settings]) -> dict[str, tuple[str, list[Key]]]:
    """Return the tables of a settings file with purpose and keys; for lists of tables, the keys of one item."""
    tables: dict[str, tuple[str, list[Key]]] = {}
    for name, field in model.model_fields.items():
        default = field.get_default()
        inner = type(default) if isinstance(default, Settings) else table_of(field.annotation)
        place: Place = (name,) if isinstance(default, Settings) else (name, 0)
        if inner is not None:
            purpose = " ".join((inspect.getdoc(inner) or "").partition("\n\n")[0].replace("``", "").split())
            tables[f"[{name}]" if len(place) == 1 else f"[[{name}]]"] = (purpose, _keys(model, inner, place))
    return tables


def _keys(root: type[Settings], table: type[Settings], place: Place) -> list[Key]:
    documented = meanings(table)
    return [
        Key(
            place=(*place, name),
            default=field.get_default(),
            allowed=allowed_at(root, (*place, name)) + (f" [{UNITS[end]}]" if (end := unit_ending(name)) else ""),
            meaning=documented.get(name, ""),
        )
        for name, field in table.model_fields.items()
    ]
