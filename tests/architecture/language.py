"""Checker of the wording of code and documents: run ``python tests/architecture/language.py FOLDER [FOLDER …]``.

Each finding is one line, ``path:line: rule: text``; the exit code is 1 if there is any finding. Four rules:

* ``fragment``: an attribute docstring starts with a preposition or a lower-case word, so that it cannot be read alone.
* ``continued``: a docstring starts or ends with an ellipsis, so that its sentence continues in another docstring.
* ``homonym``: a class name is defined in two modules.
* ``retired``: a name, docstring, comment, message or document uses a term that the project has replaced.
"""

import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

PREPOSITION = re.compile(
    r"about|above|across|after|against|along|among|around|as|at|before|behind|below|beneath|beside|between|beyond|by|despite|during|"
    r"except|for|from|in|inside|into|like|near|of|off|on|onto|outside|over|per|since|than|through|till|towards?|to|under|until|upon|"
    r"up|via|within|without|with",
    re.IGNORECASE,
)
SYMBOL = re.compile(r"^[a-z]$|[0-9_·=^]|^p-value")
"""First words that are symbols and not lower-case English words: ``x``, ``u1``, ``f·B``, ``p-value``."""

RETIRED = tomllib.loads(Path(__file__).with_name("language.toml").read_text(encoding="utf-8"))
RETIRED_NAMES: dict[str, str] = RETIRED["names"]
"""Names that were replaced, with the name to use; matched as whole names of what is defined."""
RETIRED_PARTS: dict[str, str] = RETIRED["parts"]
"""Parts of names, between underscores or capitals, that were replaced."""
RETIRED_TERMS: dict[str, str] = RETIRED["terms"]
"""Terms of prose that were replaced, with the term to use."""
KEPT_PARTS = re.compile(r"(lever|moment|re)_?arms?(_|$)|(^|_)butterfly")
"""Names in which such a part has its usual meaning."""

ANY_RETIRED_TERM = re.compile("|".join(RETIRED_TERMS), re.IGNORECASE)

EXAMPLE = re.compile(r"``[^`]*``|`[^`]*`|```.*?```", re.DOTALL)
"""Code in prose, which keeps whatever names the code has."""


PRONOUN = re.compile(r"\b(it|one|that|what|which|those)\b", re.IGNORECASE)
"""Pronouns and relatives whose share of the words of the documents has a limit."""


class Finding(NamedTuple):
    """Violation of one rule."""

    path: Path
    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.rule}: {self.text}"


def findings(files: Iterable[Path]) -> list[Finding]:
    """Return all violations in Python and Markdown files, except homonyms."""
    found = []
    for path in files:
        if path.suffix == ".md":
            found += _in_prose(path, 1, path.read_text(encoding="utf-8"), by_line=True)
        elif path.suffix == ".py":
            found += _in_code(path)
    return sorted(found)


def pronoun_share(pages: Iterable[Path]) -> float:
    """Return the share of pronouns and relatives among the words of Markdown files, code left out."""
    texts = [EXAMPLE.sub("", page.read_text(encoding="utf-8")) for page in pages]
    words = sum(len(re.findall(r"[A-Za-z']+", text)) for text in texts)
    return sum(len(PRONOUN.findall(text)) for text in texts) / words


def homonyms(files: Iterable[Path]) -> dict[str, list[Path]]:
    """Return the class names that more than one module defines, with those modules."""
    defined = defaultdict(list)
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                defined[node.name].append(path)
    return {name: paths for name, paths in sorted(defined.items()) if len(set(paths)) > 1}


def _in_code(path: Path) -> Iterator[Finding]:
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    yield from _names(path, path.stem, 1)
    attribute_docs = {id(node): node for scope in ast.walk(tree) for node in _attribute_docs(scope)}
    for node in ast.walk(tree):
        for name, line in _defined(node):
            yield from _names(path, name, line)
        if id(node) in attribute_docs:
            yield from _fragment(path, node)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield from _continued(path, node.lineno, node.value.value)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield from _in_prose(path, node.lineno, node.value)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield from _in_prose(path, token.start[0], token.string)


def _attribute_docs(scope: ast.AST) -> Iterator[ast.Expr]:
    if isinstance(scope, ast.Module | ast.ClassDef):
        for attribute, text in zip(scope.body, scope.body[1:], strict=False):
            if (
                isinstance(attribute, ast.Assign | ast.AnnAssign)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
                and isinstance(text.value.value, str)
            ):
                yield text


def _fragment(path: Path, node: ast.Expr) -> Iterator[Finding]:
    text = node.value.value.strip()  # type: ignore[attr-defined]  # _attribute_docs yields string constants only
    first = text.split(maxsplit=1)[0].strip(",.:;") if text else ""
    if PREPOSITION.fullmatch(first):
        yield Finding(path, node.lineno, "fragment", f"starts with a preposition: {_short(text)}")
    elif first[:1].isascii() and first[:1].islower() and not SYMBOL.search(first):
        yield Finding(path, node.lineno, "fragment", f"starts in lower case: {_short(text)}")


def _continued(path: Path, line: int, text: str) -> Iterator[Finding]:
    text = text.strip()
    if text.startswith(("…", "...")) or text.rstrip(".").endswith("…"):
        yield Finding(path, line, "continued", _short(text))


def _defined(node: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the names that a node defines: classes, functions, parameters, variables and attributes."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name, node.lineno
    elif isinstance(node, ast.arg):
        yield node.arg, node.lineno
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id, node.lineno
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.attr, node.lineno


def _names(path: Path, name: str, line: int) -> Iterator[Finding]:
    if name in RETIRED_NAMES:
        yield Finding(path, line, "retired", f"name {name}: use {RETIRED_NAMES[name]}")
        return
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    if KEPT_PARTS.search(spaced):
        return
    for part in spaced.split("_"):
        if part in RETIRED_PARTS:
            yield Finding(path, line, "retired", f"name {name}: use {RETIRED_PARTS[part]}")


def _in_prose(path: Path, line: int, text: str, *, by_line: bool = False) -> Iterator[Finding]:
    if not ANY_RETIRED_TERM.search(text):
        return
    without_code = EXAMPLE.sub(lambda code: "\n" * code[0].count("\n"), text)
    for term, use in RETIRED_TERMS.items():
        for match in re.finditer(term, without_code, re.IGNORECASE):
            at = line + without_code.count("\n", 0, match.start()) if by_line or "\n" in text else line
            yield Finding(path, at, "retired", f"'{match[0]}': use {use}")


def _short(text: str) -> str:
    return " ".join(text.split())[:80]


def files_of(folder: Path) -> list[Path]:
    """Return the Python and Markdown files of a folder, or the file itself."""
    if folder.is_file():
        return [folder]
    return sorted(path for path in folder.rglob("*") if path.suffix in {".py", ".md"} and "__pycache__" not in path.parts)


def main(folders: list[str]) -> int:
    """Print the violations in the given folders; class names are compared with the whole package."""
    if missing := [name for name in folders if not Path(name).exists()] or ([] if folders else ["no folder given"]):
        sys.stderr.write(f"language: not found: {', '.join(missing)}\n")
        return 2
    files = [path for folder in folders for path in files_of(Path(folder))]
    found = findings(files)
    package = Path("src/treadline")
    everywhere = {path.resolve() for path in [*package.rglob("*.py"), *files] if path.suffix == ".py"}
    here = {path.resolve() for path in files}
    for name, paths in homonyms(sorted(everywhere)).items():
        if here & set(paths):
            others = ", ".join(
                str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path) for path in paths
            )
            found.append(Finding(next(path for path in paths if path in here), 1, "homonym", f"class {name} in {others}"))
    for finding in found:
        sys.stdout.write(f"{finding}\n")
    counts = ", ".join(f"{sum(f.rule == rule for f in found)} {rule}" for rule in ("fragment", "continued", "homonym", "retired"))
    sys.stdout.write(f"{len(files)} files: {counts}\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
