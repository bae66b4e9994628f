"""Size budgets: code lines, public names and numeric constants of each package only fall (``budgets.toml``)."""

import ast
import io
import sys
import tokenize
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUDGETS = tomllib.loads(Path(__file__).with_name("budgets.toml").read_text(encoding="utf-8"))
TREES = {"src": ROOT / "src" / "treadline", "tests": ROOT / "tests", "benchmarks": ROOT / "benchmarks"}
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


@dataclass
class Size:
    """Size of a package, or of a tree."""

    code_lines: int = 0
    """Physical lines without blanks, comments and docstrings."""
    public_names: int = 0
    """Classes and functions at module level, in modules and folders whose names have no leading underscore."""
    constants: int = 0
    """Numbers bound to a name at module or class level."""
    files: int = 0

    def add(self, other: "Size") -> None:
        for field in fields(self):
            setattr(self, field.name, getattr(self, field.name) + getattr(other, field.name))


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


def size_of(text: str, *, is_private: bool = False) -> Size:
    tree = ast.parse(text)
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    definitions = [node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    public = [] if is_private else [node for node in definitions if not node.name.startswith("_")]
    return Size(len(lines - docstring_lines(tree)), len(public), constants_of(tree.body), 1)


def sizes(tree: Path) -> dict[str, Size]:
    found: dict[str, Size] = {}
    for path in sorted(tree.rglob("*.py")):
        parts = path.relative_to(tree).parts
        is_private = any(part.startswith("_") and not part.startswith("__") for part in parts)
        package = parts[0] if len(parts) > 1 else "root"
        found.setdefault(package, Size()).add(size_of(path.read_text(encoding="utf-8"), is_private=is_private))
    total = Size()
    for size in list(found.values()):
        total.add(size)
    return found | {"total": total}


@pytest.mark.parametrize("tree", sorted(TREES))
def test_each_package_keeps_its_budget(tree: str) -> None:
    found = sizes(TREES[tree])
    budgets = BUDGETS[tree]
    assert set(found) == set(budgets), "budgets.toml lists each package; a new one needs a decision record"
    over = [
        f"{package}: {figure} {getattr(size, figure)}, budget {budget}"
        for package, size in found.items()
        for figure, budget in budgets[package].items()
        if getattr(size, figure) > budget
    ]
    assert not over, "smaller, or a decision record in docs/decisions that raises the figure"


def test_code_lines_are_counted_without_blanks_comments_and_docstrings() -> None:
    text = '"""Title."""\n\nLIMITS = (1.0, 2.0)\n"""Meaning."""\n\n\ndef f():  # why\n    """Say."""\n    # reason\n'
    text += "    return [\n        1,\n    ]\n"
    assert size_of(text) == Size(code_lines=5, public_names=1, constants=1, files=1)


def test_a_private_module_has_no_public_names() -> None:
    assert size_of("def f():\n    return 0\n", is_private=True).public_names == 0


def test_constants_of_a_class_count_and_flags_do_not() -> None:
    assert size_of("class A:\n    x: float = 1.0\n    y: bool = True\n    low, high = 1, 2\n").constants == 3


def lowered() -> str:
    """Return ``budgets.toml`` with each figure at its present size where that is lower."""
    lines = ["# Budgets of size. ``python tests/architecture/test_budgets.py`` lowers each figure to the present size."]
    lines += ["# It is raised only with a decision record in docs/decisions."]
    for tree, path in TREES.items():
        lines += ["", f"[{tree}]"]
        for package, size in sizes(path).items():
            known = BUDGETS.get(tree, {}).get(package, {})
            figures = {field.name: min(getattr(size, field.name), known.get(field.name, sys.maxsize)) for field in fields(size)}
            lines.append(f"{package} = {{ {', '.join(f'{name} = {value}' for name, value in figures.items())} }}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("budgets.toml").write_text(lowered(), encoding="utf-8")
