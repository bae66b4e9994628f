"""Sweep file: a base scenario, and draws that change it.

A sweep file is a scenario file with ``[[draw]]`` tables. If slope and rise are both drawn, the run follows from them.
"""

import copy
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from treadline.campaign._draws import DEFAULTS, LABEL, LISTS, Draw, Tables, check_draw, get_value
from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.overrides import Keys, leaves, overridden, put
from treadline.core.printing import plain
from treadline.core.settings import Settings, parse_toml, settings_of
from treadline.scenario.scenario import SHIPPED, Scenario, is_sweep, scenario_of, shipped_scenarios

SHAPE = ("stair.slope_deg", "stair.rise_m", "stair.run_m")


class _Draws(Settings):
    draw: tuple[Draw, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """Scenario of one run, and the values that define it."""

    scenario: Scenario
    values: dict[str, Any]
    """Drawn values by key, in the order of the file; part of the results."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """Validated sweep file."""

    path: Path
    """File, or a name for what was given as tables."""
    text: str
    """The file's text."""
    base: Tables
    draws: tuple[Draw, ...]
    fixed: Mapping[Keys, object] = field(default_factory=dict)
    """Values that hold in every run, whatever is drawn. A draw of such a key still consumes its coordinate."""

    @property
    def dimension(self) -> int:
        """Number of random variables: coordinates of the unit cube."""
        return sum(draw.is_chance for draw in self.draws)

    @property
    def digest(self) -> str:
        """Hash of the file's content without comments and layout."""
        says: dict[str, Any] = {"base": self.base, "draws": [draw.model_dump() for draw in self.draws]}
        if self.fixed:
            says["fixed"] = [list(item) for item in self.fixed.items()]
        return hashlib.sha256(json.dumps(plain(says), sort_keys=True, default=str).encode()).hexdigest()[:16]

    def at(self, point: Sequence[float], name: str) -> Drawn:
        """Return the scenario at a point of the unit cube; ``name`` identifies the run in messages.

        Raises:
            SettingsError: If the scenario is not allowed.
        """
        shares, tables = iter(point), copy.deepcopy(self.base)
        for number, draw in enumerate(self.draws, 1):
            # An inactive draw still consumes its coordinate, so that later draws keep theirs.
            share = next(shares) if draw.is_chance else 0.0
            if draw.applies(tables):
                drawn = draw.at(share, tables, f"{self.path}: draw {number} ({draw.key}): {name}")
                tables = put(tables, tuple(draw.key.split(".")), drawn, DEFAULTS)
            for keys, value in self.fixed.items():
                tables = put(tables, keys, value, DEFAULTS)
        label = tables.pop(LABEL, None)
        stair = tables.get("stair", {})
        if "slope_deg" in stair and "rise_m" in stair:
            if "run_m" in stair:
                raise SettingsError(f"{self.path}: stair.slope_deg, rise_m and run_m are all given; leave one out")
            stair["run_m"] = stair["rise_m"] / math.tan(stair.pop("slope_deg") * DEG)
        scenario = scenario_of(tables, self.path, where=f"{self.path}: {name}")
        whole = scenario.model_dump()
        shown = dict.fromkeys([*(draw.key for draw in self.draws if draw.key not in (LABEL, *LISTS)), *SHAPE])
        values = {key: get_value(whole, key) for key in shown}
        return Drawn(scenario=scenario, values=({} if label is None else {LABEL: label}) | values)


def read_spec(name: str | Path | Mapping[str, object], values: Mapping[str, object] | None = None) -> Spec:
    """Return the sweep in a file, the shipped sweep of that name, or the sweep of a file's tables.

    Args:
        values: Values by dotted key that hold in every run, in place of the file's and of drawn ones.

    Raises:
        SettingsError: If there is none, or its content is not allowed; one line with file, key and value.
    """
    path, tables = _tables(name)
    if "draw" not in tables:
        raise SettingsError(f"{path}: no draws; add [[draw]] tables, or run it once with treadline climb")
    asked = dict(tables)
    draws = settings_of({"draw": tables.pop("draw")}, _Draws, where=str(path)).draw
    scenario_of(tables, path, where=str(path))
    text = tables_toml(asked) if isinstance(name, Mapping) else path.read_text(encoding="utf-8")
    for number, draw in enumerate(draws, 1):
        check_draw(draw, f"{path}: draw {number} ({draw.key})")
    if values:
        tables = overridden(tables, values, Scenario)
        scenario_of(tables, path, where=f"{path if isinstance(name, Mapping) else name}, as changed")
    spec = Spec(path=path, text=text, base=tables, draws=draws, fixed=leaves(values or {}))
    _try_corners(spec)
    return spec


def _tables(name: str | Path | Mapping[str, object]) -> tuple[Path, Tables]:
    """Return path and tables of a sweep file, or a name for tables with a copy of them."""
    if isinstance(name, Mapping):
        return Path("sweep"), dict(copy.deepcopy(name))
    path, shipped = Path(name), {found.stem: found for found in SHIPPED.glob("*.toml") if is_sweep(found)}
    if not path.is_file() and str(name) in shipped:
        path = shipped[str(name)]
    elif not path.exists() and str(name) in shipped_scenarios():
        raise SettingsError(f"{name}: a shipped scenario without draws; run it once with treadline climb {name}")
    elif not path.exists() and path.suffix == "" and len(path.parts) == 1:
        raise SettingsError(f"{name}: no such file, and no shipped sweep of that name (shipped: {', '.join(sorted(shipped))})")
    return path, parse_toml(path)


def _try_corners(spec: Spec) -> None:
    """Check the corners of the ranges, so that impossible combinations are reported before any run."""
    rng = np.random.default_rng(0)
    has_ends = np.array([draw.choice is None for draw in spec.draws if draw.is_chance], dtype=bool)
    shape = (256, spec.dimension)
    for corner in np.where(has_ends, rng.integers(0, 2, shape), rng.random(shape)):
        spec.at(corner.tolist(), "at the ends of its ranges")


def scenario_toml(scenario: Scenario, note: str) -> str:
    """Return the text of a scenario file with every key; it reads back as the identical scenario."""
    return f"# {note}\n\n{tables_toml(scenario.model_dump(exclude_none=True))}"


def tables_toml(tables: Mapping[str, Any]) -> str:
    """Return the text of a TOML file of tables and lists of tables, which may hold tables in turn."""
    parts: list[str] = []
    for name, value in tables.items():
        is_list = isinstance(value, list | tuple)
        for table in value if is_list else (value,):
            head = f"[[{name}]]" if is_list else f"[{name}]"
            parts.append("\n".join([head, *(f"{key} = {_inline(item)}" for key, item in table.items() if item is not None)]) + "\n")
    return "\n".join(parts)


def _inline(value: Any) -> str:
    """Return a value in TOML. JSON writes strings, numbers, true and false as TOML does; numbers by repr, without loss."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(key)} = {_inline(item)}" for key, item in value.items()) + "}"
    return f"[{', '.join(map(_inline, value))}]" if isinstance(value, list | tuple) else json.dumps(value)
