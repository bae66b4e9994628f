"""All keys of a settings model, from the model itself: type, range, default and meaning, for people.

The meaning of a key is the docstring under its field; ``# m`` and the like come from its name.
"""

import ast
import inspect
import json
import textwrap
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from pydantic_core import PydanticUndefined

from treadline.settings import Place, Settings, allowed_at
from treadline.units import UNITS, unit_ending


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """One key of a settings file."""

    place: Place
    """Its tables, then its name."""
    default: Any
    """None where nothing is set; PydanticUndefined where it must be given."""
    allowed: str
    """``a number from 0.05 to 0.3``, its unit included."""
    meaning: str
    """Empty where its name says all."""

    @property
    def line(self) -> str:
        """The key as TOML has it, with what it may be; one without a default as a comment."""
        given = self.default is not None and self.default is not PydanticUndefined
        text = f"{self.place[-1]} = {json.dumps(self.default)}" if given else f"# {self.place[-1]}:"
        told = self.allowed if given else f"{'must be given' if self.default is PydanticUndefined else 'not set'}; {self.allowed}"
        return f"{text:<32} {'# ' if given else ''}{told}" + (f". {self.meaning}" if self.meaning else "")


def meanings(model: type) -> dict[str, str]:
    """Return the docstring under each field of a class, on one line, those of its bases included."""
    found: dict[str, str] = {}
    for part in reversed(model.__mro__):
        if "__annotations__" not in part.__dict__:
            continue
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        except (OSError, TypeError, SyntaxError):  # made while running, or its source is not at hand
            continue
        body = getattr(tree, "body", [])
        for field, after in pairwise(body):
            told = after.value if isinstance(after, ast.Expr) else None
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(told, ast.Constant):
                found[field.target.id] = " ".join(str(told.value).replace("``", "").split())
    return found


def tables_of(model: type[Settings]) -> dict[str, tuple[str, list[Key]]]:
    """Return the tables of a settings file, each with what it is for and its keys; of lists of tables, one item's."""
    tables: dict[str, tuple[str, list[Key]]] = {}
    for name, field in model.model_fields.items():
        default = field.get_default()
        inner = type(default) if isinstance(default, Settings) else _item(field.annotation)
        place: Place = (name,) if isinstance(default, Settings) else (name, 0)
        if inner is not None:
            purpose = " ".join((inspect.getdoc(inner) or "").partition("\n\n")[0].replace("``", "").split())
            tables[f"[{name}]" if len(place) == 1 else f"[[{name}]]"] = (purpose, _keys(model, inner, place))
    return tables


def _keys(root: type[Settings], table: type[Settings], place: Place) -> list[Key]:
    told = meanings(table)
    return [
        Key(
            place=(*place, name),
            default=field.get_default(),
            allowed=allowed_at(root, (*place, name)) + (f" [{UNITS[end]}]" if (end := unit_ending(name)) else ""),
            meaning=told.get(name, ""),
        )
        for name, field in table.model_fields.items()
    ]


def _item(hint: Any) -> type[Settings] | None:
    """Return what a list of tables holds."""
    parts = [part for part in getattr(hint, "__args__", ()) if isinstance(part, type) and issubclass(part, Settings)]
    return parts[0] if parts else None
