"""Mutation test of a package: each line is changed in turn, and a test must fail.

Run: ``python benchmarks/mutation.py`` for the whole guard (an hour of CPU), ``--only _belt_monitor.py`` for one file,
``--package io --sample 60 --seed 1`` for 60 mutants of another package, ``--tests tests/cli tests/io`` for other tests than
``tests/io``. ``*_kernels.py`` is left out: its lines run as machine code, so that coverage does not see which test executes them.
Mutants: another comparison (``<`` for ``<=``, ``<`` for ``>=``), a number changed, and for or, not dropped or added, another
operation, another value returned. A mutant that no test detects survives and is listed: it shows a weak test, or it is equivalent
to the original and stands, with the reason, in ``mutation_equivalents.toml`` (of the guard). Text, docstrings and annotations
are not mutated.

The tests run once under coverage. Then each mutant runs the tests that execute its line, the quickest first, until one fails, in a
process that imports everything anew; the mutant of a line that only an import executes runs all tests, and a line that nothing
executes survives. Commands that a test starts run the original. Tests that fail on the original are left out and named, and of a
sample those of more than 5 s of CPU, too. Of the guard 95 % must be detected; other packages have no limit.

A sample holds the mutants with the smallest hashes of seed, file, text of the line, and change: when other lines move, appear or
leave, an unchanged line keeps its mutants. Results are kept in ``runs/mutation``, a file for each module. Of a whole run, what
was detected is not run again while that test exists; a sample has a folder of its own, ``PACKAGE-SAMPLE-SEED``, and starts empty.
"""

import argparse
import ast
import hashlib
import importlib
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

import coverage
import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
EQUIVALENTS = Path(__file__).with_name("mutation_equivalents.toml")
RESULTS = ROOT / "runs" / "mutation"
PYTEST = ("-pno:cacheprovider", "-pno:terminal", "-oaddopts=--import-mode=importlib", "-Wignore::pytest.PytestAssertRewriteWarning")
"""Options of pytest, which warns of libraries that are imported already."""
PATIENCE_S = 30
"""CPU time limit of a mutant's tests beyond three times their own [s]; a mutant that exceeds it counts as detected (``hangs``)."""
LEAST = 0.95
"""Share of the guard's mutants, without the equivalent ones, that the tests must detect."""

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
    first: int
    """Line where the statement begins."""
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

    def rank(self, seed: int) -> bytes:
        """Return the hash by which a sample is drawn."""
        return hashlib.sha256(f"{seed} {module_of(self.path)} {self.key}".encode()).digest()


def mutants_of(path: Path) -> list[Mutant]:
    """Return every change of a file, one at a time."""
    source = path.read_text()
    tree, lines = ast.parse(source), source.splitlines()
    silent = _silent(tree)
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]  # the outer ones first
    first = {id(inner): statement.lineno for statement in statements for inner in ast.walk(statement)}
    found, before = [], Counter[tuple[str, str]]()
    for index, node in enumerate(ast.walk(tree)):
        for change, spoil in () if id(node) in silent else _changes(node):
            line = node.lineno  # type: ignore[attr-defined]
            text = lines[line - 1].strip()
            before[text, change] += 1
            key = f"{text}  [{change}] {before[text, change]}"
            found.append(Mutant(path, line, first[id(node)], text, change, key, index, spoil))
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


class Watch:
    """Plugin of pytest: runs tests in a given order, and keeps CPU time, fixtures and failures."""

    def __init__(self, order: dict[str, int] | None = None, switch: Callable[[str], None] = str) -> None:
        self.order, self.switch = order, switch
        self.spent_s, self.fixtures, self.failed = Counter[str](), dict[str, list[str]](), list[str]()
        self._now = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the tests that are asked for."""
        if (order := self.order) is not None:
            items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Function) -> Iterator[None]:
        """Run one test."""
        self.fixtures[item.nodeid] = getattr(item, "fixturenames", [])
        with self._named(item.nodeid):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Set up a fixture; what several tests share counts for each of them."""
        with self._named(self._now if fixturedef.scope == "function" else fixturedef.argname):
            return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        """Keep which test failed, or that a file of tests could not be imported."""
        self.failed += [report.nodeid if "::" in report.nodeid else "import"] if report.failed else []

    pytest_collectreport = pytest_runtest_logreport

    @contextmanager
    def _named(self, name: str) -> Iterator[None]:
        before, began_s = self._now, sum(os.times()[:4])
        self._now = name
        self.switch(name)
        try:
            yield
        finally:
            self._now = before
            self.switch(before)
            spent_s = sum(os.times()[:4]) - began_s
            self.spent_s[name] += spent_s
            self.spent_s[before] -= spent_s


def tests_of(mutants: list[Mutant], asked: argparse.Namespace) -> dict[Mutant, dict[str, float]]:
    """Run the tests on the original; return those that execute each mutant's line, the quickest first, with their CPU time."""
    answer = in_child(lambda: _measured(asked.package, asked.tests or [str(ROOT / "tests" / asked.package)]), limit_s=3600)
    spent_s, executed, fixtures, failed = json.loads(answer or sys.exit("the tests do not end on the original"))
    costs_s = {test: sum(spent_s.get(name, 0.0) for name in (test, *fixtures[test])) for test in fixtures}
    left_out = {test for test in costs_s if test in failed or (asked.sample and costs_s[test] > asked.longest)}
    print(f"{len(costs_s)} tests; left out:", *sorted(left_out), sep="\n  ", flush=True)
    quickest_first = sorted(costs_s.keys() - left_out, key=costs_s.__getitem__)
    found = {}
    for mutant in mutants:
        by_line = executed[str(mutant.path)]
        lines = [mutant.line] if str(mutant.line) in by_line else range(mutant.first, mutant.line)
        names = {name for line in lines for name in by_line.get(str(line), ())}  # "" while nothing but imports runs
        found[mutant] = {test: costs_s[test] for test in quickest_first if names == {""} or names & {test, *fixtures[test]}}
    return found


def _measured(package: str, paths: list[str]) -> str:
    lines = coverage.Coverage(data_file=None, config_file=False, include=[str(SOURCE / "treadline" / package / "*")])
    lines.start()
    for path in files_of(package):
        with suppress(Exception):  # an extra is not installed
            importlib.import_module(module_of(path))
    watch = Watch(switch=lines.switch_context)
    pytest.main([*PYTEST, *paths], plugins=[watch])
    lines.stop()
    executed = {str(path): lines.get_data().contexts_by_lineno(str(path)) for path in files_of(package)}
    return json.dumps([watch.spent_s, executed, watch.fixtures, watch.failed])


def in_child(call: Callable[[], str], limit_s: float) -> str | None:
    """Return what a function answers in a forked process, or None if it does not end within a limit of CPU time."""
    with tempfile.TemporaryDirectory() as folder:
        answer, child = Path(folder, "answer"), os.fork()
        if child == 0:
            os.setsid()
            os.environ["PYTEST_DEBUG_TEMPROOT"] = folder
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (round(limit_s), round(limit_s)))
            signal.alarm(round(10 * limit_s))
            try:
                answer.write_text(call())
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what the tests have started
        return answer.read_text() if answer.exists() else None


def module_of(path: Path) -> str:
    """Return the name of a module."""
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts)


def detected(mutant: Mutant, costs_s: dict[str, float]) -> str:
    """Return the first test that detects a mutant, or "" if none does."""

    def run() -> str:
        load = SourceFileLoader.get_code

        def changed(loader: SourceFileLoader, name: str) -> Any:
            return compile(mutant.tree(), str(mutant.path), "exec") if name == module_of(mutant.path) else load(loader, name)

        SourceFileLoader.get_code = changed  # type: ignore[method-assign]
        watch = Watch({test: place for place, test in enumerate(costs_s)})
        pytest.main([*PYTEST, "-x", *{str(ROOT / test.split("::")[0]): None for test in costs_s}], plugins=[watch])
        return "".join(watch.failed[:1])

    answer = in_child(run, PATIENCE_S + 3 * sum(costs_s.values())) if costs_s else ""
    return "hangs" if answer is None else answer


def judge(mutants: dict[Mutant, dict[str, float]], folder: Path) -> None:
    """Run the tests of each mutant, and keep the result."""
    likely = ""
    for count, (mutant, costs_s) in enumerate(mutants.items(), start=1):
        # The test that detected one mutant is likely to detect the next.
        failed = detected(mutant, {test: costs_s[test] for test in (likely, *costs_s) if test in costs_s})
        likely = failed or likely
        with (folder / f"{module_of(mutant.path)}.jsonl").open("a") as results:
            results.write(json.dumps([mutant.key, failed]) + "\n")
        print(f"\r{count}/{len(mutants)}", end="", file=sys.stderr, flush=True)


def files_of(package: str) -> list[Path]:
    """Return the files of a package whose lines are changed."""
    files = sorted((SOURCE / "treadline" / package).rglob("*.py"))
    return [path for path in files if path.stem != "__init__" and not path.stem.endswith("_kernels")]


def known(mutants: list[Mutant], folder: Path) -> dict[Mutant, str]:
    """Return the test that detects each mutant, by the results kept."""
    results = {path.stem: dict(map(json.loads, path.read_text().splitlines())) for path in folder.glob("*.jsonl")}
    found = {mutant: results.get(module_of(mutant.path), {}).get(mutant.key) for mutant in mutants}
    return {mutant: test for mutant, test in found.items() if test is not None}


def main() -> int:
    """Create the mutants, run the tests, and report the survivors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", default="guard", help="folder of src/treadline; without it, guard")
    parser.add_argument("--tests", nargs="+", help="folders or files of tests; without it, tests/PACKAGE")
    parser.add_argument("--only", default="", help="one file, such as _belt_monitor.py")
    parser.add_argument("--sample", type=int, help="number of mutants; without it, all")
    parser.add_argument("--seed", type=int, default=1, help="which sample; without it, 1")
    parser.add_argument("--longest", type=float, default=5.0, help="a sample leaves out tests of more CPU time [s]; without it, 5")
    asked = parser.parse_args()
    files = [path for path in files_of(asked.package) if asked.only in ("", path.name)]
    mutants = [mutant for path in files for mutant in mutants_of(path)]
    folder = RESULTS
    if asked.sample is not None:
        mutants = sorted(mutants, key=lambda mutant: mutant.rank(asked.seed))[: asked.sample]
        folder = RESULTS / f"{asked.package}-{asked.sample}-{asked.seed}"
        shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("hypothesis", "matplotlib", "mujoco", "numba", "rosbags.typesys", "scipy.optimize"):
        importlib.import_module(name)  # once, before the processes of the mutants fork off
    tests, before = tests_of(mutants, asked), known(mutants, folder)
    todo = [mutant for mutant in mutants if before.get(mutant) not in {*tests[mutant], "import", "hangs"}]
    second = os.fork()
    judge({mutant: tests[mutant] for mutant in todo[second > 0 :: 2]}, folder)
    if second == 0:
        os._exit(0)
    os.waitpid(second, 0)
    return _report(mutants, known(mutants, folder), least=LEAST if asked.package == "guard" else 0.0)


def _report(mutants: list[Mutant], results: dict[Mutant, str], least: float) -> int:
    """Print the table and the survivors; return whether too many survive."""
    equivalents = tomllib.loads(EQUIVALENTS.read_text())
    total, killed, equivalent = Counter[str](), Counter[str](), Counter[str]()
    print(f"\n{'file':34} {'mutants':>8} {'killed':>8} {'equivalent':>11} {'share':>7}")
    for path in sorted({mutant.path for mutant in mutants}):
        name = path.relative_to(SOURCE / "treadline").as_posix().partition("/")[2]
        judged = [mutant for mutant in results if mutant.path == path]
        survivors = [mutant for mutant in judged if not results[mutant]]
        excused = {(each["line"], each["change"]) for each in equivalents.get(path.name, ())}
        equal = sum((mutant.text, mutant.change) in excused for mutant in survivors)
        total[name], killed[name], equivalent[name] = len(judged), len(judged) - len(survivors), equal
        print(_row(name, total[name], killed[name], equal))
        for mutant in survivors:
            if (mutant.text, mutant.change) not in excused:
                print(f"  survives: {mutant.line}: {mutant.change}:  {mutant.text}")
    print(_row("all", total.total(), killed.total(), equivalent.total()))
    return 0 if killed.total() >= least * (total.total() - equivalent.total()) else 1


def _row(name: str, total: int, killed: int, equivalent: int) -> str:
    return f"{name:34} {total:8} {killed:8} {equivalent:11} {killed / max(total - equivalent, 1):7.1%}"


if __name__ == "__main__":
    sys.exit(main())
