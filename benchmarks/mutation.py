"""Mutation test of the guard: each line of the guard is changed in turn, and a test must fail.

Run: ``python benchmarks/mutation.py`` (some minutes of CPU), ``--sample 40`` for a quick look, ``--only _belt_monitor.py`` for one
file.
Mutants: another comparison (``<`` for ``<=``, ``<`` for ``>=``), a number changed, and for or, not dropped or added, another
operation, another value returned. A mutant that no test detects survives and is listed: it shows a weak test, or it is equivalent
to the original. Text, docstrings and annotations are not mutated.
"""

import argparse
import ast
import contextlib
import copy
import io
import os
import random
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
GUARD = ROOT / "src" / "treadline" / "guard"
PACKAGE = "treadline.guard"
TESTS = sorted((ROOT / "tests" / "guard").glob("test_guard*.py"))
PATIENCE_S = 30
"""CPU time limit of a mutant's tests [s]; a mutant that exceeds it counts as detected (``hangs``)."""

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


Change = tuple[str, str, Callable[[ast.AST], None]]


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: Path
    line: int
    kind: str
    change: str
    tree: ast.Module


def mutants_of(path: Path) -> list[Mutant]:
    """Return every change of a file, one at a time."""
    source = path.read_text()
    tree = ast.parse(source)
    silent = _silent(tree)
    found = []
    for index, node in enumerate(ast.walk(tree)):
        if id(node) in silent:
            continue
        for kind, change, spoil in _changes(node):
            spoilt = copy.deepcopy(tree)
            target = next(other for k, other in enumerate(ast.walk(spoilt)) if k == index)
            spoil(target)
            found.append(Mutant(path, getattr(node, "lineno", 0), kind, change, ast.fix_missing_locations(spoilt)))
    return found


def _silent(tree: ast.Module) -> set[int]:
    """Return the nodes that say something to people or to the type checker alone."""
    silent: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        match node:
            case ast.AnnAssign():
                parts = [node.annotation]
            case ast.arg():
                parts = [node.annotation]
            case ast.FunctionDef():
                parts = [node.returns, *node.decorator_list]
            case ast.ClassDef():
                parts = list(node.decorator_list)
            case ast.JoinedStr():
                parts = [node]
            case _:
                continue
        silent |= {id(inner) for part in parts if part is not None for inner in ast.walk(part)}
    return silent


def _changes(node: ast.AST) -> Iterator[Change]:
    """Return what may be spoilt in one node: kind, what changes, and who changes it."""
    yield from _changed_operator(node)
    match node:
        case ast.Constant(value=bool()):
            yield "number", f"{node.value} -> {not node.value}", _set("value", not node.value)
        case ast.Constant(value=int()):
            yield "number", f"{node.value} -> {node.value + 1}", _set("value", node.value + 1)
        case ast.Constant(value=float()):
            changed = 1.5 * node.value or 1.0
            yield "number", f"{node.value:g} -> {changed:g}", _set("value", changed)
        case ast.If() | ast.IfExp():
            yield "boolean", "if x -> if not x", _negated("test")
        case ast.UnaryOp(op=ast.Not()):
            yield "boolean", "not x -> x", _negated("operand")
        case ast.Return(value=ast.expr() as value) if not (isinstance(value, ast.Constant) and value.value is None):
            yield "return", "x -> None", _set("value", ast.Constant(None))
        case ast.Expr(value=ast.Call()):
            yield "statement", "dropped", _set("value", ast.Constant(None))


def _changed_operator(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare():
            for k, op in enumerate(node.ops):
                for other in COMPARE[type(op)]:
                    yield "comparison", f"{type(op).__name__} -> {other.__name__}", _set("ops", other(), k)
        case ast.BoolOp():
            joined: ast.boolop = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield "boolean", f"{type(node.op).__name__} -> {type(joined).__name__}", _set("op", joined)
        case ast.UnaryOp(op=ast.USub()):
            yield "arithmetic", "-x -> x", _set("op", ast.UAdd())
        case ast.BinOp() | ast.AugAssign() if type(node.op) in ARITHMETIC:
            new = ARITHMETIC[type(node.op)]
            yield "arithmetic", f"{type(node.op).__name__} -> {new.__name__}", _set("op", new())
        case ast.Call(func=ast.Name(id="min" | "max" as name)):
            other_name = "max" if name == "min" else "min"
            yield "arithmetic", f"{name} -> {other_name}", _set("func", ast.Name(other_name, ast.Load()))


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


def collected() -> list[Case]:
    """Return the guard's tests, the quickest first."""
    collector = Collector()
    options = ["-q", "--collect-only", "-p", "no:cacheprovider", "-o", "addopts=--import-mode=importlib"]
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*options, *map(str, TESTS)], plugins=[collector])
    spent = {}
    for case in collector.cases:
        began = time.process_time()
        case.call()
        spent[case.name] = time.process_time() - began
    return sorted(collector.cases, key=lambda case: spent[case.name])


def noticed(mutant: Mutant, cases: list[Case]) -> str:
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
        _install(mutant, {case.module.__name__: case.module for case in cases})
    except Exception as error:  # noqa: BLE001 - a mutant may fail in any way, and each failure counts as detected
        return f"import raises {type(error).__name__}"
    for case in cases:
        try:
            case.call()
        except BaseException:  # noqa: BLE001 - as above; pytest.fail is no Exception
            return case.name
    return ""


def _install(mutant: Mutant, tests: dict[str, ModuleType]) -> None:
    """Run the mutant's module, and put what it defines wherever the original's had been imported."""
    name = f"{PACKAGE}.{mutant.path.stem}"
    original = dict(vars(sys.modules[name]))
    fresh = ModuleType(name)
    sys.modules[name] = fresh  # a dataclass looks its own module up
    exec(compile(mutant.tree, str(mutant.path), "exec"), vars(fresh))  # noqa: S102 - our own source, changed in one place
    users = [module for key, module in sys.modules.items() if key.startswith(PACKAGE)]
    for module in (*users, *tests.values()):
        for key, value in list(vars(module).items()):
            if key in original and not key.startswith("__") and value is original[key] and key in vars(fresh):
                setattr(module, key, vars(fresh)[key])


def main() -> int:
    """Create the mutants, run the tests, and report the survivors."""
    parser = argparse.ArgumentParser(description="Mutation run over the guard.")
    parser.add_argument("--sample", type=int, default=0, help="mutants drawn at random, the same each time; 0 for all")
    parser.add_argument("--only", default="", help="one file, such as _belt_monitor.py")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    files = [path for path in sorted(GUARD.glob("*.py")) if path.stem != "__init__" and asked.only in ("", path.name)]
    mutants = [mutant for path in files for mutant in mutants_of(path)]
    if asked.sample:
        mutants = random.Random(asked.seed).sample(mutants, min(asked.sample, len(mutants)))
    cases = collected()
    total, killed, survivors = Counter[str](), Counter[str](), []
    for count, mutant in enumerate(mutants, start=1):
        failed = noticed(mutant, cases)
        total[mutant.path.name] += 1
        if failed:
            killed[mutant.path.name] += 1
            # The test that detected one mutant is likely to detect the next.
            cases.sort(key=lambda case, failed=failed: case.name != failed)  # type: ignore[misc]
        else:
            survivors.append(mutant)
        print(f"\r{count}/{len(mutants)}  killed {sum(killed.values())}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    _tell(total, killed, survivors)
    return 0 if sum(killed.values()) >= 0.9 * sum(total.values()) else 1


def _tell(total: Counter[str], killed: Counter[str], survivors: list[Mutant]) -> None:
    print(f"{'file':14} {'mutants':>8} {'killed':>8} {'share':>7}")
    for name in sorted(total):
        print(f"{name:14} {total[name]:8} {killed[name]:8} {killed[name] / total[name]:7.1%}")
    print(f"{'all':14} {total.total():8} {killed.total():8} {killed.total() / max(total.total(), 1):7.1%}")
    for mutant in sorted(survivors, key=lambda mutant: (mutant.path.name, mutant.line)):
        line = mutant.path.read_text().splitlines()[mutant.line - 1].strip()
        print(f"survives: {mutant.path.name}:{mutant.line}: {mutant.kind}, {mutant.change}:  {line}")


if __name__ == "__main__":
    sys.exit(main())
