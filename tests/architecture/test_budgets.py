"""Budgets of size (``budgets.toml``): a total may fall, never rise; packages trade among themselves.

Counted are code lines of each tree and, of ``src``, what a reader has to hold in mind whatever it is called: top-level names and
methods, with and without underscore, numeric constants and files; of the documents, words.
"""

import ast
import io
import tokenize
import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILE = Path(__file__).with_name("budgets.toml")
BUDGETS = tomllib.loads(FILE.read_text(encoding="utf-8"))
TREES = {"src": ROOT / "src" / "treadline", "tests": ROOT / "tests", "benchmarks": ROOT / "benchmarks"}
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
HIDDEN = {"node_modules", "build", "site", "dist", "reproduce", "runs"}
"""Folders of what is built or installed; those with a leading dot are left out as well."""


@dataclass
class Size:
    """Size of a file, or of a tree."""

    code_lines: int = 0
    """Physical lines without blanks, comments and docstrings."""
    names: int = 0
    """Classes and functions at module level, underscored ones too."""
    methods: int = 0
    """Functions in the classes at module level."""
    constants: int = 0
    """Numbers bound to a name at module or class level."""
    files: int = 0


def docstring_lines(tree: ast.Module) -> set[int]:
    bodies = [body for node in ast.walk(tree) if isinstance(body := getattr(node, "body", None), list)]
    texts = [
        statement
        for body in bodies
        for statement in body
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant) and isinstance(statement.value.value, str)
    ]
    return {line for text in texts for line in range(text.lineno, (text.end_lineno or text.lineno) + 1)}


def has_number(value: ast.expr | None) -> bool:
    nodes = [] if value is None else [node for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return any(isinstance(node.value, int | float) and not isinstance(node.value, bool) for node in nodes)


def constants_of(body: list[ast.stmt]) -> int:
    count = 0
    for statement in body:
        if isinstance(statement, ast.Assign) and has_number(statement.value):
            count += sum(len(target.elts) if isinstance(target, ast.Tuple) else 1 for target in statement.targets)
        elif isinstance(statement, ast.AnnAssign):
            count += has_number(statement.value)
        elif isinstance(statement, ast.ClassDef):
            count += constants_of(statement.body)
    return count


def size_of(text: str) -> Size:
    tree = ast.parse(text)
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    functions = ast.FunctionDef | ast.AsyncFunctionDef
    names = [node for node in tree.body if isinstance(node, functions | ast.ClassDef)]
    methods = [part for node in names if isinstance(node, ast.ClassDef) for part in node.body if isinstance(part, functions)]
    return Size(len(lines - docstring_lines(tree)), len(names), len(methods), constants_of(tree.body), 1)


def total_of(tree: Path) -> Size:
    sizes = [asdict(size_of(path.read_text(encoding="utf-8"))) for path in sorted(tree.rglob("*.py"))]
    return Size(**{name: sum(size[name] for size in sizes) for name in sizes[0]})


def document_words() -> int:
    """Return the words of pages and notebooks outside ``tests``, counted as ``wc -w`` does."""
    pages = [path for ending in ("*.md", "*.ipynb") for path in ROOT.rglob(ending)]
    kept = [path for path in pages if not any(part in HIDDEN or part[0] == "." for part in path.relative_to(ROOT).parts[:-1])]
    own = [path for path in kept if path.relative_to(ROOT).parts[0] != "tests" and path.name != "commands.md"]
    github = list((ROOT / ".github").rglob("*.md"))
    return sum(len(path.read_bytes().split()) for path in own + github if "gallery" not in path.parts)


@cache
def present() -> dict[str, dict[str, int]]:
    """Return the figures of ``budgets.toml`` as they are now."""
    sizes = {
        name: {key: value for key, value in asdict(total_of(path)).items() if key in BUDGETS[name]} for name, path in TREES.items()
    }
    return sizes | {"documents": {"words": document_words()}}


@pytest.mark.parametrize("tree", sorted(BUDGETS))
def test_no_total_rises_above_its_budget(tree: str) -> None:
    over = {name: (figure, BUDGETS[tree][name]) for name, figure in present()[tree].items() if figure > BUDGETS[tree][name]}
    assert not over, "smaller, or a decision record in docs/decisions that raises the figure"


def test_code_lines_are_counted_without_blanks_comments_and_docstrings() -> None:
    text = '"""Title."""\n\nLIMITS = (1.0, 2.0)\n"""Meaning."""\n\n\ndef f():  # why\n    """Say."""\n    # reason\n'
    text += "    return [\n        1,\n    ]\n"
    assert size_of(text) == Size(code_lines=5, names=1, methods=0, constants=1, files=1)


def test_an_underscore_hides_no_name_and_no_method() -> None:
    text = "def _f(): ...\nasync def g(): ...\nclass _A:\n    def _m(self): ...\n    def n(self):\n        def inner(): ...\n"
    assert (size_of(text).names, size_of(text).methods) == (3, 2)


def test_constants_of_a_class_count_and_flags_do_not() -> None:
    assert size_of("class A:\n    x: float = 1.0\n    y: bool = True\n    low, high = 1, 2\n").constants == 3


def lowered() -> str:
    """Return ``budgets.toml`` with each figure at its present size where that is lower."""
    lines = [line for line in FILE.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    for tree, figures in present().items():
        lines += ["", f"[{tree}]", *(f"{name} = {min(value, BUDGETS[tree][name])}" for name, value in figures.items())]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    FILE.write_text(lowered(), encoding="utf-8")
