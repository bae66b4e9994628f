"""Draw the packages of the source tree by floor: ``python docs/tools/tree.py docs/drawings/tree.svg``.

Floors and packages come from the import contract "Arrows point down" in ``pyproject.toml``, the words from docstrings.
"""

import ast
import sys
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[2]
WIDTH, ROW, GAP, LEFT = 1160, 78, 12, 30
COLUMNS = 46
"""Characters in a row of text across the whole drawing, per 320 px."""


def floors() -> list[list[str]]:
    """Return the packages of each floor, from the top down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = next(c for c in settings["tool"]["importlinter"]["contracts"] if c["name"] == "Arrows point down")["layers"]
    return [[name.strip() for name in layer.split("|")] for layer in layers if layer != "__main__"]


def purpose(package: str) -> str:
    """Return the first sentence of a package's docstring, up to a colon."""
    path = ROOT / "src" / "treadline" / package
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
    title = (ast.get_docstring(ast.parse(text)) or "").splitlines()[0]
    return title.replace("``", "").rstrip(".")


def wrapped(text: str, columns: int, most: int) -> list[str]:
    """Return a text in lines of at most ``columns`` characters; ``most`` lines, the last one cut with an ellipsis."""
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) >= columns:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines if len(lines) <= most else [*lines[: most - 1], f"{lines[most - 1].rstrip(',;:')} …"]


def drawing() -> str:
    """Return the drawing as SVG text."""
    rows = floors()
    height = len(rows) * (ROW + GAP) + GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
    ]
    for number, row in enumerate(rows):
        top = GAP + number * (ROW + GAP)
        width = (WIDTH - LEFT - GAP * len(row)) / len(row)
        parts.append(f'<text x="8" y="{top + ROW / 2 + 4:g}" fill="#667">{len(rows) - number}</text>')
        for column, package in enumerate(row):
            left = LEFT + column * (width + GAP)
            parts.append(f'<rect x="{left:g}" y="{top}" width="{width:g}" height="{ROW}" rx="6" fill="#eaf1f8" stroke="#0072b2"/>')
            parts.append(f'<text x="{left + 10:g}" y="{top + 19}" font-weight="bold" font-size="14" fill="#123">{package}</text>')
            for line, text in enumerate(wrapped(purpose(package), int(width * COLUMNS / 320), 3)):
                parts.append(f'<text x="{left + 10:g}" y="{top + 37 + 15 * line}" fill="#345">{escape(text)}</text>')
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(drawing(), encoding="utf-8")
