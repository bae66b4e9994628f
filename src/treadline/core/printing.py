"""Printed and drawn form of results: units, p-values, JSON values, a short table for a terminal or a notebook, a figure."""

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, TextIO

from treadline.core.errors import TreadlineError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = {
    "m_s2": "m/s²",
    "rad_s2": "rad/s²",
    "deg_s2": "°/s²",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "deg_s": "°/s",
    "rad": "rad",
    "deg": "°",
    "mm": "mm",
    "cm": "cm",
    "n_m": "N m",
    "m": "m",
    "s": "s",
    "hz": "Hz",
    "kg": "kg",
    "px": "px",
    "percent": "%",
}
"""Unit by name suffix, longer suffixes first. Single letters other than m and s are excluded: many ordinary words end in them."""
P_VALUE_LEAST = 1e-3
"""p-value below which only this bound is printed: the tests are asymptotic, and their far tails carry no information."""

SHOWN_ITEMS = 9
"""Largest array that is printed in full within a line: a rotation matrix."""


class Printable(ABC):
    """Base of results that print as a title and a table of names and values."""

    __slots__ = ()

    @abstractmethod
    def printed(self) -> tuple[str, Iterable[tuple[str, str]]]:
        """Return the title and the rows (name, value)."""

    def __repr__(self) -> str:
        title, rows = self.printed()
        table = list(rows)
        width = max((len(name) for name, _ in table), default=0)
        return "\n".join([title, *(f"  {name:{width}}  {value}" for name, value in table)])

    def _repr_html_(self) -> str:
        """Return the table for a notebook (IPython's display protocol)."""
        from html import escape

        title, rows = self.printed()
        cells = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
            for name, value in rows
        )
        return f"<table><caption>{escape(title)}</caption>{cells}</table>"


class PrintedDict(Printable, dict[str, Any]):
    """Text or arrays by name, printed as a table: of an array, its length and range."""

    __slots__ = ("title",)

    def __init__(self, title: str, entries: Mapping[str, Any]) -> None:
        super().__init__(entries)
        self.title = title

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the title and each entry."""
        return self.title, [(name, item if isinstance(item, str) else _range(item)) for name, item in self.items()]


class Brief:
    """Base of dataclasses with arrays: printed on one line, arrays by type and shape, results and tables by their kind."""

    __slots__ = ()

    def __repr__(self) -> str:
        from dataclasses import fields  # heavy: it loads inspect

        shown = (f"{item.name}={_brief(getattr(self, item.name))}" for item in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(shown)})"


class Plottable:
    """Base of results that draw themselves.

    The package ``treadline`` sets ``drawer``: what draws, ``treadline.report``, stands above the results and is loaded at the first
    figure.
    """

    __slots__ = ()
    drawer: ClassVar[Callable[[Any], "Figure"]]

    def plot(self) -> "Figure":
        """Return the matplotlib figure.

        A model: step response, magnitude and phase; a response: one panel per pair of input and output; a comparison: measured
        and modelled outputs over time, with the errors below.
        """
        return Plottable.drawer(self)


def _brief(value: Any) -> str:
    if isinstance(value, Printable | Mapping):
        return f"<{type(value).__name__}>"
    return f"<{'×'.join(map(str, value.shape))} {value.dtype}>" if getattr(value, "size", 0) > SHOWN_ITEMS else repr(value)


def _range(samples: Any) -> str:
    known = samples[samples == samples]  # noqa: PLR0124 - NaN differs from itself
    return f"{len(samples)} samples" + (f" from {known.min():.4g} to {known.max():.4g}" if len(known) else "")


def say(line: str, stream: TextIO | None = None) -> None:
    """Write a line to stderr, or to another stream, at once, if there is one."""
    stream = stream or sys.stderr
    if stream is not None:
        stream.write(f"{line}\n")
        stream.flush()


def pandas_for(asks: str) -> Any:
    """Return pandas.

    Raises:
        TreadlineError: If it is not installed.
    """
    try:
        return import_module("pandas")
    except ImportError:
        raise TreadlineError(f"{asks} needs pandas: pip install pandas") from None


def p_text(value: float | None) -> str:
    """Return a p-value as text: ``p = 0.29``, ``p < 0.001``, or a dash for None."""
    if value is None:
        return "–"
    return f"p < {P_VALUE_LEAST:g}" if value < P_VALUE_LEAST else f"p = {value:.2g}"


def percent_text(value: float, digits: int = 1) -> str:
    """Return a fit or a share of the variance as text; the size of an error above twice the signal means nothing."""
    return f"{value:.{digits}f} %" if value >= -100.0 else "below -100 %"


def unit_ending(name: str) -> str | None:
    """Return the unit suffix of a name, or None."""
    return next((end for end in UNITS if name.lower().endswith("_" + end) and len(name) > len(end) + 1), None)


def plain(value: Any) -> Any:
    """Return a value as JSON types: arrays as lists, non-finite numbers as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
