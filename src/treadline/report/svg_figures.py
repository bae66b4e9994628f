"""matplotlib figures as SVG: the same bytes for the same numbers, one style, colours for colour-blind readers (Okabe and Ito).

Tick labels of logarithmic axes are plain text (``10⁻³``). matplotlib writes them as formulas by default; the formula layout loads
some twenty mathematical fonts and warns about each that the font list of the machine does not have.
"""

import io
import re
import warnings

import matplotlib as mpl
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, NullFormatter
from matplotlib.transforms import BboxBase

from treadline.report.html_pages import TEMPLATES

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
WIDTH_IN = 8.0
"""Usual width of a figure [in]."""
PAD_PX = 4.0
"""Margin around a panel that is drawn alone."""
STYLE = mpl.rc_params_from_file(TEMPLATES / "figures.mplstyle", use_default_template=False)
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
COORDINATE = re.compile(r"(-?\d+\.\d\d)\d+")
"""A number and the decimals that are cut off: a hundredth of a point is finer than any screen."""
MARKERS = re.compile(r'<g((?: clip-path="[^"]*")?)>\n((?:<use [^>]*style="[^"]*"/>\n)+)</g>')
"""Markers of one series, each with the style of all."""


def svg_of(figure: Figure, box_in: BboxBase | None = None) -> str:
    """Return a figure as an SVG element, without dates and without metadata, which names web addresses.

    Args:
        box_in: Part of the figure [in]; None for the whole.
    """
    with mpl.rc_context(STYLE):
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, bbox_inches=box_in)
    text = buffer.getvalue()
    return re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)


def panels_of(figure: Figure) -> list[str]:
    """Return each panel of a figure as an SVG element of its own: a narrow page stacks them, a wide one has them side by side."""
    with mpl.rc_context(STYLE):
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        axes = [ax for ax in figure.axes if ax.get_visible()]
        panels = []
        for ax in axes:
            for other in axes:
                other.set_visible(other is ax)
            box_px = ax.get_tightbbox()
            to_inches = figure.dpi_scale_trans.inverted()
            panels.append(svg_of(figure, None if box_px is None else box_px.padded(PAD_PX).transformed(to_inches)))
        for ax in axes:
            ax.set_visible(True)
    return panels


def short_svg(figure: Figure) -> str:
    """Return a figure as an SVG element half as long: without comments, indentation and digits that no screen shows."""
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


class _PlainLogFormatter(LogFormatterSciNotation):
    """Formatter of powers of ten and their multiples, without formula markup."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the label of a tick."""
        text = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
        text = re.sub(r"\^\{(-?\d+)\}", lambda exponent: exponent[1].translate(SUPERSCRIPTS), text)
        return text.replace(r"\times", "×").replace("-", "−")


def plain_log_labels(axis: Axis) -> None:
    """Replace the formatters of a logarithmic axis."""
    axis.set_major_formatter(_PlainLogFormatter())
    if not isinstance(axis.get_minor_formatter(), NullFormatter):
        axis.set_minor_formatter(_PlainLogFormatter(labelOnlyBase=False))
