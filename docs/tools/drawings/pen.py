"""A pen for drawings: lines, boxes, arrows, dimensions and angles on a blank sheet, in the units of what is drawn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, PathPatch, Polygon
from matplotlib.path import Path

from treadline.core.angles import DEG
from treadline.report.svg_figures import BLUE, GREY, STYLE

INK, WHITE, STONE, STEEL = "#1b1b1b", "#ffffff", "#ded9d0", "#c9d3dc"
AMBER = "#a35f00"
"""Orange that can be read as text."""
Point = tuple[float, float]
Points = Sequence[Point] | Float[np.ndarray, "n 2"]


def sheet(width_in: float, height_in: float, panels: int = 1) -> tuple[Figure, list["Pen"]]:
    """Return a blank figure and one pen per panel, side by side."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in))
        axes = figure.subplots(1, panels, squeeze=False)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.99, wspace=0.02)
    return figure, [Pen(ax) for ax in axes.ravel()]


@dataclass(frozen=True, slots=True)
class Pen:
    """Draws on one panel."""

    ax: Axes
    origin: Point = (0.0, 0.0)
    """Offset of lines, areas and discs on the panel."""

    def frame(self, x: Point, y: Point) -> None:
        """Show the span from ``x[0]`` to ``x[1]`` and ``y[0]`` to ``y[1]``, both axes to one scale, without axes."""
        self.ax.set_xlim(*x)
        self.ax.set_ylim(*y)
        self.ax.set_aspect("equal")
        self.ax.set_axis_off()

    def line(self, points: Points, colour: str = INK, width: float = 1.2, style: str = "-") -> None:
        """Draw an open line."""
        xy = np.asarray(points, dtype=float) + self.origin
        self.ax.plot(xy[:, 0], xy[:, 1], style, color=colour, linewidth=width, solid_capstyle="round")

    def area(self, points: Points, fill: str, colour: str = INK, width: float = 1.2) -> None:
        """Draw a closed outline, filled."""
        xy = np.asarray(points, dtype=float) + self.origin
        self.ax.add_patch(Polygon(xy, closed=True, facecolor=fill, edgecolor=colour, linewidth=width, joinstyle="round"))

    def shape(
        self, loops: Sequence[Float[np.ndarray, "_ 2"]], fill: str | tuple[float, ...], colour: str = INK, width: float = 1.2
    ) -> None:
        """Draw closed lines as one filled shape; a line that runs the other way within another cuts a hole."""
        lines = [loop + self.origin for loop in loops]
        path = Path.make_compound_path(*[Path(np.vstack([xy, xy[:1]]), closed=True) for xy in lines])
        self.ax.add_patch(PathPatch(path, facecolor=fill, edgecolor=colour, linewidth=width, joinstyle="round"))

    def disc(self, at: Point, radius: float, fill: str = WHITE, colour: str = INK) -> None:
        """Draw a circle, filled."""
        place = at[0] + self.origin[0], at[1] + self.origin[1]
        self.ax.add_patch(Circle(place, radius, facecolor=fill, edgecolor=colour, linewidth=1.2, zorder=3))

    def text(self, at: Point, words: str, *, size: float = 10.0, colour: str = INK, align: str = "center") -> None:
        """Write words centred on a point, or left or right of it."""
        halo = {"facecolor": WHITE, "edgecolor": "none", "pad": 1.2}
        self.ax.text(*at, words, fontsize=size, color=colour, ha=align, va="center", bbox=halo, zorder=6, linespacing=1.35)

    def arrow(self, start: Point, end: Point, colour: str = INK, head: str = "-|>", bend: float = 0.0) -> None:
        """Draw an arrow."""
        self.ax.add_patch(
            FancyArrowPatch(
                start,
                end,
                arrowstyle=head,
                mutation_scale=11,
                color=colour,
                linewidth=1.2,
                shrinkA=0,
                shrinkB=0,
                connectionstyle=f"arc3,rad={bend}",
                zorder=4,
            )
        )

    def pointer(self, at: Point, to: Point, words: str, align: str = "left") -> None:
        """Write words and draw a thin line from them to what they name."""
        self.line([at, to], GREY, 0.8)
        self.disc(to, 0.002 * (self.ax.get_xlim()[1] - self.ax.get_xlim()[0]), GREY, GREY)
        self.text(at, words, size=9.0, align=align)

    def dimension(self, start: Point, end: Point, words: str, away: float = 0.0, colour: str = BLUE) -> None:
        """Draw a measure from start to end, moved ``away`` to the left of its direction, with a label."""
        (x0, y0), (x1, y1) = start, end
        length = math.hypot(x1 - x0, y1 - y0)
        side = (-(y1 - y0) / length * away, (x1 - x0) / length * away)
        a, b = (x0 + side[0], y0 + side[1]), (x1 + side[0], y1 + side[1])
        if away:
            self.line([start, a], colour, 0.6)
            self.line([end, b], colour, 0.6)
        self.arrow(a, b, colour, "<|-|>")
        self.text(((a[0] + b[0]) / 2, (a[1] + b[1]) / 2), words, size=9.5, colour=colour)

    def angle(self, at: Point, radius: float, from_deg: float, to_deg: float, words: str, colour: str = BLUE) -> None:
        """Draw an arc between two directions, with its words beyond its middle."""
        self.ax.add_patch(
            Arc(at, 2 * radius, 2 * radius, theta1=min(from_deg, to_deg), theta2=max(from_deg, to_deg), color=colour, linewidth=1.2)
        )
        middle = 0.5 * (from_deg + to_deg) * DEG
        self.text(
            (at[0] + 1.3 * radius * math.cos(middle), at[1] + 1.3 * radius * math.sin(middle)), words, size=9.5, colour=colour
        )

    def box(self, centre: Point, size: Point, words: str, below: str = "", fill: str = WHITE) -> None:
        """Draw a rounded box with words, and the name of its module under them."""
        corner = (centre[0] - size[0] / 2, centre[1] - size[1] / 2)
        shape = FancyBboxPatch(
            corner, *size, boxstyle="round,pad=0,rounding_size=0.12", facecolor=fill, edgecolor=INK, linewidth=1.2
        )
        self.ax.add_patch(shape)
        self._labelled(centre, words, below)

    def oval(self, centre: Point, size: Point, words: str, below: str = "", fill: str = WHITE) -> None:
        """Draw an oval with words, and the name of its module under them."""
        self.ax.add_patch(Ellipse(centre, *size, facecolor=fill, edgecolor=INK, linewidth=1.2, zorder=3))
        self._labelled(centre, words, below)

    def _labelled(self, centre: Point, words: str, below: str) -> None:
        x, y = centre
        lift = 0.17 if below else 0.0
        self.ax.text(x, y + lift, words, fontsize=10.0, color=INK, ha="center", va="center", zorder=5)
        if below:
            self.ax.text(x, y - 0.24, below, fontsize=8, color="#555555", ha="center", va="center", zorder=5)


def turned(points: Points, angle_rad: float, about: Point = (0.0, 0.0)) -> Float[np.ndarray, "n 2"]:
    """Return points turned anticlockwise about a point."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    xy = np.asarray(points, dtype=float) - about
    return xy @ np.array([[c, s], [-s, c]]) + about


def pair(point: Float[np.ndarray, " 2"]) -> Point:
    """Return a point as two numbers."""
    return float(point[0]), float(point[1])
