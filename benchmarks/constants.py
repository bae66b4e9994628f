"""Sensitivity of traversals to each numeric constant of ``mission`` and ``control``: every constant times 0.8 and 1.25.

Run: ``nice python benchmarks/constants.py [--all] [--only WORDS] [--publish]``. Constants are read from the source: every module or
class-level assignment whose value has a number, default values of configurations included. A constant's first effect ends
its runs, unless ``--all`` is given. ``--publish`` writes ``docs/evidence/constants.md``.

Each variation is a process of its own, in which the module's source has ``(value) * factor`` in place of the value: constants
derived from it and modules that import it follow.
"""

import argparse
import ast
import contextlib
import importlib.abc
import importlib.machinery
import json
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from treadline.core.files import write_whole
from treadline.run import episode
from treadline.scenario.scenario import scenario_of
from treadline.scenario.shipped_files import shipped_controller

ROOT = Path(__file__).parents[1]
EVIDENCE = ROOT / "docs" / "evidence" / "constants.md"
SOURCE = ROOT / "src" / "treadline"
PACKAGES = ("control", "mission")
BELOW = ("core", "data", "guard", "identification", "io", "perception", "plant", "scenario", "vehicle")
"""Packages that import none of ``PACKAGES``: their modules and compiled kernels are kept in a variation."""
FACTORS = (0.8, 1.25)
SEEDS = (1, 2)
STAIR = {"slope_deg": 28.0, "steps": 4, "landing_m": 3.0}
DOWN: dict[str, Any] = {"start": {"place": "landing"}, "drive": {"direction": "down"}}
CASES: dict[str, dict[str, Any]] = {
    "up": {"stair": STAIR},
    "down": {"stair": STAIR, **DOWN},
    "turn": {
        "stair": {"slope_deg": 28.0, "steps": 14, "width_m": 3.0},
        "start": {"place": "flight", "step": 4, "heading_deg": 20.0},
        "drive": {"duration_s": 12.0, "check": False},
    },
    "high top riser, up": {"stair": STAIR, "step": [{"index": -1, "rise_m": 0.1895}]},
    "wet step, up": {"stair": STAIR | {"friction": [0.8, 0.65]}, "step": [{"index": 3, "friction": [0.36, 0.3]}]},
    "split friction, down": {"stair": STAIR | {"friction": [0.8, 0.65], "friction_right": [0.48, 0.39]}, **DOWN},
}
USUAL = ("up", "down", "turn")
"""Cases that come first."""
SCALES = {
    "duration_s": 40.0,
    "rms_heading_deg": 2.3,
    "max_pitch_rate_deg_s": 15.0,
    "passenger_max_m_s2": 2.5,
    "min_stability_margin_deg": 5.0,
    "seat_max_deg": 5.0,
    "roll_back_m": 0.1,
    "lateral_m": 0.15,
}
"""Scores, and what a change is divided by: the issue's limits, Table II's heading, a usual duration, the guard's limit of pitch."""
EFFECT = 0.05
"""Change, over its scale, above which a score moves; runs of the same constants are identical to the digit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NumericConstant:
    """A numeric assignment in a module or a class."""

    module: str
    """Dotted name."""
    name: str
    """Qualified name in the module."""
    text: str
    """Value as written."""

    @property
    def label(self) -> str:
        """Name without the package's prefix."""
        return f"{self.module.removeprefix('treadline.')}.{self.name}"


Run = tuple[str, int]
"""Case and seed."""
Effect = tuple[float, str]
"""Largest change of a score over its scale, and where: score, case, factor."""


def has_number(value: ast.expr | None) -> bool:
    """Return whether an expression contains a number."""
    numbers = (node.value for node in ast.walk(value) if isinstance(node, ast.Constant)) if value is not None else ()
    return any(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers)


def assignments(tree: ast.Module | ast.ClassDef, scope: str = "") -> Iterator[tuple[str, ast.expr, ast.Assign | ast.AnnAssign]]:
    """Yield qualified name, value and statement of each numeric assignment; one of a tuple of names for each of its elements."""
    for statement in tree.body:
        if isinstance(statement, ast.ClassDef):
            yield from assignments(statement, f"{scope}{statement.name}.")
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and has_number(statement.value):
            yield scope + statement.target.id, statement.value, statement  # type: ignore[misc]
        elif isinstance(statement, ast.Assign) and has_number(statement.value):
            target = statement.targets[0]
            if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
                for name, value in zip(target.elts, statement.value.elts, strict=True):
                    yield scope + ast.unparse(name), value, statement
            else:
                yield scope + ast.unparse(target), statement.value, statement


def constants() -> list[NumericConstant]:
    """Return the numeric constants of the packages, in the order of their files."""
    found = []
    for path in sorted(path for package in PACKAGES for path in (SOURCE / package).rglob("*.py")):
        module = ".".join(("treadline", *path.relative_to(SOURCE).with_suffix("").parts))
        for name, value, _ in assignments(ast.parse(path.read_text(encoding="utf-8"))):
            found.append(NumericConstant(module=module, name=name, text=ast.unparse(value)))
    return found


def scaled(value: Any, factor: float) -> Any:
    """Return a value with every number in it multiplied; whole numbers change by one at least."""
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, int):
        return max(round(value * factor), value + 1) if factor > 1.0 else min(round(value * factor), value - 1)
    if isinstance(value, float | np.ndarray):
        return value * factor
    if isinstance(value, Mapping):
        return type(value)({key: scaled(item, factor) for key, item in value.items()})  # type: ignore[call-arg]
    if isinstance(value, tuple | list):
        return type(value)(scaled(item, factor) for item in value)
    raise TypeError(f"{type(value).__name__} is not scaled")


class VariedSource(importlib.abc.MetaPathFinder):
    """Import hook: the module of a constant is compiled with the constant multiplied by a factor."""

    def __init__(self, constant: NumericConstant, factor: float) -> None:
        self._constant, self._factor = constant, factor

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> importlib.machinery.ModuleSpec | None:
        """Return the usual specification with a loader that changes the source; None for other modules."""
        if fullname != self._constant.module:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        assert spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader)  # noqa: S101, PT018
        spec.loader = _VaryingLoader(fullname, spec.loader.path, self._varied)
        return spec

    def _varied(self, source: bytes) -> ast.Module:
        tree = ast.parse(source)
        for name, value, statement in assignments(tree):
            if name == self._constant.name:
                call = ast.parse(f"__scaled__({ast.unparse(value)}, {self._factor})", mode="eval").body
                if statement.value is value:
                    statement.value = call
                else:
                    elements = statement.value.elts  # type: ignore[union-attr]
                    elements[[element is value for element in elements].index(True)] = call
        return ast.fix_missing_locations(tree)


class _VaryingLoader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, varied: Any) -> None:
        super().__init__(name, path)
        self._varied = varied

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - the name of the interface
        return compile(self._varied(self.get_data(self.path)), self.path, "exec", dont_inherit=True)


def scores(case: str, seed: int) -> dict[str, Any]:
    """Return verdict and scores of one run."""
    tables = CASES[case] | {"sensors": {"camera": "statistical"}}
    scenario = scenario_of(tables, Path("constants.toml"), where=case)
    run = sys.modules["treadline.run.episode"].traverse(scenario, controller=shipped_controller("wheelchair"), seed=seed)
    summary = run.summary()
    return {"verdict": run.verdict} | {name: summary[name] for name in SCALES}


def in_a_variation(constant: NumericConstant, factor: float, runs: list[Run]) -> Iterator[dict[str, Any]]:
    """Yield the scores of runs in a forked process with one constant multiplied; an error ends them."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _vary(constant, factor)
        with os.fdopen(writer, "w") as out:
            try:
                importlib.import_module("treadline.run.episode")
                for case, seed in runs:
                    out.write(json.dumps(scores(case, seed)) + "\n")
                    out.flush()
            except Exception:  # noqa: BLE001 - a constant that does not scale is reported, whatever it breaks
                out.write(json.dumps({"verdict": f"error: {traceback.format_exc().splitlines()[-1]}"}) + "\n")
        os._exit(0)
    os.close(writer)
    try:
        with os.fdopen(reader) as lines:
            yield from map(json.loads, lines)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _vary(constant: NumericConstant, factor: float) -> None:
    """Forget the modules that may hold the constant, and have them imported anew with it multiplied."""
    import builtins

    builtins.__scaled__ = scaled  # type: ignore[attr-defined]
    sys.meta_path.insert(0, VariedSource(constant, factor))
    for name in [name for name in sys.modules if name.startswith("treadline.") and name.split(".")[1] not in BELOW]:
        del sys.modules[name]


def effect(varied: Mapping[str, Any], nominal: Mapping[str, Any]) -> Effect:
    """Return the largest change of a score over its scale; another verdict counts as infinite."""
    if varied["verdict"] != nominal["verdict"]:
        return float("inf"), f"{nominal['verdict']} → {varied['verdict']}"
    changes = [
        (abs(varied[name] - nominal[name]) / scale, name)
        for name, scale in SCALES.items()
        if varied[name] is not None and nominal[name] is not None
    ]
    return max(changes)


def largest_effect(
    constant: NumericConstant, factor: float, runs: list[Run], nominal: Mapping[Run, Mapping[str, Any]], *, whole: bool
) -> Effect:
    """Return the largest effect of a constant at one factor over some runs; the first one that counts, unless ``whole``."""
    largest: Effect = (0.0, "")
    with contextlib.closing(in_a_variation(constant, factor, runs)) as outcomes:
        for run, outcome in zip(runs, outcomes, strict=False):
            size, where = effect(outcome, nominal[run])
            largest = max(largest, (size, f"{where}; {run[0]}, x {factor:g}" if size else ""))
            if not whole and size > EFFECT:
                break
    return largest


def measured(
    chosen: Sequence[NumericConstant], nominal: Mapping[Run, Mapping[str, Any]], *, whole: bool
) -> dict[NumericConstant, Effect]:
    """Return the largest effect of each constant; first in the usual traversals, then in the others."""
    effects: dict[NumericConstant, Effect] = dict.fromkeys(chosen, (0.0, ""))
    for cases, factor in product((USUAL, [case for case in CASES if case not in USUAL]), FACTORS):
        runs = [(case, seed) for seed in (SEEDS if whole else SEEDS[:1]) for case in cases]
        for constant in chosen:
            if whole or effects[constant][0] <= EFFECT:
                effects[constant] = max(effects[constant], largest_effect(constant, factor, runs, nominal, whole=whole))
                size, where = effects[constant]
                sys.stderr.write(f"{factor:g} {', '.join(cases)} {size:8.3f} {constant.label} = {constant.text}  {where}\n")
    return effects


def table(effects: Mapping[NumericConstant, Effect]) -> str:
    """Return the page of evidence: constants by effect, smallest first."""
    lines = [
        "# Constants of mission and control: what each of them moves",
        "",
        f"{datetime.now(tz=UTC):%Y-%m-%d}: `nice python benchmarks/constants.py --publish`. Each constant times {FACTORS[0]} and",
        f"{FACTORS[1]}; 28°, statistical camera; cases: {'; '.join(CASES)}.",
        f"Change: the largest of {', '.join(f'{name}/{scale:g}' for name, scale in SCALES.items())};",
        "∞ where the verdict changes. The runs of a constant stop at its first change above "
        f"{EFFECT}, unless `--all` is given: a smaller change is the largest in all runs.",
        "A constant that moves nothing here can still matter in a fault or on a stair that no case has.",
        "",
        "| constant | value | change | where |",
        "| --- | --- | --- | --- |",
    ]
    ordered = sorted(effects.items(), key=lambda item: item[1][0])
    for constant, (size, where) in ordered:
        if size > 0.0:
            lines.append(f"| {constant.label} | {constant.text} | {'∞' if size == float('inf') else f'{size:.3f}'} | {where} |")
    unmoved = (f"{constant.label} = {constant.text}" for constant, (size, _) in ordered if size == 0.0)
    return "\n".join([*lines, "", "Same digits in all runs: " + "; ".join(unmoved) + "."]) + "\n"


def main() -> None:
    """Vary every constant and print or publish the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="run all cases and seeds of every constant")
    parser.add_argument("--only", nargs="*", default=[""], help="constants whose name contains one of these words")
    parser.add_argument("--publish", action="store_true", help="write docs/evidence/constants.md")
    options = parser.parse_args()
    nominal = {(case, seed): scores(case, seed) for case in CASES for seed in SEEDS}
    loaded = [constant for constant in constants() if constant.module in sys.modules]
    chosen = [constant for constant in loaded if any(word in constant.label for word in options.only)]
    page = table(measured(chosen, nominal, whole=options.all))
    if options.publish:
        write_whole(EVIDENCE, page)
    else:
        sys.stdout.write(page)


if __name__ == "__main__":
    assert episode  # noqa: S101 - imported so that its kernels are compiled once
    main()
