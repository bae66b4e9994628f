"""Draw the states of a traversal: ``python docs/tools/automaton.py docs/drawings``.

Names, behaviours, exits and time limits come from the table of ``mission.traversal``, the words from the docstrings of its
functions.
"""

import math
import re
import sys
import textwrap
from html import escape
from pathlib import Path
from typing import Any

from treadline.core.signals import Direction
from treadline.mission.traversal import State, table_of

WIDTH, BOX, LINE, GAP, LANE = 1160, 250, 17, 16, 12
LANES = 11
LEFT = 14 + LANE * LANES + 8
COLOURS = {"hold": "#b3261e", "refused": "#b3261e", "arrived": "#1b7f3b"}
"""Colours of the ends of a run; other exits are blue."""


def words(function: Any) -> str:
    """Return the first line of a function's docstring without its full stop."""
    return str(function.__doc__).splitlines()[0].rstrip(".")


def drawing(direction: Direction) -> str:
    """Return the drawing of one direction as SVG text: a box for each state, its exits next to it, an arrow to each next state."""
    table = table_of(direction)
    tops, top = {}, GAP
    for state, exits in table.items():
        tops[state.name] = top
        top += LINE * max(2, len(exits)) + GAP + 8
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {top}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{top}" fill="#ffffff"/>',
    ]
    lane = 0
    for state, exits in table.items():
        y, height = tops[state.name], LINE * max(2, len(exits)) + 8
        parts += _box(state, y, height)
        for row, end in enumerate(exits):
            line_y, colour = y + 17 + LINE * row, COLOURS.get(end.to, "#0072b2")
            parts.append(f'<text x="{LEFT + BOX + 14}" y="{line_y}" fill="#345">{escape(words(end.when))}</text>')
            parts.append(f'<text x="{WIDTH - 8}" y="{line_y}" fill="{colour}" text-anchor="end">→ {end.to}</text>')
        for to in dict.fromkeys(end.to for end in exits if end.to in tops):
            parts.append(_arrow(y + 0.5 * height, tops[to] + 12, 14 + LANE * (lane % LANES), COLOURS.get(to, "#0072b2")))
            lane += 1
    return "\n".join([*parts, "</svg>", ""])


def _box(state: State, y: float, height: float) -> list[str]:
    summary = textwrap.shorten(re.split("[,:;]", words(state.behaviour))[0], 38, placeholder=" …")
    limit = "" if math.isinf(state.limit_s) else f"≤ {state.limit_s:g} s without progress"
    return [
        f'<rect x="{LEFT}" y="{y}" width="{BOX}" height="{height}" rx="6" fill="#eaf1f8" stroke="#0072b2">'
        f"<title>{escape(words(state.behaviour))}</title></rect>",
        f'<text x="{LEFT + 10}" y="{y + 17}" font-weight="bold" font-size="14" fill="#123">{state.name}</text>',
        f'<text x="{LEFT + BOX - 8}" y="{y + 17}" fill="#667" font-size="10" text-anchor="end">{limit}</text>',
        f'<text x="{LEFT + 10}" y="{y + 34}" fill="#345" font-size="11">{escape(summary)}</text>',
    ]


def _arrow(from_y: float, to_y: float, x: float, colour: str) -> str:
    path = f"M {LEFT} {from_y:g} H {x:g} V {to_y:g} H {LEFT}"
    head = f"M {LEFT - 6} {to_y - 4:g} L {LEFT} {to_y:g} L {LEFT - 6} {to_y + 4:g}"
    return f'<path d="{path} {head}" fill="none" stroke="{colour}" stroke-opacity="0.65"/>'


def main() -> None:
    """Write both drawings."""
    folder = Path(sys.argv[1])
    directions: tuple[Direction, ...] = ("up", "down")
    for direction in directions:
        (folder / f"states-{direction}.svg").write_text(drawing(direction), encoding="utf-8")


if __name__ == "__main__":
    main()
