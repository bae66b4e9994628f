"""Tables as plain aligned text or in Markdown, and the options of benchmarks that draw frames."""

import argparse
import secrets
from collections.abc import Iterable, Sequence

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


def markdown(columns: str, lines: Iterable[str], title: str = "") -> None:
    """Print a table in Markdown, each line as soon as it is known."""
    heading = f"\n### {title}\n" if title else ""
    print(f"{heading}\n{columns}\n|{' --- |' * (columns.count('|') - 1)}")
    for line in lines:
        print(line, flush=True)


def frame_options(description: str | None, frames: int, of_frames: str) -> argparse.ArgumentParser:
    """Return a parser with the number of frames and the first seed.

    Args:
        frames: Default number; ``of_frames`` is its help.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=frames, help=of_frames)
    parser.add_argument("--seed", type=int, default=None, help="first seed; drawn if not given")
    return parser


def seeds_of(arguments: argparse.Namespace) -> range:
    """Return the seeds of a call, new ones if none is given, and print how to repeat it."""
    first = secrets.randbelow(2**31) if arguments.seed is None else arguments.seed
    seeds = range(first, first + arguments.frames)
    print(f"seeds {seeds.start} to {seeds.stop - 1}: repeat with --seed {first} --frames {arguments.frames}")
    return seeds


def _text(value: Cell) -> str:
    if isinstance(value, float):
        return "–" if np.isnan(value) else f"{value:.3g}"
    return str(value)


def percent(value: float) -> str:
    """Return a fit, or that there is none worth a number."""
    return f"{value:.1f}" if value > -100.0 else "diverges" if value < -1e6 else "< -100"
