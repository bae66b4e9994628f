"""Common rendering of pages: the template engine, drawings inline, and numbers in base64 for scripts."""

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from treadline.core.printing import p_text, percent_text
from treadline.report.labels import run_words

TEMPLATES = Path(__file__).parent / "templates"
NOT_A_NUMBER, LARGEST = -32768, 32767
"""Codes of NaN and of the largest value in a packed array."""


def page_of(template: str, drawings: Mapping[str, Sequence[str]], **values: Any) -> str:
    """Return a page: a template with drawings (name → SVG of each panel) inline and every other value escaped."""
    engine = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    filters: dict[str, Callable[..., str]] = {
        "number": _number,
        "percent": lambda value: percent_text(value, digits=2) if value is not None else "–",
        "degrees": "{:g}°".format,
        "p_value": p_text,
        "ratio": ratio,
        "gain": _gain,
        "run_words": run_words,
    }
    engine.filters.update(filters)
    inline = {
        # The package's own drawings, in which text is paths, are the only markup that is not escaped.
        name: Markup("".join(_inlined(text, f"{name}-{k}") for k, text in enumerate(panels)))  # noqa: S704
        for name, panels in drawings.items()
    }
    return engine.get_template(template).render(svg=inline, **values)


def _inlined(svg: str, name: str) -> str:
    """Return an SVG for a page: its ids prefixed, so that drawings do not share definitions; no namespaces, HTML has them."""
    for old, new in (
        (' xmlns="http://www.w3.org/2000/svg"', ""),
        (' xmlns:xlink="http://www.w3.org/1999/xlink"', ""),
        ("xlink:href", "href"),
        (' id="', f' id="{name}-'),
        ("url(#", f"url(#{name}-"),
        ('href="#', f'href="#{name}-'),
    ):
        svg = svg.replace(old, new)
    return svg


def ratio(value: float) -> str:
    """Return a ratio of singular values; beyond 100,000 the smaller one is a rounding error of the data."""
    return "> 100000" if value > 1e5 else f"{value:.1f}"


def _number(value: float | None, digits: int = 2, unit: str = "") -> str:
    if value is None:
        return "–"
    return f"{value:.2e}" if abs(value) >= 1e5 else f"{round(value, digits) + 0.0:.{digits}f}{unit}"


def _gain(value: float) -> str:
    """Return a gain of any size in four digits; infinite through an integrator."""
    text = "∞" if math.isinf(value) else f"{abs(value):.4g}"
    return f"−{text}" if value < 0.0 else text


def json_in_page(value: Any) -> str:
    """Return JSON that cannot end the script element around it: text in a log may hold anything."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def packed(values: Float[np.ndarray, "n ..."]) -> dict[str, Any]:
    """Return an array as JSON values: each column in 65,535 equal steps between its smallest and its largest value.

    The rounding error is at most one part in 131,068 of the column's range: 0.04 mm on a stair of 5 m.
    """
    table = np.asarray(values, dtype=float).reshape(len(values), -1)
    known = np.isfinite(table)
    low = np.where(known, table, np.inf).min(axis=0, initial=np.inf)
    high = np.where(known, table, -np.inf).max(axis=0, initial=-np.inf)
    low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    step = np.where(high > low, (high - low) / (2 * LARGEST), 1.0)
    codes = np.round((np.where(known, table, low) - low) / step) - LARGEST
    codes = np.where(known, codes, NOT_A_NUMBER).astype("<i2")
    return {"data": in_base64(codes.tobytes()), "columns": table.shape[1], "low": low.tolist(), "step": step.tolist()}


def packed_indices(indices: Int[np.ndarray, "*n"]) -> str:
    """Return non-negative integers below 65,536 as base64.

    Raises:
        ValueError: If an index is larger.
    """
    if indices.size and not 0 <= int(indices.min()) <= int(indices.max()) < 1 << 16:
        raise ValueError(f"an index of {int(indices.max())} in 16 bits; split the mesh")
    return in_base64(indices.astype("<u2").tobytes())


def in_base64(data: bytes) -> str:
    """Return bytes as text."""
    return base64.b64encode(data).decode()
