"""The paper's figures, ours: matplotlib to inline SVG, the same bytes for the same numbers.

Angles are in degrees here; colours are told apart by colour-blind eyes (Okabe and Ito).
"""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from treadline import paper

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
BY_SLOPE = {25: BLUE, 28: GREEN, 30: RED}
Series = Mapping[str, Float[np.ndarray, " T"]]

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "treadline",
    "svg.fonttype": "path",
    "path.simplify": True,
}


def svg_of(figure: Figure) -> str:
    """Return a figure as an SVG element, without dates."""
    with mpl.rc_context(STYLE):
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _figure(width_in: float, height_in: float, rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


def impulse(ours: Mapping[str, Any]) -> Figure:
    """Return Fig. 8: impulse responses of our model over those of Eq. (12)."""
    figure, axes = _figure(8.0, 4.6, 2, 2)
    printed = _printed_impulse(60)
    names = ("left_m_s", "right_m_s")
    outputs = (("heading_rad", "heading θ [rad]"), ("yaw_rate_rad_s", "angular velocity ω [rad/s]"))
    t = np.asarray(ours["t_s"])
    for column, name in enumerate(names):
        for row, (output, label) in enumerate(outputs):
            ax = axes[2 * row + column]
            ax.step(t, ours[output][name], where="post", color=BLUE, label="ours, 0.25 s period")
            ax.step(np.arange(60.0), printed[:, row, column], where="post", color=ORANGE, label="Eq. (12), 1 s period")
            ax.set_xlim(0.0, 20.0)
            ax.set_xlabel("time after the impulse [s]")
            ax.set_ylabel(label)
            ax.set_title(f"impulse on u{column + 1} ({'left' if column == 0 else 'right'} track, 1 m/s)")
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


def singular_values(slopes: Sequence[Mapping[str, Any]]) -> Figure:
    """Return the singular values of the Hankel matrix, one line per slope."""
    figure, (ax,) = _figure(5.2, 2.8, 1, 1)
    for item in slopes:
        values = np.asarray(item["singular_values"])
        values = values[values > 1e-6 * values[0]]
        slope = int(item["slope_deg"])
        ax.semilogy(np.arange(1, len(values) + 1), values / values[0], "o-", color=BY_SLOPE.get(slope, GREY), label=f"{slope}°")
    ax.axvline(2.5, color=GREY, linestyle=":")
    ax.text(2.55, 0.5, "rank 2", color=GREY)
    ax.set_xlabel("index")
    ax.set_ylabel("σ / σ₁")
    ax.legend(title="slope")
    return figure


def straight(runs: Sequence[tuple[Mapping[str, Any], Series]]) -> Figure:
    """Return Fig. 9: heading and lateral place over time, open against closed loop."""
    figure, axes = _figure(8.0, 3.2, 1, 2)
    for row, series in runs:
        colour = BY_SLOPE.get(int(row["slope_deg"]), GREY)
        closed = row["loop"] == "closed"
        style, label = ("-" if closed else "--"), f"{row['slope_deg']}° {row['loop']}"
        axes[0].plot(series["t_s"], series["heading_deg"], style, color=colour, label=label, linewidth=1.2)
        axes[1].plot(series["t_s"], series["y_m"] - series["y_m"][0], style, color=colour, linewidth=1.2)
    axes[0].set_ylabel("heading [°]")
    axes[1].set_ylabel("lateral drift [m]")
    for ax in axes:
        ax.set_xlabel("time [s]")
    axes[0].legend(ncols=2, fontsize=7)
    return figure


def turns(runs: Sequence[tuple[Mapping[str, Any], Series]]) -> Figure:
    """Return Fig. 10: heading from ±30°, and what the belts and the place did."""
    figure, axes = _figure(8.0, 5.0, 2, 2)
    for (row, series), ax in zip(runs, axes, strict=False):
        ax.plot(series["t_s"], series["heading_deg"], color=BLUE, label="heading (truth)")
        ax.plot(series["t_s"], series["estimate_deg"], ":", color=ORANGE, label="heading (estimate)")
        ax.set_title(f"start at {row['start_heading_deg']:+.0f}°")
        ax.set_ylabel("heading [°]")
        ax.axhspan(-2.0, 2.0, color=GREY, alpha=0.15)
        ax.legend()
    for row, series in runs:
        sign = "+" if row["start_heading_deg"] > 0 else "-"
        colour = BLUE if sign == "+" else RED
        early = series["t_s"] <= 12.0
        axes[2].step(series["t_s"][early], series["left_m_s"][early], where="post", color=colour, label=f"{sign}30° left")
        axes[2].step(series["t_s"][early], series["right_m_s"][early], "--", where="post", color=colour, label=f"{sign}30° right")
        axes[3].plot(series["t_s"][early], series["x_m"][early] - series["x_m"][0], color=colour, label=f"{sign}30°")
    axes[2].set_ylabel("belt speed [m/s]")
    axes[3].set_ylabel("way up the flight [m]")
    axes[2].legend(ncols=2, fontsize=7)
    axes[3].legend()
    for ax in axes:
        ax.set_xlabel("time [s]")
    return figure


def table_two(rows: Sequence[Mapping[str, Any]], allowed: Sequence[Mapping[str, Any]]) -> Figure:
    """Return Table II as bars: the paper's, ours, and ours with roll-back allowed."""
    figure, axes = _figure(8.0, 3.0, 1, 2)
    labels = [f"{row['slope_deg']}°\n{row['start_heading_deg']:+d}°" for row in rows]
    place = np.arange(len(rows))
    sets = (
        ("paper", [row["paper_deg"] for row in rows], None, GREY),
        ("ours, climb-safe", [row["rms_heading_deg"] for row in rows], [row["sd"] or 0.0 for row in rows], BLUE),
        ("ours, roll-back allowed", [row["rms_heading_deg"] for row in allowed], [row["sd"] or 0.0 for row in allowed], ORANGE),
    )
    for k, (name, values, spread, colour) in enumerate(sets):
        if len(values) == len(rows):
            axes[0].bar(place + 0.27 * (k - 1), values, 0.25, yerr=spread, color=colour, label=name)
    axes[0].set_ylabel("RMS heading [°]")
    for k, (name, source, colour) in enumerate((("climb-safe", rows, BLUE), ("roll-back allowed", allowed, ORANGE))):
        if len(source) == len(rows):
            axes[1].bar(place + 0.3 * (k - 0.5), [row["roll_back_m"] for row in source], 0.28, color=colour, label=name)
    axes[1].set_ylabel("largest roll-back [m]")
    for ax in axes:
        ax.set_xticks(place, labels)
        ax.set_xlabel("slope, start heading")
        ax.legend()
    return figure


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


def margins(runs: Sequence[tuple[Mapping[str, Any], Series]]) -> Figure:
    """Return what the paper does not show: share of friction used and the tipping margin."""
    figure, axes = _figure(8.0, 2.8, 1, 2)
    for row, series in runs:
        colour = BLUE if row["start_heading_deg"] > 0 else RED
        early = series["t_s"] <= 12.0
        label = f"start {row['start_heading_deg']:+.0f}°"
        axes[0].plot(series["t_s"][early], series["friction_use"][early], color=colour, label=label)
        axes[1].plot(series["t_s"][early], series["stability_margin_deg"][early], color=colour, label=label)
    axes[0].axhline(1.0, color=GREY, linestyle=":")
    axes[0].set_ylabel("friction used to hold the heading (1 slides)")
    axes[1].set_ylabel("smallest tipping margin [°]")
    for ax in axes:
        ax.set_xlabel("time [s]")
        ax.legend()
    return figure


def single_run(series: Series) -> Figure:
    """Return one run: heading, belts, place and seat."""
    figure, axes = _figure(8.0, 5.0, 2, 2)
    t = series["t_s"]
    axes[0].plot(t, series["heading_deg"], color=BLUE, label="truth")
    axes[0].plot(t, series["estimate_deg"], ":", color=ORANGE, label="estimate")
    axes[0].set_ylabel("heading [°]")
    axes[0].legend()
    axes[1].plot(t, series["left_m_s"], color=BLUE, label="left")
    axes[1].plot(t, series["right_m_s"], color=RED, label="right")
    axes[1].set_ylabel("belt speed [m/s]")
    axes[1].legend()
    axes[2].plot(t, series["y_m"], color=GREEN)
    axes[2].set_ylabel("across the flight [m]")
    axes[3].plot(t, series["seat_pitch_deg"], color=BLUE, label="seat pitch")
    axes[3].plot(t, series["stability_margin_deg"], color=GREY, label="tipping margin")
    axes[3].set_ylabel("[°]")
    axes[3].legend()
    for ax in axes:
        ax.set_xlabel("time [s]")
    return figure
