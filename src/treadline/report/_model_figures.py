"""Figures of an identified model. Drawn with few artists and fixed margins: layout by the engine would double the time."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator, NullFormatter

from treadline.core.angles import DEG
from treadline.core.arrays import NORMAL_95, decimated
from treadline.core.transfer_function import StabilisationDiagram, TimeResponse, unwrapped_phase
from treadline.report._model_runs import answering
from treadline.report.labels import ColumnLabel
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, STYLE, WIDTH_IN, plain_log_labels

NARROWEST_IN = 1.75
"""Smallest width of a panel [in]; more panels widen the figure."""
LEFT_IN, RIGHT_IN, TOP_IN, BOTTOM_IN = 0.80, 0.14, 0.30, 0.48
"""Margins for labels and titles in 9 points [in]."""
LABEL_IN = 0.60
"""Distance from an axis to its label [in], beyond tick labels as long as −0.0025."""
SHOWN_VALUES = 40
"""Largest number of singular values drawn."""
ROUNDING = 1e-12
"""Relative size below which a singular value is rounding error."""


DISC_MOST = 0.5
"""Radius of a disc from which on it would hide the others."""


def _grid(
    rows: int, columns: int, panel_in: float, *, gap_in: tuple[float, float] = (0.85, 0.62)
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of panels, ``gap_in`` (between columns, between rows) apart."""
    width = max(WIDTH_IN, LEFT_IN + RIGHT_IN + columns * NARROWEST_IN + (columns - 1) * gap_in[0])
    height = TOP_IN + BOTTOM_IN + rows * panel_in + (rows - 1) * gap_in[1]
    figure = Figure(figsize=(width, height))
    inner = (width - LEFT_IN - RIGHT_IN - (columns - 1) * gap_in[0]) / columns
    axes = figure.subplots(
        rows,
        columns,
        squeeze=False,
        gridspec_kw={
            "left": LEFT_IN / width,
            "right": 1.0 - RIGHT_IN / width,
            "top": 1.0 - TOP_IN / height,
            "bottom": BOTTOM_IN / height,
            "wspace": gap_in[0] / inner,
            "hspace": gap_in[1] / panel_in,
        },
    )
    for ax in axes.ravel():
        ax.yaxis.set_label_coords(-LABEL_IN / inner, 0.5)
    return figure, [list(row) for row in axes]


@mpl.rc_context(STYLE)
def singular_values(values: Float[np.ndarray, " k"], order: int, noise: float | None) -> Figure:
    """Return the singular values, those of the chosen order filled."""
    figure, ((ax,),) = _grid(1, 1, 2.2)
    shown = values[:SHOWN_VALUES]
    shown = shown[shown > ROUNDING * shown[0]]
    index = np.arange(1, len(shown) + 1)
    ax.semilogy(index, shown, "o", color=GREY, markersize=5, fillstyle="none")
    ax.semilogy(index[:order], shown[:order], "o", color=BLUE, markersize=5, label=f"kept: order {order}")
    plain_log_labels(ax.yaxis)
    ax.axvline(order + 0.5, color=BLUE, linestyle=":", linewidth=1.2)
    if noise is not None and noise > 0.0:
        ax.axhline(noise, color=RED, linestyle="--", linewidth=1.2, label="noise alone")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlim(0.4, max(len(shown), order) + 0.6)
    ax.set_xlabel("index")
    ax.set_ylabel("singular value σ [–]")
    ax.legend(loc="upper right")
    return figure


@mpl.rc_context(STYLE)
def stabilisation(diagram: StabilisationDiagram) -> Figure:
    """Return frequency against order, and damping against frequency."""
    figure, ((left, right),) = _grid(1, 2, 3.0)
    inside = diagram.frequency_hz <= diagram.nyquist_hz
    both = inside & diagram.damping_stable
    one = inside & diagram.frequency_stable & ~both
    new = inside & ~diagram.frequency_stable
    f = diagram.frequency_hz
    left.plot(f[new], diagram.order[new], "x", color=GREY, markersize=3.5, markeredgewidth=0.8, label="new")
    left.plot(f[one], diagram.order[one], "^", color=ORANGE, markersize=4.5, label="stable in frequency")
    left.plot(f[both], diagram.order[both], "o", color=BLUE, markersize=4, label="and in damping")
    left.axhline(diagram.chosen, color=BLUE, linestyle=":", linewidth=1.2)
    left.set_ylim(0.0, float(diagram.order.max(initial=diagram.chosen)) * 1.22 + 1.0)
    left.legend(loc="upper center", ncols=3, fontsize=7.5, handletextpad=0.2, columnspacing=0.8)
    left.set_ylabel("order [–]")
    left.yaxis.set_major_locator(MaxNLocator(integer=True))
    right.plot(f[one], 100.0 * diagram.damping[one], "^", color=ORANGE, markersize=4.5)
    right.plot(f[both], 100.0 * diagram.damping[both], "o", color=BLUE, markersize=4, alpha=0.6)
    if not (one | both).any():
        right.text(0.5, 0.5, "none is stable", transform=right.transAxes, ha="center")
        right.set_ylim(-5.0, 105.0)
    right.axhline(0.0, color=GREY, linewidth=0.8)
    right.set_ylabel("damping [% of critical]")
    for ax in (left, right):
        ax.set_xlim(0.0, diagram.nyquist_hz)
        ax.set_xlabel("natural frequency [Hz]")
    return figure


@mpl.rc_context(STYLE)
def time_response(
    response: Float[np.ndarray, "steps p m"],
    deviation: Float[np.ndarray, "steps p m"] | None,
    dt_s: float,
    inputs: Sequence[ColumnLabel],
    outputs: Sequence[ColumnLabel],
    *,
    after: str = "impulse",
) -> Figure:
    """Return time responses, one panel per pair; each output as long as it answers: one may last a second, another stay.

    Args:
        deviation: Standard deviation of the response; None without one.
        after: Input, ``impulse`` or ``step``.
    """
    figure, panels = _grid(len(outputs), len(inputs), 1.35)
    for i, row in enumerate(panels):
        for j, ax in enumerate(row):
            half = None if deviation is None else deviation[:, i, j]
            _time_panel(ax, response[:, i, j], half, dt_s, answering(moving(response[:, i], after)))
            _pair_labels(ax, outputs[i], inputs[j], "")
            if i == len(outputs) - 1:
                ax.set_xlabel(f"time after the {after} [s]")
    return figure


def moving(response: Float[np.ndarray, "steps m"], after: str) -> Float[np.ndarray, "steps m"]:
    """Return the response to an impulse, of the responses to an impulse or a step."""
    return response if after == "impulse" else np.diff(response, axis=0, prepend=0.0)


def _time_panel(
    ax: Axes, response: Float[np.ndarray, " steps"], sigma: Float[np.ndarray, " steps"] | None, dt_s: float, shown: int
) -> None:
    values, t = response[:shown], np.arange(shown) * dt_s
    low = high = values
    if sigma is not None:
        half = NORMAL_95 * np.nan_to_num(sigma[:shown], posinf=0.0)
        low, high = values - half, values + half
        ax.fill_between(t, low, high, color=ORANGE, alpha=0.45, linewidth=0.0)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.plot(t, values, "o-" if shown <= 60 else "-", color=BLUE, linewidth=1.2, markersize=2.5)
    ax.set_ylim(*_window(values, low, high))


def _window(values: Float[np.ndarray, " k"], low: Float[np.ndarray, " k"], high: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return limits that show a line and its band; a band far wider than the line is cut."""
    span = max(float(np.ptp(values)), 1e-12 * float(np.abs(values).max()), 1e-300)
    bottom = max(float(low.min()), float(values.min()) - 2.0 * span)
    top = min(float(high.max()), float(values.max()) + 2.0 * span)
    return min(bottom, 0.0) - 0.06 * span, max(top, 0.0) + 0.06 * span


def _pair_labels(ax: Axes, output: ColumnLabel, given: ColumnLabel, symbol: str) -> None:
    ax.set_title(f"{given.quantity} → {output.quantity}", fontsize=_title_size(output, given))
    known = output.unit is not None and given.unit is not None
    unit = "own units" if not known else "–" if output.unit == given.unit else f"{output.unit} per {given.unit}"
    ax.set_ylabel(f"{symbol}[{unit}]", fontsize=8)


Spectrum = tuple[Float[np.ndarray, " _"], Complex[np.ndarray, "_ _ _"]]
"""Frequencies [Hz], and the response of a model or one that was measured."""
Curve = tuple[Float[np.ndarray, " _"], Complex[np.ndarray, " _"]]
"""Frequencies [Hz], and the response of one pair."""
BEHIND: Mapping[str, Any] = {"color": GREY, "marker": ".", "markersize": 3.0, "linewidth": 0.6, "alpha": 0.6}
"""Style of a measured response behind the model's."""


@mpl.rc_context(STYLE)
def frequency_response(
    modelled: Spectrum,
    sigma: Float[np.ndarray, "w p m"] | None,
    measured: Spectrum | None,
    inputs: Sequence[ColumnLabel],
    outputs: Sequence[ColumnLabel],
) -> tuple[Figure, Figure]:
    """Return magnitudes and phases over frequency, one panel per pair, the measured response in grey behind the model's.

    Args:
        sigma: Standard deviation of the magnitude; None without one.
    """
    (magnitudes, upper), (phases, lower) = (_grid(len(outputs), len(inputs), 1.35) for _ in range(2))
    for i, output in enumerate(outputs):
        for j, given in enumerate(inputs):
            curve, seen = _curve(modelled, i, j), None if measured is None else _curve(measured, i, j)
            _magnitude_panel(upper[i][j], curve, None if sigma is None else sigma[:, i, j], seen)
            _pair_labels(upper[i][j], output, given, "|G| ")
            _phase_panel(lower[i][j], curve, seen)
            lower[i][j].set_title(f"{given.quantity} → {output.quantity}", fontsize=_title_size(output, given))
    _frequency_axes(upper, modelled)
    _frequency_axes(lower, modelled)
    return magnitudes, phases


@mpl.rc_context(STYLE)
def bode(
    modelled: Spectrum, inputs: Sequence[ColumnLabel], outputs: Sequence[ColumnLabel], step: TimeResponse | None = None
) -> Figure:
    """Return magnitude and phase of each output in two rows, its step response in a row above where one is given."""
    each = 2 if step is None else 3
    figure, panels = _grid(each * len(outputs), len(inputs), 1.35)
    for i, output in enumerate(outputs):
        for j, given in enumerate(inputs):
            *above, upper, lower = (row[j] for row in panels[each * i : each * (i + 1)])
            _magnitude_panel(upper, _curve(modelled, i, j), None, None)
            _phase_panel(lower, _curve(modelled, i, j), None)
            _pair_labels(upper, output, given, "|G| ")
            if step is not None:
                shown = answering(moving(step.y[:, i], "step"))
                _time_panel(above[0], step.y[:, i, j], None, float(step.t_s[1]), shown)
                _pair_labels(above[0], output, given, "step ")
                above[0].set_xlabel("time [s]")
                upper.set_title("")
    _frequency_axes([row for k, row in enumerate(panels) if k % each >= each - 2], modelled)
    return figure


def _curve(of: Spectrum, i: int, j: int) -> Curve:
    return of[0], of[1][:, i, j]


def _magnitude_panel(ax: Axes, modelled: Curve, sigma: Float[np.ndarray, " w"] | None, measured: Curve | None) -> None:
    f, size = modelled[0], np.abs(modelled[1])
    there = np.isfinite(size) & (size > 0.0)
    high = size
    if measured is not None:
        ax.plot(measured[0], np.abs(measured[1]), **BEHIND)
    if sigma is not None:
        half = NORMAL_95 * np.nan_to_num(sigma, posinf=0.0)
        low, high = np.maximum(size - half, 1e-3 * float(size[there].min(initial=np.inf))), size + half
        ax.fill_between(f[there], low[there], high[there], color=ORANGE, alpha=0.45, linewidth=0.0)
    if not there.any():
        ax.text(0.5, 0.5, "zero", transform=ax.transAxes, ha="center")
        return
    ax.loglog(f[there], size[there], color=BLUE, linewidth=1.2)
    ax.set_ylim(*_decades(size[there], high[there]))
    ax.yaxis.set_minor_formatter(NullFormatter())
    plain_log_labels(ax.yaxis)


def _phase_panel(ax: Axes, modelled: Curve, measured: Curve | None) -> None:
    """Draw phases; the measured ones at the turn nearest to the model's."""
    f, values = modelled[0], unwrapped_phase(modelled[1]) / DEG
    if measured is not None:
        turns = np.round((np.interp(measured[0], f, np.nan_to_num(values)) - np.angle(measured[1], deg=True)) / 360.0)
        ax.plot(measured[0], np.angle(measured[1], deg=True) + 360.0 * turns, **BEHIND)
    ax.plot(f, values, color=BLUE, linewidth=1.2)
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    ax.set_ylabel("phase [°]", fontsize=8)


def _frequency_axes(panels: Sequence[Sequence[Axes]], modelled: Spectrum) -> None:
    for ax in (ax for row in panels for ax in row):
        ax.set_xscale("log")
        plain_log_labels(ax.xaxis)
        ax.set_xlim(float(modelled[0][0]), float(modelled[0][-1]))
    for ax in panels[-1]:
        ax.set_xlabel("frequency [Hz], up to Nyquist")


def _title_size(output: ColumnLabel, given: ColumnLabel) -> float:
    """Return the type size at which two names fit over the narrowest panel."""
    return min(9.0, max(5.0, 210.0 / (len(output.quantity) + len(given.quantity) + 3)))


def _decades(size: Float[np.ndarray, " k"], upper: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return limits at whole decades, so that each axis has two labels at least; a band far above the line is cut."""
    least, most = float(size.min()), float(size.max())
    low = math.floor(math.log10(least / 1.5))
    high = math.ceil(math.log10(min(max(1.2 * most, float(upper.max())), 10.0 * most)))
    return 10.0**low, 10.0 ** max(high, low + 1)


@mpl.rc_context(STYLE)
def fit(
    t: Float[np.ndarray, " T"],
    measured: Float[np.ndarray, "T p"],
    modelled: Float[np.ndarray, "T p"],
    ahead: Float[np.ndarray, "T p"],
    closer: slice | None,
    outputs: Sequence[ColumnLabel],
    *,
    kind: str = "free run",
) -> Figure:
    """Return measured and modelled outputs with residuals below, and optionally an enlarged section next to them.

    Args:
        kind: Name of the modelled outputs in the legend.
    """
    parts = [slice(None)] if closer is None else [slice(None), closer]
    figure, panels = _grid(2 * len(outputs), len(parts), 1.2, gap_in=(0.55, 0.5))
    for i, output in enumerate(outputs):
        for column, part in enumerate(parts):
            upper, lower = panels[2 * i][column], panels[2 * i + 1][column]
            near = closer is None or column == 1
            y, y_free, y_ahead = measured[part, i], modelled[part, i], ahead[part, i]
            upper.plot(*decimated(t[part], y), color=GREY, linewidth=2.2, alpha=0.75, label="measured")
            upper.plot(*decimated(t[part], y_free), color=BLUE, linewidth=1.0, label=kind)
            if near:
                upper.plot(t[part], y_ahead, ":", color=RED, linewidth=1.4, label="one step ahead")
            lower.plot(*decimated(t[part], y - y_free), color=BLUE, linewidth=0.9, label=kind)
            lower.plot(*decimated(t[part], y - y_ahead), ":" if near else "-", color=RED, linewidth=0.9, label="one step ahead")
            lower.axhline(0.0, color=GREY, linewidth=0.8)
            for ax in (upper, lower):
                ax.set_xlim(float(t[part][0]), float(t[part][-1]))
            upper.tick_params(labelbottom=False)
            _lower_edge(upper, 0.30 / figure.get_figheight())
            if closer is not None and column == 0:
                for ax in (upper, lower):
                    ax.axvspan(float(t[closer][0]), float(t[closer][-1]), color=ORANGE, alpha=0.25, linewidth=0.0)
        whole, last = panels[2 * i][0], panels[2 * i][-1]
        whole.set_title(f"{output.quantity}: whole record" if closer is not None else output.quantity, loc="left")
        last.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=7.5, borderpad=0.0, columnspacing=1.0)
        whole.set_ylabel(f"output [{output.unit or 'own unit'}]")
        panels[2 * i + 1][0].set_ylabel(f"residual [{output.unit or 'own unit'}]")
    for ax in panels[-1]:
        ax.set_xlabel("time in the record [s]")
    return figure


@mpl.rc_context(STYLE)
def several(
    runs: Mapping[str, tuple[Float[np.ndarray, " T"], Float[np.ndarray, "T p"]]],
    measured: Float[np.ndarray, "T p"],
    outputs: Sequence[ColumnLabel],
) -> Figure:
    """Return measured outputs with the runs of several models, a panel for each output.

    Args:
        runs: Time [s] and outputs by name of the model.
    """
    figure, panels = _grid(len(outputs), 1, 1.8)
    times = [t for t, _ in runs.values()]
    for i, ((ax,), output) in enumerate(zip(panels, outputs, strict=True)):
        ax.plot(*decimated(times[0], measured[:, i]), color=GREY, linewidth=2.2, alpha=0.75, label="measured")
        for colour, (name, (t, y)) in zip(cycle((BLUE, RED, ORANGE, GREEN)), runs.items(), strict=False):
            ax.plot(*decimated(t, y[:, i]), color=colour, linewidth=1.0, label=name)
        ax.set_title(output.quantity, loc="left")
        ax.set_ylabel(f"output [{output.unit or 'own unit'}]")
    panels[0][0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, fontsize=7.5, borderpad=0.0)
    panels[-1][0].set_xlabel("time in the record [s]")
    return figure


def _lower_edge(ax: Axes, step: float) -> None:
    """Let a panel reach down to the one that shares its time axis."""
    box = ax.get_position()
    ax.set_position((box.x0, box.y0 - step, box.width, box.height + 0.7 * step))


@mpl.rc_context(STYLE)
def residuals(
    own: Float[np.ndarray, "p k"],
    own_band: Float[np.ndarray, " p"],
    across: Float[np.ndarray, "p m k"],
    across_band: Float[np.ndarray, "p m"],
    inputs: Sequence[ColumnLabel],
    outputs: Sequence[ColumnLabel],
) -> Figure:
    """Return autocorrelation and cross-correlations of residuals: a row per output, the first column its own past."""
    figure, panels = _grid(len(outputs), 1 + len(inputs), 1.3, gap_in=(0.48, 0.62))
    lags = own.shape[1] // 2
    both = np.arange(-lags, lags + 1)
    for i, row in enumerate(panels):
        _correlation(row[0], both[lags + 1 :], own[i, lags + 1 :], own_band[i])
        row[0].set_title(f"{outputs[i].quantity} with itself", fontsize=_title_size(outputs[i], inputs[0]))
        row[0].set_ylabel("correlation [–]")
        for j, ax in enumerate(row[1:]):
            _correlation(ax, both, across[i, j], across_band[i, j])
            ax.axvline(0.0, color=GREY, linewidth=0.8)
            ax.set_title(f"{outputs[i].quantity} with {inputs[j].quantity}", fontsize=_title_size(outputs[i], inputs[j]))
        if i == len(outputs) - 1:
            for ax in row:
                ax.set_xlabel("lag [samples]")
    return figure


def _correlation(ax: Axes, lags: Int[np.ndarray, " k"], values: Float[np.ndarray, " k"], band: float) -> None:
    ax.axhspan(-band, band, color=ORANGE, alpha=0.35, linewidth=0.0)
    inside = np.abs(values) <= band
    # One line through all stems: a bar each would be an artist each.
    ax.plot(
        np.repeat(lags, 3), np.column_stack([0 * values, values, np.full(len(values), np.nan)]).ravel(), color=GREY, linewidth=1.0
    )
    ax.plot(lags[inside], values[inside], "o", color=BLUE, markersize=2.2)
    ax.plot(lags[~inside], values[~inside], "D", color=RED, markersize=3.0)
    reach = 1.15 * max(float(np.abs(values).max()), 1.6 * band)
    ax.set_ylim(-reach, reach)


@mpl.rc_context(STYLE)
def poles(values: Complex[np.ndarray, " n"], radii: Sequence[float] | None, zeros: Complex[np.ndarray, " k"]) -> Figure:
    """Return poles, their discs and zeros with the unit circle, with an enlarged view of clustered poles next to it.

    Zeros farther out than twice the reach of the poles are not drawn.
    """
    spread = np.zeros(len(values)) if radii is None else np.minimum(np.nan_to_num(radii, posinf=2.0), 2.0)
    slow = np.abs(values) > 0.9
    view = _close_view(values, spread) or _close_view(values[slow], spread[slow])
    figure, (panels,) = _grid(1, 2, 3.55)
    _pole_panel(panels[0], values, spread, zeros)
    reach = max(1.15, 1.1 * float(np.abs(values).max(initial=0.0)))
    near = np.abs(zeros[np.abs(zeros) < 2.0 * reach])
    reach = max(reach, 1.1 * float(near.max(initial=0.0)))
    panels[0].set_xlim(-reach, reach)
    panels[0].set_ylim(-reach, reach)
    if view is None:
        panels[1].set_visible(False)
        return figure
    middle, half = view
    _pole_panel(panels[1], values, spread, zeros)
    panels[1].set_xlim(middle.real - half, middle.real + half)
    panels[1].set_ylim(middle.imag - half, middle.imag + half)
    panels[1].set_title("closer", loc="left")
    panels[0].add_patch(
        mpl.patches.Rectangle((middle.real - half, middle.imag - half), 2 * half, 2 * half, fill=False, edgecolor=ORANGE)
    )
    return figure


def _close_view(values: Complex[np.ndarray, " n"], spread: Float[np.ndarray, " n"]) -> tuple[complex, float] | None:
    """Return centre and half width of a square around the slow poles; None where it would show no more."""
    if not values.size:
        return None
    if values.imag.max() > 0.3:  # pairs far apart: the upper half says all
        values, spread = values[values.imag >= 0.0], spread[values.imag >= 0.0]
    reach = np.minimum(spread, 0.2)
    low = complex((values.real - reach).min(), (values.imag - reach).min())
    high = complex((values.real + reach).max(), (values.imag + reach).max())
    half = 0.62 * max(high.real - low.real, high.imag - low.imag, 0.01)
    return (0.5 * (low + high), half) if half < 0.5 else None


def _pole_panel(
    ax: Axes, values: Complex[np.ndarray, " n"], spread: Float[np.ndarray, " n"], zeros: Complex[np.ndarray, " k"]
) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 1441)
    ax.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=1.2)
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    discs = [Circle((pole.real, pole.imag), size) for pole, size in zip(values, spread, strict=True) if 0.0 < size < DISC_MOST]
    ax.add_collection(PatchCollection(discs, facecolor=ORANGE, edgecolor=RED, linewidth=0.6, alpha=0.3))
    inside = np.abs(values) <= 1.0
    ax.plot(zeros.real, zeros.imag, "o", color=GREY, markersize=6, fillstyle="none", markeredgewidth=1.2)
    ax.plot(values.real[inside], values.imag[inside], "x", color=BLUE, markersize=6, markeredgewidth=1.6)
    ax.plot(values.real[~inside], values.imag[~inside], "P", color=RED, markersize=6)
    ax.set_aspect("equal")
    ax.set_xlabel("real part [–]")
    ax.set_ylabel("imaginary part [–]")
