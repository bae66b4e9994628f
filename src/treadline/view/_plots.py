"""Plots of a run with their limits and a cursor: ``Recording, t -> arrays for the browser``."""

from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.arrays import decimated
from treadline.playback import Recording
from treadline.report.plot_table import PLOTS, SIGNS, Column, Plot
from treadline.view._messages import Way

Line = Float[np.ndarray, "n 2"]

BINS = 250
"""Bins of a plot; each shows the smallest and the largest value, so that no transient is lost."""
PLOT_PX = 72
"""Height of a plot [px]: six of them fit on a laptop's screen."""
LIVE_PLOTS = tuple(plot for plot in PLOTS if not plot.page_only)
"""Plots of the live view, from top to bottom."""
ALONG = {
    "z_m": "height [m]",
    "pitch_deg": "chassis pitch [°]",
    "flipper_deg": "flipper [°]",
    "torque_n_m": "load at the flipper [N m]",
}
"""Columns of a walk that are drawn along the place, with their headings."""
LOADING = '<div style="font-size:12px;margin:8px">The plots load after the first picture …</div>'
"""Text in place of the plots before they are made."""


def shown_plots(run: Recording) -> tuple[Plot, ...]:
    """Return the plots of a run; what a log without ground truth does not know is absent."""
    return tuple(known for plot in LIVE_PLOTS if (known := plot.known(run)).curves) if run.is_reckoned else LIVE_PLOTS


def add_plot(gui: Any, plot: Plot, run: Recording, *, is_last: bool) -> Any:
    """Add a plot to the page; the last one has the time axis."""
    from viser import uplot

    # Values under the pointer are those of the curves: see page.css.
    aid: dict[str, Any] = {"class": "treadline-aid", "points": {"show": False}}
    lines = [uplot.Series(**aid, label="fork", stroke=SIGNS["fork"]["colour"], width=1.4, show=not plot.no_fork)]
    limit = SIGNS["limit"]["colour"]
    lines += [uplot.Series(**aid, label="limit", stroke=limit, width=1.0, dash=(6, 4)) for _ in plot.limits(run.limits)]
    for curve in plot.curves:
        dash: dict[str, Any] = {"dash": curve.dash} if curve.dash else {}
        stroke = SIGNS[curve.colour]["colour"]
        lines.append(uplot.Series(label=curve.label, stroke=stroke, width=1.4, points={"show": False}, **dash))
    lines.append(uplot.Series(**aid, label="cursor", stroke="#444", width=1.0))
    return gui.add_uplot(
        data=plot_data(plot, run, 0.0),
        series=(uplot.Series(label="t [s]"), *lines),
        scales={"x": uplot.Scale(time=False)},
        axes=(uplot.Axis(size=24) if is_last else uplot.Axis(show=False), uplot.Axis(size=38)),
        legend=uplot.Legend(show=True, live=True),
        height=PLOT_PX + (20 if is_last else 0),
        padding=(4, 8, 0, 0),
    )


def shown(plot: Plot, values: Column) -> Column:
    """Return values without gaps, within the range that is drawn."""
    return np.clip(filled(values), plot.low, plot.high)


def view_of(plot: Plot, run: Recording) -> tuple[float, float]:
    """Return the range in which a limit is drawn: the signal's, widened by its height on both sides."""
    values = [shown(plot, curve.values(run)) for curve in plot.curves]
    low, high = min(float(column.min()) for column in values), max(float(column.max()) for column in values)
    height = max(high - low, plot.least_span)
    return low - height, high + height


def plot_data(plot: Plot, run: Recording, cursor_s: float, fork: Recording | None = None) -> tuple[Column, ...]:
    """Return time, fork, limits, curves and cursor of a plot, of equal length.

    Three further instants at the cursor carry its line, from the lower edge up and down again; the other lines are held there. The
    curve of the fork is that of the run where there is no fork. A limit is drawn below the first curve outside the phases in which
    it applies, and if it is far from the signal: the plot shows the signal, and its legend names the limit.

    Args:
        fork: Run whose first curve is drawn as well.
    """
    known = plot.limits(run.limits)
    thinned = [decimated(run.t_s, curve.values(run), BINS) for curve in plot.curves]
    known_values = next((values for _, values in thinned if np.isfinite(values).any()), thinned[0][1])
    # A curve without any value lies on one that has some.
    t_s, curves = thinned[0][0], [shown(plot, values if np.isfinite(values).any() else known_values) for _, values in thinned]
    forked = curves[0]
    if fork is not None and len(fork.t_s) and not plot.no_fork:
        there = np.interp(t_s, fork.t_s, shown(plot, plot.curves[0].values(fork)))
        forked = np.where(t_s <= fork.duration_s, there, curves[0])
    lowest, highest = view_of(plot, run)
    applies = np.zeros(len(t_s), dtype=bool)
    for start_s, end_s in plot.limit.spans(run) if plot.limit is not None else ():
        applies |= (start_s <= t_s) & (t_s <= end_s)
    limits = [np.where(applies & (lowest <= limit <= highest), limit, curves[0]) for limit in known]
    lines = [forked, *limits, *curves]
    low, high = min(float(column.min()) for column in lines), max(float(column.max()) for column in lines)
    missing = max(plot.least_span - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    place = int(np.searchsorted(t_s, cursor_s, side="right"))
    there_too = [place, place, place]
    held = [np.insert(column, there_too, column[max(place - 1, 0)]) for column in lines]
    cursor = np.insert(np.full(len(t_s), low), there_too, [low, high, low])
    return (np.insert(t_s, there_too, cursor_s), *held, cursor)


def way_lines(way: Way, run: Recording, cursor_s: float) -> dict[str, list[Line]]:
    """Return what was planned, and what was driven up to the cursor, over the place by column; of the height, the ground.

    The last point driven is the chair's at the cursor.
    """
    (ground, planned), driven, last = way, run.columns, run.index_at(cursor_s)
    index = np.unique(np.linspace(0, last, 2 * BINS).astype(int))
    both = planned, {name: values[index] for name, values in driven.items()}
    lines = {name: [np.column_stack([columns["x_m"], columns[name]]) for columns in both] for name in ALONG}
    lines["z_m"][0] = ground[:, :2]
    return {name: [line[np.isfinite(line).all(axis=1)] for line in pair] for name, pair in lines.items()}


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
