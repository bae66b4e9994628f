"""Figures of the reproduction: matplotlib to inline SVG, the same bytes for the same numbers.

Angles are in degrees; the colours are distinct for colour-blind readers (Okabe and Ito).
"""

import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import BboxBase

from treadline.core import paper
from treadline.report.results import PAPER_FRICTION, Cell, Impulse, ModelFigures, Steered, Straight, Turn
from treadline.report.ticks import plain_log_labels

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
BY_SLOPE = {20: ORANGE, 25: BLUE, 28: GREEN, 30: RED}
BY_HEADING = ("#000000", GREY, BLUE, GREEN, RED)
Series = Mapping[str, Float[np.ndarray, " T"]]
IMPULSE_SHOWN_S = 20.0
"""Span of Fig. 8 that is drawn, of 60 s: both responses have ended by then."""
TURN_SHOWN_S = 12.0
"""Span of a turn from ±30° in which belts, place and margins change."""

PAD_PX = 4.0
"""Margin around a panel that is drawn alone."""

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "treadline",
    "svg.fonttype": "path",
    "text.parse_math": False,
    "path.simplify": True,
}


def svg_of(figure: Figure) -> str:
    """Return a figure as an SVG element, without dates and without metadata, which names web addresses."""
    return _saved(figure, None)


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
            panels.append(_saved(figure, None if box_px is None else box_px.padded(PAD_PX).transformed(to_inches)))
        for ax in axes:
            ax.set_visible(True)
    return panels


def _saved(figure: Figure, box_in: BboxBase | None) -> str:
    with mpl.rc_context(STYLE):
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, bbox_inches=box_in)
    text = buffer.getvalue()
    return re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)


def _figure(width_in: float, height_in: float, rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


@mpl.rc_context(STYLE)
def impulse(ours: Impulse) -> Figure:
    """Return Fig. 8: impulse responses of our model over those of Eq. (12)."""
    figure, axes = _figure(8.0, 4.6, 2, 2)
    steps = round(IMPULSE_SHOWN_S / paper.SAMPLING_TIME_S) + 1
    printed, t_printed = _printed_impulse(steps), np.arange(steps) * paper.SAMPLING_TIME_S
    t = np.asarray(ours.t_s)
    rows = ((ours.heading_rad, "heading θ [rad]"), (ours.yaw_rate_rad_s, "angular velocity ω [rad/s]"))
    for row, (response, label) in enumerate(rows):
        for column, (values, belt) in enumerate(((response.left_m_s, "left"), (response.right_m_s, "right"))):
            ax = axes[2 * row + column]
            ax.step(t, values, where="post", color=BLUE, label="ours")
            ax.step(t_printed, printed[:, row, column], where="post", color=ORANGE, label="Eq. (12)")
            ax.set_xlim(0.0, IMPULSE_SHOWN_S)
            ax.set_xlabel("time after the impulse [s]")
            ax.set_ylabel(label)
            ax.set_title(f"impulse on u{column + 1} ({belt} track, 1 m/s)")
    axes[0].legend()
    return figure


def _printed_impulse(steps: int) -> Float[np.ndarray, "steps p m"]:
    response = np.empty((steps, 2, 2))
    response[0] = paper.D
    reach = paper.B
    for k in range(1, steps):
        response[k] = paper.C @ reach
        reach = paper.A @ reach
    return response


@mpl.rc_context(STYLE)
def singular_values(slopes: Sequence[ModelFigures]) -> Figure:
    """Return the singular values of the Hankel matrix, one line per slope."""
    figure, (ax,) = _figure(5.2, 2.8, 1, 1)
    for item in slopes:
        values = np.asarray(item.singular_values)
        values = values[values > 1e-6 * values[0]]
        style = "o-" if item.friction == PAPER_FRICTION else "s--"
        label = f"{item.slope_deg:g}°, {item.friction[0]:g}/{item.friction[1]:g}"
        ax.semilogy(np.arange(1, len(values) + 1), values / values[0], style, color=_colour(item.slope_deg), label=label)
    plain_log_labels(ax.yaxis)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.axvline(2.5, color=GREY, linestyle=":")
    ax.text(2.55, 0.5, "rank 2", color=GREY)
    ax.set_xlabel("index")
    ax.set_ylabel("σ / σ₁")
    ax.legend(title="slope, friction", fontsize=7)
    return figure


@mpl.rc_context(STYLE)
def dead_zone(rows: Sequence[Steered]) -> Figure:
    """Return yaw rate over belt difference, one colour per heading: simulated (marks) and quasi-static Coulomb friction (lines)."""
    figure, (ax,) = _figure(5.6, 3.2, 1, 1)
    headings = sorted({row.heading_deg for row in rows})
    for heading, colour in zip(headings, BY_HEADING, strict=False):
        line = [row for row in rows if row.heading_deg == heading]
        apart = [row.difference_m_s for row in line]
        ax.plot(apart, [abs(row.theory_deg_s) for row in line], color=colour, linewidth=1.2)
        ax.plot(apart, [abs(row.yaw_rate_deg_s) for row in line], "o", color=colour, label=f"{heading:g}°")
    ax.set_yscale("symlog", linthresh=0.1)
    plain_log_labels(ax.yaxis)
    ax.set_xlabel("belt difference [m/s]")
    ax.set_ylabel("yaw rate towards straight [°/s]")
    ax.legend(title="heading", fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _colour(slope_deg: float) -> str:
    return BY_SLOPE.get(int(slope_deg), GREY) if slope_deg.is_integer() else GREY


@mpl.rc_context(STYLE)
def straight(runs: Sequence[tuple[Straight, Series]]) -> Figure:
    """Return Fig. 9: heading and lateral place over time, open against closed loop."""
    figure, axes = _figure(8.0, 3.2, 1, 2)
    for row, series in runs:
        colour = _colour(row.slope_deg)
        style, label = ("-" if row.loop == "closed" else "--"), f"{row.slope_deg:g}° {row.loop}"
        axes[0].plot(series["t_s"], series["heading_deg"], style, color=colour, label=label, linewidth=1.2)
        axes[1].plot(series["t_s"], series["y_m"] - series["y_m"][0], style, color=colour, linewidth=1.2)
    axes[0].set_ylabel("heading [°]")
    axes[1].set_ylabel("lateral drift [m]")
    for ax in axes:
        ax.set_xlabel("time [s]")
    axes[0].legend(ncols=2, fontsize=7)
    return figure


@mpl.rc_context(STYLE)
def turns(runs: Sequence[tuple[Turn, Series]]) -> Figure:
    """Return Fig. 10: heading from two starts, belt speeds and distance up the flight."""
    figure, axes = _figure(8.0, 5.0, 2, 2)
    for ax in axes[len(runs) : 2]:
        ax.set_visible(False)
    for (row, series), ax in zip(runs, axes[:2], strict=False):
        ax.plot(series["t_s"], series["heading_deg"], color=BLUE, label="heading (truth)")
        ax.plot(series["t_s"], series["estimate_deg"], ":", color=ORANGE, label="heading (estimate)")
        ax.set_title(f"start at {row.start_heading_deg:+.0f}°")
        ax.set_ylabel("heading [°]")
        ax.axhspan(-2.0, 2.0, color=GREY, alpha=0.15)
        ax.legend()
    for (row, series), colour in zip(runs, (BLUE, RED), strict=False):
        early, start = series["t_s"] <= TURN_SHOWN_S, f"{row.start_heading_deg:+.0f}°"
        t = series["t_s"][early]
        axes[2].step(t, series["left_m_s"][early], where="post", color=colour, label=f"{start} left")
        axes[2].step(t, series["right_m_s"][early], "--", where="post", color=colour, label=f"{start} right")
        axes[3].plot(t, series["x_m"][early] - series["x_m"][0], color=colour, label=start)
    axes[2].set_ylabel("belt speed [m/s]")
    axes[3].set_ylabel("distance up the flight [m]")
    axes[2].legend(ncols=2, fontsize=7)
    axes[3].legend()
    for ax in axes:
        ax.set_xlabel("time [s]")
    return figure


@mpl.rc_context(STYLE)
def table_two(rows: Sequence[Cell], allowed: Sequence[Cell]) -> Figure:
    """Return Table II as bars on Table I's friction: the paper's, ours, and ours with roll-back allowed."""
    rows = _on_paper_friction(rows)
    figure, axes = _figure(8.0, 3.0, 1, 2)
    place = np.arange(len(rows))
    by_start = {(cell.slope_deg, cell.start_heading_deg): cell for cell in allowed}
    sliding = [by_start.get((cell.slope_deg, cell.start_heading_deg)) for cell in rows]
    axes[0].bar(place - 0.27, [_or_gap(cell.paper_deg) for cell in rows], 0.25, color=GREY, label="paper")
    groups: tuple[tuple[str, Sequence[Cell | None], str], ...] = (
        ("climb-safe", rows, BLUE),
        ("roll-back allowed", sliding, ORANGE),
    )
    for k, (name, cells, colour) in enumerate(groups):
        height = [_or_gap(cell.rms_heading_deg if cell else None) for cell in cells]
        spread = [(cell.sd or 0.0) if cell else 0.0 for cell in cells]
        back = [_or_gap(cell.roll_back_m if cell else None) for cell in cells]
        axes[0].bar(place + 0.27 * k, height, 0.25, yerr=spread, color=colour, label=f"ours, {name}")
        axes[1].bar(place + 0.3 * (k - 0.5), back, 0.28, color=colour, label=f"ours, {name}")
    axes[0].set_ylabel("RMS heading [°]")
    axes[1].set_ylabel("largest roll-back [m]")
    for ax in axes:
        ax.set_xticks(place, [f"{cell.slope_deg:g}°\n{cell.start_heading_deg:+g}°" for cell in rows])
        ax.set_xlabel("slope, start heading")
        ax.margins(y=0.4)
        ax.legend(fontsize=7, loc="upper left")
    return figure


def _on_paper_friction(rows: Sequence[Cell]) -> list[Cell]:
    return [cell for cell in rows if cell.friction == PAPER_FRICTION]


def _or_gap(value: float | None) -> float:
    return float("nan") if value is None else value


@mpl.rc_context(STYLE)
def seat(series: Series) -> Figure:
    """Return Fig. 11: the seat's pitch from the flight's slope to level."""
    figure, axes = _figure(8.0, 2.8, 1, 2)
    axes[0].plot(series["t_s"], series["seat_pitch_deg"], color=BLUE, label="seat")
    axes[0].plot(series["t_s"], series["pitch_deg"], "--", color=GREY, label="chassis")
    axes[0].set_xlabel("time [s]")
    axes[0].set_ylabel("pitch [°]")
    axes[0].legend()
    early = series["t_s"] <= 5.0
    axes[1].plot(series["t_s"][early], series["seat_pitch_deg"][early], color=BLUE)
    axes[1].set_xlabel("time [s]")
    axes[1].set_ylabel("seat pitch, first 5 s [°]")
    return figure


@mpl.rc_context(STYLE)
def margins(runs: Sequence[tuple[Turn, Series]]) -> Figure:
    """Return friction used over friction available, and the tip-over margin, which the paper does not show."""
    figure, axes = _figure(8.0, 2.8, 1, 2)
    for (row, series), colour in zip(runs, (BLUE, RED), strict=False):
        early = series["t_s"] <= TURN_SHOWN_S
        label = f"start {row.start_heading_deg:+.0f}°"
        axes[0].plot(series["t_s"][early], series["friction_use"][early], color=colour, label=label)
        axes[1].plot(series["t_s"][early], series["stability_margin_deg"][early], color=colour, label=label)
    axes[0].axhline(1.0, color=GREY, linestyle=":")
    axes[0].set_ylabel("friction used / available")
    axes[1].set_ylabel("tip-over margin [°]")
    for ax in axes:
        ax.set_xlabel("time [s]")
    axes[0].legend()
    return figure
