"""Plots of the tape with their limits and a cursor: ``Tape, t -> arrays for the browser``."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.playback import Limits
from treadline.view.tape import Tape

BINS = 250
"""Bins of a plot; each shows the smallest and the largest value, so that no transient is lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One line of a plot."""

    column: str
    label: str
    colour: str
    dashed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotSpec:
    """One plot: lines, limits and their scale."""

    title: str
    curves: tuple[Curve, ...]
    limits: tuple[float, ...]
    """Limits in the plot's unit."""
    limit_label: str
    """Meaning of the limits, with a place for the largest; not shown without any."""
    unit: float = 1.0
    """Unit in SI units: ``DEG`` for degrees."""
    low: float = -np.inf
    """Values outside ``low`` to ``high`` are drawn at the edge."""
    high: float = np.inf
    least_span: float = 0.0
    """Least height of the plot in its unit, so that noise is not magnified."""
    symbol: str = ""
    """Symbol of the unit."""
    ghost: str | None = None
    """Column of the fork that is drawn as well."""


Columns = tuple[Float[np.ndarray, " n"], ...]
"""Arrays of a plot, of equal length."""

BLUE, ORANGE, GREEN, RED, GREY, SKY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#888888", "#56b4e9"


def both(limit: float | None, unit: float = 1.0) -> tuple[float, ...]:
    """Return a limit and its negative in the plot's unit; nothing for an unknown limit."""
    return () if limit is None else (limit / unit, -limit / unit)


def one(limit: float | None, unit: float = 1.0) -> tuple[float, ...]:
    """Return a limit in the plot's unit; nothing for an unknown limit."""
    return () if limit is None else (limit / unit,)


@cache
def plot_specs(limits: Limits) -> tuple[PlotSpec, ...]:
    """Return the plots of the panel with the limits of the run."""
    return (
        PlotSpec(
            title="Heading [°]",
            least_span=2.0,
            symbol="°",
            curves=(
                Curve(column="heading_rad", label="true", colour=BLUE),
                Curve(column="estimate_rad", label="estimate", colour=ORANGE),
            ),
            limits=both(limits.heading_rad, DEG),
            limit_label="limit {} over crest and edge",
            unit=DEG,
            ghost="heading_rad",
        ),
        PlotSpec(
            title="Pitch rate [°/s]",
            least_span=4.0,
            symbol="°",
            curves=(Curve(column="pitch_rate_rad_s", label="by ground truth", colour=BLUE),),
            limits=both(limits.pitch_rate_rad_s, DEG),
            limit_label="guard's limit {}",
            unit=DEG,
            ghost="pitch_rate_rad_s",
        ),
        PlotSpec(
            title="Belt speed [m/s]",
            least_span=0.1,
            curves=(
                Curve(column="left_m_s", label="left", colour=BLUE),
                Curve(column="right_m_s", label="right", colour=ORANGE),
                Curve(column="command_left_m_s", label="left asked", colour=BLUE, dashed=True),
                Curve(column="command_right_m_s", label="right asked", colour=ORANGE, dashed=True),
            ),
            limits=one(limits.cruise_m_s),
            limit_label="cruise limit {}",
        ),
        PlotSpec(
            title="Slip ratio",
            least_span=0.2,
            curves=(Curve(column="slip", label="by ground truth", colour=BLUE),),
            limits=one(limits.slip),
            limit_label="guard's limit {}",
            low=-0.5,
            high=1.2,
            ghost="slip",
        ),
        PlotSpec(
            title="Seat pitch [°]",
            least_span=2.0,
            symbol="°",
            curves=(Curve(column="seat_pitch_rad", label="seat", colour=BLUE),),
            limits=both(limits.seat_rad, DEG),
            limit_label="guard's limit {}",
            unit=DEG,
            ghost="seat_pitch_rad",
        ),
        PlotSpec(
            title="Tip-over margin [°]",
            least_span=5.0,
            symbol="°",
            curves=(Curve(column="margin_rad", label="margin", colour=GREEN),),
            limits=(*one(limits.margin_rad, DEG), 0.0),
            limit_label="{} required, 0° tips",
            unit=DEG,
            ghost="margin_rad",
        ),
    )


def legend_html(spec: PlotSpec, tape: Tape, cursor_s: float, *, forked: bool) -> str:
    """Return the title of a plot, its lines in their colours with their values at the cursor, and its limits."""
    row = tape.at(cursor_s) if len(tape) else {}
    lines, digits = [], 1 if spec.symbol else 2
    for curve in spec.curves:
        mark = f'<span style="color:{curve.colour}">{"┄" if curve.dashed else "━"}</span>'
        value = row.get(curve.column, math.nan) / spec.unit
        text = "" if math.isnan(value) else f" <b>{round(value, digits) + 0.0:.{digits}f}</b>".replace("-", "−")
        lines.append(f"{mark} {curve.label}{text}")
    limit = ""
    if spec.limits:
        sign = "±" if -spec.limits[0] in spec.limits else ""
        label = spec.limit_label.format(f"{sign}{max(spec.limits):g}{spec.symbol}")
        low, high = view_of(spec, tape)
        hidden = "" if any(low <= limit <= high for limit in spec.limits) else " (beyond this plot)"
        limit = f'<span style="color:{RED}">┄</span> {label}{hidden}'
    fork = "" if spec.ghost is None or not forked else f' <span style="color:{SKY}">━</span> fork'
    style = "font-size:11px;line-height:1.25;min-height:2.5em;margin:0 0 -6px 2px"
    return f'<div style="{style}"><b>{spec.title}</b> {" ".join(lines)}{fork} {limit}</div>'


def view_of(spec: PlotSpec, tape: Tape) -> tuple[float, float]:
    """Return the range in which a limit is drawn: the signal's, widened by its height on both sides."""
    values = (
        [np.clip(filled(tape.column(curve.column) / spec.unit), spec.low, spec.high) for curve in spec.curves] if len(tape) else []
    )
    low = min((float(column.min()) for column in values), default=0.0)
    high = max((float(column.max()) for column in values), default=0.0)
    height = max(high - low, spec.least_span)
    return low - height, high + height


def plot_data(spec: PlotSpec, tape: Tape, cursor_s: float, ghost: Tape | None = None, bins: int = BINS) -> Columns:
    """Return time, fork, limits, curves and cursor of a plot, of equal length.

    Three further instants at the cursor carry its line, from the lower edge up and down again; the other lines are held there. The
    curve of the fork is that of the run where there is no fork, and a limit far from the signal is drawn below the first curve: the
    plot shows the signal, and its legend names the limit.

    Args:
        ghost: Run whose curve is drawn as well.
    """
    if not len(tape):
        return tuple(np.zeros(2) for _ in range(len(spec.curves) + len(spec.limits) + 3))
    chosen = [curve.column for curve in spec.curves]
    t_s, values = decimated(tape, chosen, bins)
    curves = [np.clip(filled(column / spec.unit), spec.low, spec.high) for column in values]
    if ghost is not None and len(ghost) and spec.ghost is not None:
        there = np.interp(t_s, ghost.column("t_s"), filled(ghost.column(spec.ghost) / spec.unit))
        fork = np.where(t_s <= ghost.end_s, np.clip(there, spec.low, spec.high), curves[0])
    else:
        fork = curves[0]
    lowest, highest = view_of(spec, tape)
    limits = [np.full(len(t_s), limit) if lowest <= limit <= highest else curves[0] for limit in spec.limits]
    shown = [fork, *limits, *curves]
    low, high = min(float(column.min()) for column in shown), max(float(column.max()) for column in shown)
    missing = max(spec.least_span - (high - low), 0.0)
    low, high = low - 0.5 * missing, high + 0.5 * missing
    place = int(np.searchsorted(t_s, cursor_s, side="right"))
    there_too = [place, place, place]
    held = [np.insert(column, there_too, column[max(place - 1, 0)]) for column in shown]
    line = np.insert(np.full(len(t_s), low), there_too, [low, high, low])
    return (np.insert(t_s, there_too, cursor_s), *held, line)


def filled(column: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
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


def decimated(tape: Tape, columns: list[str], bins: int) -> tuple[Float[np.ndarray, " n"], list[Float[np.ndarray, " n"]]]:
    """Return at most two instants per bin, with the smallest and the largest value of each column in the bin."""
    t_s = tape.column("t_s")
    count = len(t_s)
    if count <= 2 * bins:
        return t_s.copy(), [tape.column(name).copy() for name in columns]
    edges = np.linspace(0, count, bins + 1).astype(int)[:-1]
    width = count // bins
    times = np.stack([t_s[edges], t_s[np.minimum(edges + width // 2, count - 1)]], axis=1).ravel()
    found = []
    for name in columns:
        column = tape.column(name)
        low = np.fmin.reduceat(column, edges)
        high = np.fmax.reduceat(column, edges)
        rising = column[np.minimum(edges + width - 1, count - 1)] >= column[edges]
        found.append(np.stack([np.where(rising, low, high), np.where(rising, high, low)], axis=1).ravel())
    return times, found
