"""Printed form of results: p-values, and a short table for a terminal or a notebook."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from html import escape

P_VALUE_LEAST = 1e-3
"""p-value below which only this bound is printed: the tests are asymptotic, and their far tails carry no information."""


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
        title, rows = self.printed()
        cells = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
            for name, value in rows
        )
        return f"<table><caption>{escape(title)}</caption>{cells}</table>"


def p_text(value: float | None) -> str:
    """Return a p-value as text: ``p = 0.29``, ``p < 0.001``, or a dash for None."""
    if value is None:
        return "–"
    return f"p < {P_VALUE_LEAST:g}" if value < P_VALUE_LEAST else f"p = {value:.2g}"
