"""Random variables of a sweep: a scenario key and the distribution of its value.

A bound of ``uniform``, and ``value``, is a number or a multiple of another value, a constant added or not:
``{ times = 1.1, of = "stair.tan_slope" }``, ``{ times = 1.0, of = "stair.rise_m", plus = 0.05 }``.
``when`` limits a draw to runs in which other values satisfy a condition. Draws are evaluated in order and may refer to
earlier ones.

Scenario values are accessed by path: ``stair.slope_deg``, ``chair.payload_offset_m.0``, and two derived values.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from treadline.core.arrays import LARGEST
from treadline.core.errors import SettingsError
from treadline.core.overrides import put
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
    if key == LABEL or key.startswith(tuple(f"{name}." for name in LISTS)):
        return  # one key of an item of a list is checked on complete scenarios
    above, _, last = key.rpartition(".")
    if last.isdecimal() and get_value({}, above) is None:
        check_path(above, where)  # a pair that is unset by default: the file's base gives it
        return
    settings_of(put({}, tuple(key.split(".")), get_value({}, key), DEFAULTS), Scenario, where=where)


def get_value(tables: Mapping[str, Any], key: str) -> Any:
    """Return the value at a path of sparse tables, or the scenario's default."""
    if key in DERIVED:
        slope_deg = _slope_deg(tables.get("stair", {}))
        return slope_deg if key == DERIVED[0] else math.tan(math.radians(slope_deg))
    for whole in (tables, DEFAULTS):
        here: Any = whole
        for part in key.split("."):
            items = {str(index): item for index, item in enumerate(here)} if isinstance(here, list | tuple) else here
            here = items.get(part) if isinstance(items, Mapping) else None
        if here is not None:
            return here
    return None


def _slope_deg(stair: Mapping[str, Any]) -> float:
    if stair.get("slope_deg") is not None:
        return float(stair["slope_deg"])
    shape = Stair().model_dump() | dict(stair)
    return math.degrees(math.atan2(shape["rise_m"], shape["run_m"]))


KINDS = ("uniform", "normal", "choice", "value")


class Normal(Settings):
    """Normal distribution truncated to ``low`` and ``high``."""

    mean: float
    sigma: Annotated[float, Field(gt=0.0)]
    low: float
    high: float


class Draw(Settings):
    """Scenario key and its distribution: one of ``uniform``, ``normal``, ``choice`` (with ``weights``) and ``value``."""

    key: str
    uniform: Any = None
    normal: Normal | None = None
    choice: Any = None
    weights: tuple[Annotated[float, Field(ge=0.0)], ...] | None = None
    value: Any = None
    when: Any = None

    @property
    def is_chance(self) -> bool:
        """Whether the draw uses a coordinate of the unit cube."""
        return self.value is None

    def applies(self, tables: Tables) -> bool:
        """Whether the draw's condition holds in this run."""
        return all(_holds(condition, get_value(tables, key)) for key, condition in (self.when or {}).items())

    def at(self, share: float, tables: Tables, where: str) -> Any:
        """Return the quantile at ``share`` (0 to 1) of the distribution."""
        if self.choice is not None:
            edges = np.cumsum(self.weights or np.ones(len(self.choice)))
            return self.choice[min(int(np.searchsorted(edges / edges[-1], share, side="right")), len(self.choice) - 1)]
        if self.normal is not None:
            return _cut_normal(self.normal, share)
        if self.value is not None:
            return _bound(self.value, tables)
        low, high = (_bound(bound, tables) for bound in self.uniform)
        if low > high:
            raise SettingsError(f"{where}: uniform from {low:.4g} to {high:.4g} is empty; put the smaller bound first")
        if type(get_value({}, self.key)) is int:
            return int(low) + min(int(share * (high - low + 1)), int(high - low))
        return min(low + share * (high - low), high)


def check_draw(draw: Draw, where: str) -> None:
    """Raise SettingsError unless the draw is well formed; its values are checked in whole scenarios."""
    check_path(draw.key, where)
    given = [kind for kind in KINDS if getattr(draw, kind) is not None]
    if len(given) != 1:
        has = f"has {' and '.join(given)}" if given else "has no distribution"
        raise SettingsError(f"{where}: {has}; give one of {', '.join(KINDS)}")
    if draw.uniform is not None:
        if not isinstance(draw.uniform, tuple) or len(draw.uniform) != 2:
            raise SettingsError(f"{where}: uniform must be two bounds, [low, high] (got {draw.uniform!r})")
        for bound in draw.uniform:
            _check_bound(bound, where)
    if draw.normal is not None and not draw.normal.low < draw.normal.high:
        raise SettingsError(f"{where}: normal.low is {draw.normal.low:g}, normal.high {draw.normal.high:g}; low must be less")
    if draw.choice is not None and not (isinstance(draw.choice, tuple) and draw.choice):
        raise SettingsError(f"{where}: choice must be a list of one value or more (got {draw.choice!r})")
    if isinstance(draw.value, Mapping):
        _check_bound(draw.value, where)
    if draw.weights is not None and (draw.choice is None or len(draw.weights) != len(draw.choice) or not sum(draw.weights)):
        raise SettingsError(f"{where}: weights must be as many as the values of choice, and at least one above 0")
    _check_when(draw.when, where)


def is_number(value: object) -> bool:
    """Return whether a value is a number that a file can hold, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _check_bound(bound: object, where: str) -> None:
    if isinstance(bound, int | float) and not isinstance(bound, bool):
        if not abs(bound) <= LARGEST:
            raise SettingsError(f"{where}: a bound is {bound}; it must be finite")
        return
    keys = set(bound) if isinstance(bound, Mapping) else set()
    if not isinstance(bound, Mapping) or keys - {"plus"} != {"times", "of"} or not all(is_number(bound[k]) for k in keys - {"of"}):
        raise SettingsError(f'{where}: a bound must be a number, or {{ times = 1.1, of = "stair.tan_slope" }} (got {bound!r})')
    if bound["of"] not in DERIVED:
        check_path(str(bound["of"]), where)
    if not isinstance(get_value({}, str(bound["of"])), int | float | None):
        raise SettingsError(f"{where}: of = {bound['of']!r} is not a number in a scenario and has no multiple")


def _bound(bound: Any, tables: Tables) -> Any:
    if isinstance(bound, Mapping) and "times" in bound:
        return bound["times"] * get_value(tables, bound["of"]) + bound.get("plus", 0.0)
    return bound


def _check_when(when: object, where: str) -> None:
    if when is None:
        return
    if not isinstance(when, Mapping):
        raise SettingsError(f'{where}: when must be a table, {{ "drive.direction" = "down" }} (got {when!r})')
    for key, condition in when.items():
        if key not in DERIVED:
            check_path(key, f"{where}: when")
        bounds = condition if isinstance(condition, Mapping) else {"above": 0}
        if not bounds or not set(bounds) <= {"above", "at_most"} or not all(map(is_number, bounds.values())):
            raise SettingsError(f"{where}: when {key}: give a value, a list of values, or above and at_most (got {condition!r})")
        if isinstance(condition, Mapping) and (key == LABEL or not isinstance(get_value({}, key), int | float)):
            raise SettingsError(f"{where}: when {key}: above and at_most need a numeric key")


def _holds(condition: Any, value: Any) -> bool:
    if isinstance(condition, Mapping):
        return bool(condition.get("above", -np.inf) < value <= condition.get("at_most", np.inf))
    return value in condition if isinstance(condition, list | tuple) else bool(value == condition)


def _cut_normal(normal: Normal, share: float) -> float:
    from scipy.special import ndtr, ndtri

    low, high = (ndtr((end - normal.mean) / normal.sigma) for end in (normal.low, normal.high))
    value = normal.mean + normal.sigma * float(ndtri(low + share * (high - low)))
    return min(max(value, normal.low), normal.high)
