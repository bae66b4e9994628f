"""Time series of one run: one panel per quantity over a common time axis, phases of the traversal as bands."""

from collections.abc import Callable, Mapping, Sequence

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from treadline.core.angles import DEG
from treadline.core.arrays import decimated
from treadline.core.printing import UNITS, unit_ending
from treadline.playback import Recording
from treadline.report._player_data import passenger_m_s2
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, STYLE, WIDTH_IN
from treadline.vehicle.comfort import COMFORT_TICKS, STEADY_FROM_S, lasting

PANEL_IN, STRIP_IN = 1.3, 0.75
CLOSER_BY = 3.0
"""Smallest magnification at which an enlarged panel of the steady interval is drawn."""
BANDS = ("#dbe9f6", "#f6ecd5")
LETTER_IN = 0.075
"""Width of one letter of a band's name [in]."""
HEADING = ("heading", "°", (("heading_deg", BLUE, "-", "truth"), ("estimate_deg", ORANGE, ":", "estimate")))
PITCH = ("pitch of the chair, front up positive", "°", (("pitch_deg", BLUE, "-", ""),))
SEAT = ("seat pitch", "°", (("seat_pitch_deg", BLUE, "-", ""),))
BELTS = ("belt speed", "m/s", (("left_m_s", BLUE, "-", "left"), ("right_m_s", RED, "-", "right")))
LATERAL = ("lateral position, left positive", "m", (("y_m", GREEN, "-", ""),))
MARGIN = ("smallest tip-over margin", "°", (("stability_margin_deg", GREY, "-", ""),))
CLOSER = (HEADING, SEAT)
"""Quantities with a second panel of the steady interval."""

Series = Mapping[str, Float[np.ndarray, " T"]]
Quantity = tuple[str, str, tuple[tuple[str, str, str, str], ...]]
"""Title, unit, and the column, colour, line style and label of each curve."""
Panel = tuple[str, Callable[[Axes], object], tuple[float, float] | None]
"""Title of a panel, function that draws its curves, and limits of the vertical axis."""
Bands = Sequence[tuple[float, float, str]]
"""Start [s], end [s] and name of each phase."""


@mpl.rc_context(STYLE)
def single_run(
    series: Series,
    phases: Sequence[tuple[float, str]],
    moved: Recording | None = None,
    *,
    seat_alone: bool = False,
    columns: Sequence[str] = (),
) -> Figure:
    """Return the figure of one run: heading, pitch, seat, passenger, belts, position and margin, as far as recorded.

    Args:
        series: Columns of ``series.csv``.
        phases: Start [s] and name of each phase.
        moved: Recording with ground truth at 100 Hz, from which pitch rate and passenger acceleration are drawn.
        seat_alone: Whether the chair stands still, so that heading, belts and position are constant.
        columns: Columns to draw, each in a panel, in place of the usual quantities.
    """
    moving = (HEADING, PITCH, None, SEAT, BELTS, LATERAL, MARGIN)
    usual = (SEAT, PITCH, None, MARGIN) if seat_alone else moving
    panels = _panels(series, moved, [_alone(name) for name in columns] or usual)
    t_s = series["t_s"]
    ends = [*(start for start, _ in phases[1:]), max(float(t_s[-1]), phases[-1][0] if phases else 0.0)]
    bands = [(start, end, name) for (start, name), end in zip(phases, ends, strict=False)] if len(phases) > 1 else []
    heights = ([STRIP_IN] if bands else []) + [PANEL_IN] * len(panels)
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 0.4), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights).ravel())
    if bands:
        _name(axes[0], bands)
    for (title, draw, limits), ax in zip(panels, axes[-len(panels) :], strict=True):
        draw(ax)
        ax.set_title(title, loc="left", fontsize=9)
        if limits is not None:
            ax.set_ylim(*limits)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=3, fontsize=8, borderaxespad=0.0, borderpad=0.1)
        for k, (start, end, _) in enumerate(bands):
            ax.axvspan(start, end, color=BANDS[k % 2], alpha=0.6, linewidth=0.0, zorder=0)
    axes[-1].set_xlim(float(t_s[0]), float(t_s[-1]))
    axes[-1].set_xlabel("time [s]")
    return figure


def _alone(column: str) -> Quantity:
    """Return the quantity of one column."""
    ending = unit_ending(column)
    unit = "" if ending is None else UNITS[ending]
    return column.removesuffix(f"_{ending}").replace("_", " "), unit, ((column, BLUE, "-", ""),)


def _panels(series: Series, moved: Recording | None, quantities: Sequence[Quantity | None]) -> list[Panel]:
    """Return the panels of quantities with data; None stands for the motion at 100 Hz."""
    panels: list[Panel] = []
    for quantity in quantities:
        if quantity is None:
            panels += [] if moved is None else _motion(moved)
            continue
        title, unit, curves = quantity
        known = [curve for curve in curves if np.isfinite(series[curve[0]]).any()]
        if known:
            panels.append((f"{title} [{unit}]", _drawing(series, known), None))
            limits = _closer(series, [name for name, *_ in known]) if quantity in CLOSER else None
            if limits is not None:
                panels.append((f"{title}, steady interval, enlarged [{unit}]", _drawing(series, known), limits))
    return panels


def _drawing(series: Series, curves: Sequence[tuple[str, str, str, str]]) -> Callable[[Axes], object]:
    def draw(ax: Axes) -> None:
        for name, colour, style, label in curves:
            ax.plot(series["t_s"], series[name], style, color=colour, label=label or None, linewidth=1.2)

    return draw


def _motion(moved: Recording) -> list[Panel]:
    """Return pitch rate and passenger acceleration, as far as there is ground truth at 100 Hz."""
    passenger = passenger_m_s2(moved)
    first = 1 + COMFORT_TICKS
    if not np.isfinite(passenger[first:]).any():
        return []
    rate = lasting(moved.pitch_rate_rad_s) / DEG

    def drawn(t_s: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"], colour: str) -> Callable[[Axes], object]:
        return lambda ax: ax.plot(*decimated(t_s, values), color=colour, linewidth=0.9)

    return [
        ("pitch rate, mean over 50 ms [°/s]", drawn(moved.t_s[COMFORT_TICKS - 1 :], rate, BLUE), None),
        ("acceleration of the passenger, mean over 50 ms [m/s²]", drawn(moved.t_s[first:], passenger[first:], RED), None),
    ]


def _closer(series: Series, names: Sequence[str]) -> tuple[float, float] | None:
    """Return limits scaled to the steady interval; None if it is no flat line at the scale of the whole run."""
    t, values = series["t_s"], np.array([series[name] for name in names])
    values = np.where(np.isfinite(values), values, np.nan)
    # Of a run shorter than the steady scores need, its second half.
    from_s = STEADY_FROM_S if t[-1] > 1.25 * STEADY_FROM_S else 0.5 * float(t[0] + t[-1])
    steady = values[:, t >= from_s]
    if np.isnan(steady).all():
        return None
    low, high = float(np.nanmin(steady)), float(np.nanmax(steady))
    if np.nanmax(values) - np.nanmin(values) < CLOSER_BY * (high - low):
        return None
    room = max(0.15 * (high - low), 1e-3)
    return low - room, high + room


def _name(ax: Axes, bands: Bands) -> None:
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
