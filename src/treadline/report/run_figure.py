"""Time series of one run: one panel per quantity over a common time axis, phases of the traversal as bands."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from treadline.report.model_runs import decimated
from treadline.report.motion import Motion
from treadline.report.results import RunResult
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, STYLE, Series

WIDTH_IN, PANEL_IN, STRIP_IN = 8.0, 1.3, 0.75
STEADY_FROM_S = 20.0
"""Start of the steady interval [s], as in the steady scores; half of a shorter run."""
CLOSER_BY = 3.0
"""Smallest magnification at which an enlarged panel of the steady interval is drawn."""
BANDS = ("#dbe9f6", "#f6ecd5")
LETTER_IN = 0.075
"""Width of one letter of a band's name [in]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """Panel of one quantity: its curves and the limits of the vertical axis."""

    title: str
    draw: Callable[[Axes], object]
    limits: tuple[float, float] | None = None


@mpl.rc_context(STYLE)
def single_run(series: Series, result: RunResult, motion: Motion | None) -> Figure:
    """Return the figure of one run: heading, pitch, seat, passenger, belts, position and margin, as far as recorded."""
    panels = _panels(series, result, motion)
    bands = _bands(result, float(series["t_s"][-1]))
    strip = [STRIP_IN] if bands else []
    heights = strip + [PANEL_IN] * len(panels)
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 0.4), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights).ravel())
    if bands:
        _name(axes[0], bands)
    for panel, ax in zip(panels, axes[len(strip) :], strict=True):
        panel.draw(ax)
        ax.set_title(panel.title, loc="left", fontsize=9)
        if panel.limits is not None:
            ax.set_ylim(*panel.limits)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=3, fontsize=8, borderaxespad=0.0, borderpad=0.1)
        for k, (start, end, _) in enumerate(bands):
            ax.axvspan(start, end, color=BANDS[k % 2], alpha=0.6, linewidth=0.0, zorder=0)
    axes[-1].set_xlim(float(series["t_s"][0]), float(series["t_s"][-1]))
    axes[-1].set_xlabel("time [s]")
    return figure


def _panels(series: Series, result: RunResult, motion: Motion | None) -> list[Panel]:
    def shown(title: str, *curves: tuple[str, str, str, str], unit: str = "[°]", closer: bool = False) -> list[Panel]:
        """Return the panel of columns (name, colour, style, label), and an enlarged one; none without data."""
        known = [curve for curve in curves if np.isfinite(series[curve[0]]).any()]

        def draw(ax: Axes) -> None:
            for name, colour, style, label in known:
                ax.plot(series["t_s"], series[name], style, color=colour, label=label or None, linewidth=1.2)

        whole = [Panel(title=f"{title} {unit}", draw=draw)] if known else []
        return whole + (
            _closer(f"{title}, steady interval, enlarged {unit}", draw, series, [name for name, *_ in known]) if closer else []
        )

    heading = shown("heading", ("heading_deg", BLUE, "-", "truth"), ("estimate_deg", ORANGE, ":", "estimate"), closer=True)
    seat = shown("seat pitch", ("seat_pitch_deg", BLUE, "-", ""), closer=True)
    pitch = shown("pitch of the chair, front up positive", ("pitch_deg", BLUE, "-", ""))
    margin = shown("smallest tip-over margin", ("stability_margin_deg", GREY, "-", ""))
    if result.seat is not None:  # the chair stands still: heading, belts and position are constant
        return [*seat, *pitch, *_motion_panels(motion), *margin]
    belts = shown("belt speed", ("left_m_s", BLUE, "-", "left"), ("right_m_s", RED, "-", "right"), unit="[m/s]")
    aside = shown("lateral position, left positive", ("y_m", GREEN, "-", ""), unit="[m]")
    return [*heading, *pitch, *_motion_panels(motion), *seat, *belts, *aside, *margin]


def _motion_panels(motion: Motion | None) -> list[Panel]:
    if motion is None:
        return []

    def drawn(t_s: Float[np.ndarray, " T"], values: Float[np.ndarray, " T"], colour: str) -> Callable[[Axes], object]:
        return lambda ax: ax.plot(*decimated(t_s, values), color=colour, linewidth=0.9)

    return [
        Panel(title="pitch rate, mean over 50 ms [°/s]", draw=drawn(motion.t_s, motion.pitch_rate_deg_s, BLUE)),
        Panel(
            title="acceleration of the passenger, mean over 50 ms [m/s²]",
            draw=drawn(motion.accelerated_t_s, motion.passenger_m_s2, RED),
        ),
    ]


def _closer(title: str, draw: Callable[[Axes], object], series: Series, names: Sequence[str]) -> list[Panel]:
    """Return a second panel scaled to the steady interval, if that is a flat line at the scale of the whole run."""
    t, curves = series["t_s"], [series[name] for name in names]
    from_s = STEADY_FROM_S if t[-1] > 1.25 * STEADY_FROM_S else 0.5 * float(t[0] + t[-1])
    steady, whole = (_reach([curve[t >= start] for curve in curves]) for start in (from_s, -math.inf))
    if steady is None or whole is None or whole[1] - whole[0] < CLOSER_BY * (steady[1] - steady[0]):
        return []
    room = max(0.15 * (steady[1] - steady[0]), 1e-3)
    return [Panel(title=title, draw=draw, limits=(steady[0] - room, steady[1] + room))]


def _reach(curves: Sequence[Float[np.ndarray, " k"]]) -> tuple[float, float] | None:
    known = np.array([value for curve in curves for value in curve[np.isfinite(curve)]])
    return (float(known.min()), float(known.max())) if known.size else None


def _bands(result: RunResult, end_s: float) -> list[tuple[float, float, str]]:
    """Return start [s], end [s] and name of each phase; none for a single phase."""
    phases = result.course
    starts = [t_s for t_s, _ in phases]
    if len(starts) < 2:
        return []
    return [(start, end, name) for (start, name), end in zip(phases, [*starts[1:], max(end_s, starts[-1])], strict=True)]


def _name(ax: Axes, bands: Sequence[tuple[float, float, str]]) -> None:
    """Draw the strip with the names of the bands: lying where there is room, else standing; none over another."""
    per_in = (bands[-1][1] - bands[0][0] or 1.0) / (WIDTH_IN - 0.8)
    standing = 0.16 * per_in
    widths = [LETTER_IN * len(name) * per_in for _, _, name in bands]
    lies = [width + 2.0 * standing < end - start for width, (start, end, _) in zip(widths, bands, strict=True)]
    halves = [0.5 * (width if lying else standing) for width, lying in zip(widths, lies, strict=True)]
    places = _apart([0.5 * (start + end) for start, end, _ in bands], halves, bands[0][0], bands[-1][1])
    for k, ((start, end, name), lying, at) in enumerate(zip(bands, lies, places, strict=True)):
        ax.axvspan(start, end, color=BANDS[k % 2], linewidth=0.0)
        ax.text(at, 0.5, name, rotation=0 if lying else 90, ha="center", va="center", fontsize=8, clip_on=True)
    ax.set_ylim(0.0, 1.0)
    ax.set_title("phase", loc="left", fontsize=9)
    ax.set_axis_off()


def _apart(middles: Sequence[float], halves: Sequence[float], low: float, high: float) -> list[float]:
    """Return where names go: at their middles, moved on where they would cover one another, and back from the end."""
    places: list[float] = []
    for middle, half in zip(middles, halves, strict=True):
        places.append(max(middle, low + half))
        low = places[-1] + half
    for k in reversed(range(len(places))):
        places[k] = min(places[k], high - halves[k])
        high = places[k] - halves[k]
    return places
