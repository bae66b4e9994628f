"""A figure as SVG for a page that holds many: without comments, indentation and digits that no screen shows."""

import re
import warnings

from matplotlib.figure import Figure

from treadline.report.svg_figures import svg_of

COORDINATE = re.compile(r"(-?\d+\.\d\d)\d+")
"""A number and the decimals that are cut off: a hundredth of a point is finer than any screen."""
MARKERS = re.compile(r'<g((?: clip-path="[^"]*")?)>\n((?:<use [^>]*style="[^"]*"/>\n)+)</g>')
"""Markers of one series, each with the style of all."""


def inline_svg(figure: Figure) -> str:
    """Return a figure as an SVG element, half as long as matplotlib writes it."""
    with warnings.catch_warnings():
        # A channel may be named in a script that the font lacks: it is drawn as boxes, and written out in the tables.
        warnings.filterwarnings("ignore", message="Glyph")
        text = svg_of(figure)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r' (?:d|x|y)="[^"]*"', lambda found: COORDINATE.sub(r"\1", found[0].replace("\n", "")), text)
    return MARKERS.sub(_styled_once, re.sub(r"\n\s*", "\n", text))


def _styled_once(found: re.Match[str]) -> str:
    styles = set(re.findall(r' style="[^"]*"', found[2]))
    if len(styles) != 1:
        return found[0]
    (style,) = styles
    return f"<g{found[1]}{style}>\n{found[2].replace(style, '')}</g>"
