"""Plain aligned text."""

from collections.abc import Sequence

import numpy as np

Cell = str | float | int
Row = Sequence[Cell]


def table(title: str, header: Sequence[str], rows: Sequence[Row]) -> None:
    """Print a title and a table below it, first column to the left, the others to the right."""
    cells = [list(header), *([_text(value) for value in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    print(f"\n{title}")
    for cell in cells:
        first, *others = (
            text.ljust(width) if k == 0 else text.rjust(width) for k, (text, width) in enumerate(zip(cell, widths, strict=True))
        )
        print("  " + "  ".join([first, *others]).rstrip(), flush=True)


def _text(value: Cell) -> str:
    if isinstance(value, float):
        return "–" if np.isnan(value) else f"{value:.3g}"
    return str(value)


def percent(value: float) -> str:
    """Return a fit, or that there is none worth a number."""
    return f"{value:.1f}" if value > -100.0 else "diverges" if value < -1e6 else "< -100"
