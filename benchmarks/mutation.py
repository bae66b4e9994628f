"""Mutation test of the guard: each line of the guard is changed in turn, and a test must fail.

Run: ``python benchmarks/mutation.py`` (half an hour of CPU), ``--only _belt_monitor.py`` for one file.
Mutants: another comparison (``<`` for ``<=``, ``<`` for ``>=``), a number changed, and for or, not dropped or added, another
operation, another value returned. A mutant that no test detects survives and is listed: it shows a weak test, or it is equivalent
to the original and stands, with the reason, in ``mutation_equivalents.toml``. Text, docstrings and annotations are not mutated.

Each mutant runs the tests that execute its line, the quickest first, in two processes. What was detected is kept in
``runs/mutation``, a file for each source file, and is not run again while that test exists.
"""

import argparse
import ast
import contextlib
import io
import json
import os
import resource
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType

import coverage
import pytest

ROOT = Path(__file__).parents[1]
GUARD = ROOT / "src" / "treadline" / "guard"
PACKAGE = "treadline.guard"
TESTS = ROOT / "tests" / "guard"
EQUIVALENTS = Path(__file__).with_name("mutation_equivalents.toml")
RESULTS = ROOT / "runs" / "mutation"
PATIENCE_S = 30
"""CPU time limit of a mutant's tests [s]; a mutant that exceeds it counts as detected (``hangs``)."""
LEAST = 0.95
"""Share of the mutants, without the equivalent ones, that the tests must detect."""

COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
}


Change = tuple[str, Callable[[ast.AST], None]]


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: Path
    line: int
    text: str
    change: str
    key: str
    """Line, change, and how many of these came before: what it is known by in the file of results."""
    index: int
    spoil: Callable[[ast.AST], None]

    def tree(self) -> ast.Module:
        """Return the changed file."""
        tree = ast.parse(self.path.read_text())
        self.spoil(next(node for k, node in enumerate(ast.walk(tree)) if k == self.index))
        return ast.fix_missing_locations(tree)


def mutants_of(path: Path) -> list[Mutant]:
    """Return every change of a file, one at a time."""
    source = path.read_text()
    tree, lines = ast.parse(source), source.splitlines()
    silent = _silent(tree)
    found, before = [], Counter[tuple[str, str]]()
    for index, node in enumerate(ast.walk(tree)):
        for change, spoil in () if id(node) in silent else _changes(node):
            line = node.lineno  # type: ignore[attr-defined]
            text = lines[line - 1].strip()
            before[text, change] += 1
            found.append(Mutant(path, line, text, change, f"{text}  [{change}] {before[text, change]}", index, spoil))
    return found


def _silent(tree: ast.Module) -> set[int]:
    """Return the nodes that say something to people or to the type checker alone."""
    silent: set[int] = set()
    for node in ast.walk(tree):
        parts = [getattr(node, "annotation", None), getattr(node, "returns", None), *getattr(node, "decorator_list", ())]
        parts.append(node if isinstance(node, ast.JoinedStr) else None)
        silent |= {id(inner) for part in parts if part is not None for inner in ast.walk(part)}
    return silent


def _changes(node: ast.AST) -> Iterator[Change]:
    """Return what may be spoilt in one node: what changes, and who changes it."""
    yield from _changed_operator(node)
    match node:
        case ast.Constant(value=bool()):
            yield f"{node.value} -> {not node.value}", _set("value", not node.value)
        case ast.Constant(value=int()):
            yield f"{node.value} -> {node.value + 1}", _set("value", node.value + 1)
        case ast.Constant(value=float()):
            changed = 1.5 * node.value or 1.0
            yield f"{node.value:g} -> {changed:g}", _set("value", changed)
        case ast.If() | ast.IfExp():
            yield "if x -> if not x", _negated("test")
        case ast.UnaryOp(op=ast.Not()):
            yield "not x -> x", _negated("operand")
        case ast.Return(value=ast.expr() as value) if not (isinstance(value, ast.Constant) and value.value in (None, False, True)):
            yield "x -> None", _set("value", ast.Constant(None))
        case ast.Expr(value=ast.Call()):
            yield "dropped", _set("value", ast.Constant(None))


def _changed_operator(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare():
            for k, op in enumerate(node.ops):
                for other in COMPARE[type(op)]:
                    yield f"{type(op).__name__} -> {other.__name__}", _set("ops", other(), k)
        case ast.BoolOp():
            joined: ast.boolop = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield f"{type(node.op).__name__} -> {type(joined).__name__}", _set("op", joined)
        case ast.UnaryOp(op=ast.USub()):
            yield "-x -> x", _set("op", ast.UAdd())
        case ast.BinOp() | ast.AugAssign() if type(node.op) in ARITHMETIC:
            new = ARITHMETIC[type(node.op)]
            yield f"{type(node.op).__name__} -> {new.__name__}", _set("op", new())
        case ast.Call(func=ast.Name(id="min" | "max" as name)):
            other_name = "max" if name == "min" else "min"
            yield f"{name} -> {other_name}", _set("func", ast.Name(other_name, ast.Load()))


def _set(field: str, value: object, index: int | None = None) -> Callable[[ast.AST], None]:
    def spoil(node: ast.AST) -> None:
        if index is None:
            setattr(node, field, value)
        else:
            getattr(node, field)[index] = value

    return spoil


def _negated(field: str) -> Callable[[ast.AST], None]:
    return lambda node: setattr(node, field, ast.UnaryOp(ast.Not(), getattr(node, field)))


@dataclass(frozen=True)
class Case:
    """One test, ready to be called."""

    name: str
    call: Callable[[], None]
    module: ModuleType


class Collector:
    """Keeps the tests that pytest finds."""

    def __init__(self) -> None:
        self.cases: list[Case] = []

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Take them, with their parameters."""
        for item in session.items:
            if isinstance(item, pytest.Function):
                params = item.callspec.params if hasattr(item, "callspec") else {}
                self.cases.append(Case(item.nodeid, partial(item.obj, **params), item.module))


def collected() -> tuple[list[Case], coverage.CoverageData]:
    """Return the guard's tests, the quickest first, and the lines that each executes."""
    collector = Collector()
    options = ["-q", "--collect-only", "-p", "no:cacheprovider", "-o", "addopts=--import-mode=importlib"]
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*options, str(TESTS)], plugins=[collector])
    spent = {}
    lines = coverage.Coverage(data_file=None, config_file=False, include=[str(GUARD / "*")])
    lines.start()
    for case in collector.cases:
        lines.switch_context(case.name)
        began = time.perf_counter()
        case.call()
        spent[case.name] = time.perf_counter() - began
    lines.stop()
    return sorted(collector.cases, key=lambda case: spent[case.name]), lines.get_data()


def detected(mutant: Mutant, cases: list[Case]) -> str:
    """Return the test that detects a mutant, or "" if none does. The tests run in a forked process, after the imports."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE_S, PATIENCE_S))
        os.write(write, _first_failure(mutant, cases).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        failed = pipe.read()
    _, status = os.waitpid(child, 0)
    return failed if status == 0 else "hangs"


def _first_failure(mutant: Mutant, cases: list[Case]) -> str:
    try:
        _install(mutant)
    except Exception:  # noqa: BLE001 - a mutant may fail in any way, and each failure counts as detected
        return "import"
    for case in cases:
        try:
            case.call()
        except BaseException:  # noqa: BLE001 - as above; pytest.fail is no Exception
            return case.name
    return ""


def _install(mutant: Mutant) -> None:
    """Run the mutant's module, put what it defines wherever the original's had been imported, and forget results kept by it."""
    name = f"{PACKAGE}.{mutant.path.stem}"
    original = dict(vars(sys.modules[name]))
    fresh = ModuleType(name)
    sys.modules[name] = fresh  # a dataclass looks its own module up
    exec(compile(mutant.tree(), str(mutant.path), "exec"), vars(fresh))  # noqa: S102 - our own source, changed in one place
    for module in [module for module in sys.modules.values() if str(getattr(module, "__file__", "")).startswith(str(ROOT))]:
        for key, value in list(vars(module).items()):
            if key in original and not key.startswith("__") and value is original[key] and key in vars(fresh):
                setattr(module, key, vars(fresh)[key])
            elif hasattr(value, "cache_clear"):
                value.cache_clear()


def judge(mutants: list[Mutant], cases: list[Case], lines: coverage.CoverageData) -> None:
    """Run the tests of each mutant, and keep the result."""
    executed = {path: lines.contexts_by_lineno(str(path)) for path in {mutant.path for mutant in mutants}}
    for count, mutant in enumerate(mutants, start=1):
        names = {name for name in executed[mutant.path].get(mutant.line, ()) if name}
        failed = detected(mutant, [case for case in cases if case.name in names or not names])
        with (RESULTS / f"{mutant.path.stem}.jsonl").open("a") as results:
            results.write(json.dumps([mutant.key, failed]) + "\n")
        # The test that detected one mutant is likely to detect the next.
        cases.sort(key=lambda case, failed=failed: case.name != failed)  # type: ignore[misc]
        print(f"\r{count}/{len(mutants)}", end="", file=sys.stderr, flush=True)


def known(path: Path) -> dict[str, str]:
    """Return the test that detects each mutant of a file as it is now, by the results kept."""
    file = RESULTS / f"{path.stem}.jsonl"
    results = dict(map(json.loads, file.read_text().splitlines())) if file.exists() else {}
    return {mutant.key: results[mutant.key] for mutant in mutants_of(path) if mutant.key in results}


def main() -> int:
    """Create the mutants, run the tests, and report the survivors."""
    parser = argparse.ArgumentParser(description="Mutation run over the guard.")
    parser.add_argument("--only", default="", help="one file, such as _belt_monitor.py")
    asked = parser.parse_args()
    files = [path for path in sorted(GUARD.glob("*.py")) if path.stem != "__init__" and asked.only in ("", path.name)]
    mutants = [mutant for path in files for mutant in mutants_of(path)]
    cases, lines = collected()
    RESULTS.mkdir(parents=True, exist_ok=True)
    names = {case.name for case in cases} | {"import", "hangs"}
    before = {path: known(path) for path in files}
    mutants = [mutant for mutant in mutants if before[mutant.path].get(mutant.key) not in names]
    second = os.fork()
    judge(mutants[second > 0 :: 2], cases, lines)
    if second == 0:
        os._exit(0)
    os.waitpid(second, 0)
    return _report(files)


def _report(files: list[Path]) -> int:
    """Print the table and the survivors; return whether too many survive."""
    equivalents = tomllib.loads(EQUIVALENTS.read_text())
    total, killed, equivalent = Counter[str](), Counter[str](), Counter[str]()
    print(f"\n{'file':22} {'mutants':>8} {'killed':>8} {'equivalent':>11} {'share':>7}")
    for path in files:
        results = known(path)
        survivors = [mutant for mutant in mutants_of(path) if results.get(mutant.key) == ""]
        excused = {(each["line"], each["change"]) for each in equivalents.get(path.name, ())}
        equal = sum((mutant.text, mutant.change) in excused for mutant in survivors)
        total[path.name], equivalent[path.name] = len(results), equal
        killed[path.name] = sum(bool(killer) for killer in results.values())
        print(_row(path.name, total[path.name], killed[path.name], equal))
        for mutant in survivors:
            if (mutant.text, mutant.change) not in excused:
                print(f"  survives: {mutant.line}: {mutant.change}:  {mutant.text}")
    print(_row("all", total.total(), killed.total(), equivalent.total()))
    return 0 if killed.total() >= LEAST * (total.total() - equivalent.total()) else 1


def _row(name: str, total: int, killed: int, equivalent: int) -> str:
    return f"{name:22} {total:8} {killed:8} {equivalent:11} {killed / max(total - equivalent, 1):7.1%}"


if __name__ == "__main__":
    sys.exit(main())
