"""Text of a page for golden files: what a reader sees, line by line, and the course of each figure in per cent of its size."""

import base64
import json
import re
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from typing import Any

import numpy as np
from matplotlib.font_manager import findfont
from matplotlib.ft2font import FT2Font

VOID = frozenset({"meta", "br", "img", "link", "input"})
INLINE = frozenset({"a", "code", "strong", "em", "kbd", "span", "i", "b", "button", "td", "th", "label", "select"})
WORDED = {"td": " | ", "th": " | ", "button": " · ", "span": " "}
"""What separates elements of one line."""
CONSTANT = {"terms", "phase_terms", "colours"}
"""Data of the player that are the same for every run."""
LISTED = 7
"""Longest list of the player's data of which every item is written."""
DRAWN, PLACED = 12, 4
"""Number of curves and of placed shapes of a figure that are written."""


class PageText(HTMLParser):
    """Page as lines; fails on elements that do not close in order, and on two elements with one id."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.lines: list[str] = []
        self.tags: set[str] = set()
        self.ids: list[str] = []
        self.addresses: list[str] = []
        """Everything that the page refers to."""
        self._open: list[tuple[str, dict[str, str]]] = []
        self._line = ""
        self._figure: _Figure | None = None
        self.feed(page)
        self.close()
        assert self._open == []
        assert len(self.ids) == len(set(self.ids))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.tags.add(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.addresses += [given[name] for name in ("href", "src") if name in given]
        self.addresses += [found for value in given.values() for found in re.findall(r"url\(([^)]*)\)", value)]
        if tag == "svg":
            self._break()
            self._figure = _Figure(given)
        elif self._figure is not None:
            self._figure.add(tag, given, [other.get("id", "") for _, other in self._open])
        else:
            self._begin(tag, given)
        if tag not in VOID:
            self._open.append((tag, given))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        begun, given = self._open.pop()
        assert begun == tag
        if tag == "svg" and self._figure is not None:
            self.lines += self._figure.lines()
            self._figure = None
        elif self._figure is not None:
            self._figure.end(tag)
        elif tag == "a":
            self._line += f" <{given.get('href', '')}>"
        elif tag in WORDED:
            self._line += WORDED[tag]
        elif tag not in INLINE:
            self._break()

    def handle_data(self, data: str) -> None:
        tag, given = self._open[-1] if self._open else ("", {})
        if self._figure is not None:
            self._figure.say(tag, data)
        elif given.get("id") == "data":
            self.lines += _data_lines(json.loads(data))
        elif tag in ("script", "style"):
            self.lines.append(tag)
        elif any(name == "pre" for name, _ in self._open):
            self.lines += [f"  {rounded(line)}" for line in data.splitlines()]
        else:
            self._line += re.sub(r"\s+", " ", data)

    def _begin(self, tag: str, given: dict[str, str]) -> None:
        if tag not in INLINE:
            self._break()
        if "content" in given and "http-equiv" in given:
            self.lines.append(re.sub(r"sha256-[^']*", "sha256-…", given["content"]))
        said = " ".join(given[name] for name in ("alt", "aria-label", "title") if name in given)
        mark = f"{'#' * int(tag[1])} " if re.fullmatch(r"h[1-6]", tag) else {"tr": "| ", "li": "* "}.get(tag, "")
        known = "".join(f".{name}" for name in given.get("class", "").split() if name in ("note", "chosen", "missed", "reached"))
        self._line += mark + (f"{{#{given['id']}}} " if "id" in given else "") + (f"{{{known}}} " if known else "")
        self._line += f"[{said}] " if said else ""

    def _break(self) -> None:
        line = rounded(re.sub(r"\s+", " ", self._line)).strip(" |·")
        self.lines += [line] if line else []
        self._line = ""


class _Figure:
    """Texts, curves, markers and shapes of a drawing."""

    def __init__(self, given: dict[str, str]) -> None:
        self._name = given.get("aria-label", "")
        self._box = [float(value) for value in given.get("viewbox", "0 0 1 1").split()]
        self._texts: list[str] = [""]
        self._curves: list[str] = []
        self._markers: list[tuple[float, float]] = []
        self._placed: list[str] = []
        self._count: dict[str, int] = {}

    def add(self, tag: str, given: dict[str, str], within: list[str]) -> None:
        glyph = re.search(r"DejaVuSans-([0-9a-f]+)$", given.get("href", ""))
        if glyph:
            self._texts[-1] += _letters()[int(glyph[1], 16)]
        elif tag == "use" and "x" in given and not any("axis_" in name for name in within):
            self._markers.append((float(given["x"]), float(given["y"])))
        elif tag == "use" and "transform" in given:
            self._placed.append(f"{given['href']} {rounded(given['transform'], 2)}")
        elif tag == "path" and "clip-path" in given and not any("axis_" in name for name in within):
            self._curves.append(self._extent(_points(given.get("d", ""))))
        elif tag in ("circle", "polygon", "line", "rect", "path"):
            self._count[tag] = self._count.get(tag, 0) + 1

    def end(self, tag: str) -> None:
        if tag in ("g", "text", "title") and self._texts[-1]:
            self._texts.append("")

    def say(self, tag: str, data: str) -> None:
        if tag in ("text", "title"):
            self._texts[-1] += data

    def lines(self) -> Iterator[str]:
        yield f"  figure {self._name}: {' · '.join(filter(None, self._texts))}"
        if self._curves:
            yield f"    {len(self._curves)} curves {'; '.join(self._curves[:DRAWN])}"
        if self._markers:
            yield f"    {len(self._markers)} markers {self._extent(self._markers)}"
        if self._placed:
            yield f"    {len(self._placed)} placed {'; '.join(self._placed[:PLACED])}"
        if not self._curves and self._count:
            yield "    " + ", ".join(f"{count} × {tag}" for tag, count in self._count.items())

    def _extent(self, points: list[tuple[float, float]]) -> str:
        """Return where the points begin, end, and reach, in whole per cent of the drawing from its lower left."""
        x0, y0, width, height = self._box
        across = [round(100.0 * (x - x0) / width) for x, _ in points]
        up = [round(100.0 * (1.0 - (y - y0) / height)) for _, y in points]
        return f"{across[0]},{up[0]} → {across[-1]},{up[-1]} in {min(up)}…{max(up)}" if points else "none"


def _points(path: str) -> list[tuple[float, float]]:
    numbers = [float(value) for value in re.findall(r"-?\d+(?:\.\d+)?", path)]
    return list(zip(numbers[::2], numbers[1::2], strict=False))


@cache
def _letters() -> dict[int, str]:
    """Return the letter of each glyph of the font in which figures are written."""
    return {glyph: chr(code) for code, glyph in reversed(FT2Font(findfont("DejaVu Sans")).get_charmap().items())}


def rounded(text: str, digits: int = 4) -> str:
    """Return a text with at most so many decimals in its numbers."""
    return re.sub(rf"-?\d+\.\d{{{digits + 1},}}(?:e-?\d+)?", lambda found: f"{float(found[0]):.{digits}g}", text)


def _data_lines(value: Any, name: str = "data") -> Iterator[str]:
    """Yield the player's data: texts and numbers, and the course of each packed array."""
    if isinstance(value, dict) and "columns" in value:
        yield f"  {name}: {'; '.join(_course(column) for column in unpacked(value).T)}"
    elif isinstance(value, dict):
        flat = {key: inner for key, inner in value.items() if key not in CONSTANT and not _is_deep(inner)}
        yield from [f"  {name}: {_short(flat)}"] if flat else []
        for key in [key for key in value if key not in CONSTANT and key not in flat]:
            yield from _data_lines(value[key], f"{name}.{key}")
    elif isinstance(value, list) and _is_deep(value):
        for k in range(len(value)) if len(value) <= LISTED else (0, 1, len(value) - 1):
            yield from _data_lines(value[k], f"{name}[{k}]")
    else:
        yield f"  {name}: {_short(value)}"


def _is_deep(value: Any) -> bool:
    """Return whether something is a table of its own, or a list of such."""
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(inner, dict) for inner in value))


def _short(value: Any) -> str:
    return rounded(re.sub(r'"[A-Za-z0-9+/=]{40,}"', "…", json.dumps(value, ensure_ascii=False)), 3)


def _course(column: Any) -> str:
    known = column[np.isfinite(column)]
    if not len(known):
        return f"{len(column)} unknown"
    first, last, low, high = (f"{value + 0.0:.3g}" for value in np.round([known[0], known[-1], known.min(), known.max()], 6))
    gaps = f", {len(column) - len(known)} unknown" if len(known) < len(column) else ""
    return f"{first} → {last} in {low}…{high}{gaps}" if low != high else f"{low}{gaps}"


def unpacked(value: dict[str, Any]) -> Any:
    """Return the array of ``packed``, as the script of the page reads it."""
    codes = np.frombuffer(base64.b64decode(value["data"]), "<i2").reshape(-1, value["columns"]).astype(float)
    table = np.array(value["low"]) + np.array(value["step"]) * (codes + 32767)
    return np.where(codes == -32768, np.nan, table)
