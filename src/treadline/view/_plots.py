"""Plots of a run with their limits and a cursor: ``Recording, t -> arrays for the browser``."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.playback import Limits, Recording

BINS = 250
"""Bins of a plot; each shows the smallest and the largest value, so that no transient is lost."""
PLOT_PX = 72
"""Height of a plot [px]: six of them fit on a laptop's screen."""
BLUE, ORANGE, GREEN, RED, SKY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9"

Column = Float[np.ndarray, " n"]


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot."""

    quantity: str
    """Field of the recording."""
    label: str
    colour: str
    column: int | None = None
    """Column of a field with several."""
    dashed: bool = False

    def values(self, run: Recording) -> Column:
        """Return the values of a run."""
        values = getattr(run, self.quantity)
        return np.asarray(values if self.column is None else values[:, self.column])


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One plot: lines, limits and their scale."""

    title: str
    curves: tuple[Curve, ...]
    limit: str
    """Field of ``Limits`` that the plot draws."""
    limit_label: str
    """Meaning of the limits, with a place for the largest; not shown without any."""
    is_symmetric: bool = False
    """Whether the negative limit is drawn as well."""
    has_zero: bool = False
    """Whether zero is drawn as a limit."""
    is_angle: bool = False
    """Whether the plot's unit is a degree instead of the SI unit."""
    low: float = -np.inf
    """Values outside ``low`` to ``high`` are drawn at the edge."""
    high: float = np.inf
    least_span: float
    """Least height of the plot in its unit, so that noise is not magnified."""
    shows_fork: bool = True
    """Whether the first curve of the fork is drawn as well."""

    @property
    def unit(self) -> float:
        """Unit of the plot in SI units."""
        return DEG if self.is_angle else 1.0

    def limits(self, of: Limits) -> tuple[float, ...]:
        """Return the limits of a run in the plot's unit; none for an unknown limit."""
        value = getattr(of, self.limit)
        size = () if value is None else (value / self.unit,)
        mirrored = tuple(-limit for limit in size) if self.is_symmetric else ()
        return (*size, *mirrored, *((0.0,) if self.has_zero else ()))


PLOTS = (
    Plot(
        title="Heading [°]",
        curves=(Curve("heading_rad", "true", BLUE), Curve("estimate_rad", "estimate", ORANGE)),
        limit="heading_rad", is_symmetric=True, limit_label="limit {} over crest and edge", is_angle=True, least_span=2.0,
    ),
    Plot(
        title="Pitch rate [°/s]",
        curves=(Curve("pitch_rate_rad_s", "by ground truth", BLUE),),
        limit="pitch_rate_rad_s", is_symmetric=True, limit_label="guard's limit {}", is_angle=True, least_span=4.0,
    ),
    Plot(
        title="Belt speed [m/s]",
        curves=(
            Curve("belt_m_s", "left", BLUE, 0),
            Curve("belt_m_s", "right", ORANGE, 1),
            Curve("command_m_s", "left asked", BLUE, 0, dashed=True),
            Curve("command_m_s", "right asked", ORANGE, 1, dashed=True),
        ),
        limit="cruise_m_s", limit_label="cruise limit {}", least_span=0.1, shows_fork=False,
    ),
    Plot(
        title="Slip ratio",
        curves=(Curve("slip", "by ground truth", BLUE),),
        limit="slip", limit_label="guard's limit {}", least_span=0.2, low=-0.5, high=1.2,
    ),
    Plot(
        title="Seat pitch [°]",
        curves=(Curve("seat_pitch_rad", "seat", BLUE),),
        limit="seat_rad", is_symmetric=True, limit_label="guard's limit {}", is_angle=True, least_span=2.0,
    ),
    Plot(
        title="Tip-over margin [°]",
        curves=(Curve("margin_rad", "margin", GREEN),),
        limit="margin_rad", has_zero=True, limit_label="{} required, 0° tips", is_angle=True, least_span=5.0,
    ),
)  # fmt: skip
"""Plots of the page, from top to bottom."""


def add_plot(gui: Any, plot: Plot, run: Recording) -> Any:
    """Add a plot to the page."""
    from viser import uplot

    # Values under the pointer are those of the curves: see page.css.
    aid: dict[str, Any] = {"class": "treadline-aid", "points": {"show": False}}
    lines = [uplot.Series(**aid, label="fork", stroke=SKY, width=1.4, show=plot.shows_fork)]
    lines += [uplot.Series(**aid, label="limit", stroke=RED, width=1.0, dash=(6, 4)) for _ in plot.limits(run.limits)]
    for curve in plot.curves:
        dash: dict[str, Any] = {"dash": (4, 3)} if curve.dashed else {}
        lines.append(uplot.Series(label=curve.label, stroke=curve.colour, width=1.4, points={"show": False}, **dash))
    lines.append(uplot.Series(**aid, label="cursor", stroke="#444", width=1.0))
    is_last = plot is PLOTS[-1]
    return gui.add_uplot(
        data=plot_data(plot, run, 0.0),
        series=(uplot.Series(label="t [s]"), *lines),
        scales={"x": uplot.Scale(time=False)},
        axes=(uplot.Axis(size=24) if is_last else uplot.Axis(show=False), uplot.Axis(size=38)),
        legend=uplot.Legend(show=True, live=True),
        height=PLOT_PX + (20 if is_last else 0),
        padding=(4, 8, 0, 0),
    )


def legend_html(plot: Plot, run: Recording, cursor_s: float, *, forked: bool) -> str:
    """Return the title of a plot, its lines in their colours with their values at the cursor, and its limits."""
    digits, symbol = (1, "°") if plot.is_angle else (2, "")
    lines = []
    for curve in plot.curves:
        mark = f'<span style="color:{curve.colour}">{"┄" if curve.dashed else "━"}</span>'
        value = curve.values(run)[run.index_at(cursor_s)] / plot.unit if len(run.t_s) else math.nan
        text = "" if math.isnan(value) else f" <b>{round(value, digits) + 0.0:.{digits}f}</b>".replace("-", "−")
        lines.append(f"{mark} {curve.label}{text}")
    limit, limits = "", plot.limits(run.limits)
    if limits:
        label = plot.limit_label.format(f"{'±' if plot.is_symmetric else ''}{max(limits):g}{symbol}")
        low, high = view_of(plot, run)
        hidden = "" if any(low <= limit <= high for limit in limits) else " (beyond this plot)"
        limit = f'<span style="color:{RED}">┄</span> {label}{hidden}'
    fork = f' <span style="color:{SKY}">━</span> fork' if plot.shows_fork and forked else ""
    style = "font-size:11px;line-height:1.25;min-height:2.5em;margin:0 0 -6px 2px"
    return f'<div style="{style}"><b>{plot.title}</b> {" ".join(lines)}{fork} {limit}</div>'


def shown(plot: Plot, values: Column) -> Column:
    """Return values of a quantity in the plot's unit, without gaps, within the range that is drawn."""
    return np.clip(filled(values / plot.unit), plot.low, plot.high)


def view_of(plot: Plot, run: Recording) -> tuple[float, float]:
    """Return the range in which a limit is drawn: the signal's, widened by its height on both sides."""
    values = [shown(plot, curve.values(run)) for curve in plot.curves] if len(run.t_s) else []
    low = min((float(column.min()) for column in values), default=0.0)
    high = max((float(column.max()) for column in values), default=0.0)
    height = max(high - low, plot.least_span)
    return low - height, high + height


def plot_data(plot: Plot, run: Recording, cursor_s: float, fork: Recording | None = None) -> tuple[Column, ...]:
    """Return time, fork, limits, curves and cursor of a plot, of equal length.

    Three further instants at the cursor carry its line, from the lower edge up and down again; the other lines are held there. The
    curve of the fork is that of the run where there is no fork, and a limit far from the signal is drawn below the first curve: the
    plot shows the signal, and its legend names the limit.

    Args:
        fork: Run whose first curve is drawn as well.
    """
    known = plot.limits(run.limits)
    if not len(run.t_s):
        return tuple(np.zeros(2) for _ in range(len(plot.curves) + len(known) + 3))
    t_s, values = decimated(run.t_s, [curve.values(run) for curve in plot.curves])
    curves = [shown(plot, column) for column in values]
    forked = curves[0]
    if fork is not None and len(fork.t_s) and plot.shows_fork:
        there = np.interp(t_s, fork.t_s, filled(plot.curves[0].values(fork) / plot.unit))
        forked = np.where(t_s <= fork.duration_s, np.clip(there, plot.low, plot.high), curves[0])
    lowest, highest = view_of(plot, run)
    limits = [np.full(len(t_s), limit) if lowest <= limit <= highest else curves[0] for limit in known]
    lines = [forked, *limits, *curves]
    low, high = min(float(column.min()) for column in lines), max(float(column.max()) for column in lines)
    missing = max(plot.least_span - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    place = int(np.searchsorted(t_s, cursor_s, side="right"))
    there_too = [place, place, place]
    held = [np.insert(column, there_too, column[max(place - 1, 0)]) for column in lines]
    cursor = np.insert(np.full(len(t_s), low), there_too, [low, high, low])
    return (np.insert(t_s, there_too, cursor_s), *held, cursor)


def filled(column: Column) -> Column:
    """Return a column with its gaps closed by the value before, or after at the beginning; zero without any value.

    The browser's plots cannot show a gap in an array of numbers.
    """
    known = np.isfinite(column)
    if known.all():
        return column
    if not known.any():
        return np.zeros(len(column))
    last = np.maximum.accumulate(np.where(known, np.arange(len(column)), -1))
    return np.asarray(column[np.where(last < 0, int(known.argmax()), last)])


def decimated(t_s: Column, columns: list[Column]) -> tuple[Column, list[Column]]:
    """Return at most two instants per bin, with the smallest and the largest value of each column in the bin."""
    count = len(t_s)
    if count <= 2 * BINS:
        return t_s, columns
    edges = np.linspace(0, count, BINS + 1).astype(int)[:-1]
    width = count // BINS
    times = np.stack([t_s[edges], t_s[np.minimum(edges + width // 2, count - 1)]], axis=1).ravel()
    found = []
    for column in columns:
        low, high = np.fmin.reduceat(column, edges), np.fmax.reduceat(column, edges)
        rising = column[np.minimum(edges + width - 1, count - 1)] >= column[edges]
        found.append(np.stack([np.where(rising, low, high), np.where(rising, high, low)], axis=1).ravel())
    return times, found
