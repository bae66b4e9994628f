"""Figure of a walk: the chair at five places on the ground, and angles, margins, pitch rate and torque along the way."""

import math
from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from treadline.core.angles import DEG
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, STYLE
from treadline.vehicle.rest_poses import Ground, RestChair
from treadline.vehicle.walk import QUIET_RAD_S

PLACES = 5
"""Number of places at which the chair is drawn."""
SIZE_IN, IMAGE_IN = (8.0, 8.4), (6.4, 3.6)

Columns = Mapping[str, Float[np.ndarray, " n"]]


PANELS: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    ("angle [°]", (("pitch_deg", "pitch", BLUE), ("flipper_deg", "flipper", ORANGE))),
    ("margin [°]", (("front_margin_deg", "front", BLUE), ("rear_margin_deg", "rear", ORANGE), ("margin_deg", "least", GREEN))),
    ("pitch rate [°/s]", (("rate_deg_s", "pitch", RED),)),
    ("torque [N m]", (("torque_n_m", "flipper", GREEN),)),
)
"""Panels below the ground: label of the axis, and column, name and colour of each curve."""


@mpl.rc_context(STYLE)
def walk_figure(ground: Ground, chair: RestChair, columns: Columns, driven: Columns | None = None) -> Figure:
    """Return the figure of a walk, dashed where that of a run is drawn over it.

    Args:
        columns: As of ``Walk.columns``.
        driven: As of ``Recording.columns``.
    """
    figure = Figure(figsize=SIZE_IN, layout="constrained")
    side, *panels = figure.subplots(1 + len(PANELS), 1, sharex=True, height_ratios=(2.4, *(1.0 for _ in PANELS)))
    _draw_side(side, ground, chair, columns)
    runs = [(columns, "", "-", 1.0)] if driven is None else [(driven, ", driven", "-", 0.5), (columns, ", planned", "--", 1.0)]
    for axes, (label, curves) in zip(panels, PANELS, strict=True):
        for name, what, colour in curves:
            for values, when, dash, opacity in runs:
                if name in values:
                    axes.plot(values["x_m"], values[name], dash, color=colour, alpha=opacity, label=what + when)
        axes.set(ylabel=label)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    _, margins, rates, torques = panels
    margins.set(ylim=(0.0, 40.0))
    rates.axhline(QUIET_RAD_S / DEG, color=GREY, linestyle=":")
    for share in (0.7, 1.0):
        torques.axhline(share * float(chair.torques_n_m[0]), color=GREY, linestyle=":")
    torques.set(xlabel="place of mid-track along the drive [m]")
    return figure


def side_image(
    ground: Ground, chair: RestChair, pose: tuple[float, float, float], flipper_rad: float
) -> UInt8[np.ndarray, "h w 3"]:
    """Return the image of a chair at one place on the ground.

    Args:
        pose: Place x and height z of mid-track [m], and pitch [rad].
        flipper_rad: Angle of the flipper.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, (x_m, z_m, pitch) = Figure(figsize=IMAGE_IN, layout="constrained"), pose
    canvas: Any = FigureCanvasAgg(figure)  # untyped
    columns = {"x_m": x_m, "z_m": z_m, "pitch_deg": pitch / DEG, "flipper_deg": flipper_rad / DEG}
    _draw_side(figure.subplots(), ground, chair, {name: np.array([value]) for name, value in columns.items()})
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _draw_side(axes: Axes, ground: Ground, chair: RestChair, columns: Columns) -> None:
    """Draw the ground, and the chair at places that are evenly spaced along the way."""
    x_m = columns["x_m"]
    margin_m = 1.0
    low, high = float(x_m.min()) - margin_m, float(x_m.max()) + margin_m
    shown = (ground[:, 0] > low - 9.0) & (ground[:, 0] < high + 9.0)
    axes.fill_between(ground[shown, 0], ground[shown, 1], ground[:, 1].min() - 0.3, color="#e4e0da", linewidth=0.0)
    axes.plot(ground[shown, 0], ground[shown, 1], color=GREY)
    for place in np.linspace(x_m[0], x_m[-1], PLACES):
        k = int(np.argmin(np.abs(x_m - place)))
        pitch, angle = columns["pitch_deg"][k] * DEG, columns["flipper_deg"][k] * DEG
        for part in chair.parts:
            _draw_capsule(axes, part, (x_m[k], columns["z_m"][k], pitch), angle)
    axes.set(ylabel="height [m]", xlim=(low, high), aspect="equal", adjustable="datalim")


def _draw_capsule(axes: Axes, part: Float[np.ndarray, " 9"], pose: tuple[float, float, float], angle_rad: float) -> None:
    """Draw the outline of a part of the chair at a pose (x, z, pitch)."""
    at_x, at_z, length, first, last, offset, sign, joint, _ = part.tolist()
    turn = offset + (sign * angle_rad if joint >= 0.0 else 0.0)
    # The upper of the two lines that touch both circles.
    upper = math.acos((first - last) / length)
    arcs = np.linspace(upper, 2.0 * math.pi - upper, 20), np.linspace(-upper, upper, 20)
    local = np.concatenate([first * np.exp(1j * arcs[0]), length + last * np.exp(1j * arcs[1])])
    outline = pose[0] + 1j * pose[1] + np.exp(1j * pose[2]) * (at_x + 1j * at_z + np.exp(1j * turn) * local)
    axes.fill(outline.real, outline.imag, facecolor="none" if joint < 0.0 else "#cfe3f2", edgecolor=BLUE, linewidth=1.0)
