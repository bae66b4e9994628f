"""Report page of a reproduction: one self-contained HTML file, drawn from the files of its folder.

The template engine escapes text; figures are inline SVG drawn by this package; a content security policy forbids requests and
scripts. The page links to the pages of the reproduction's runs, which play them.

The figures are drawn from the rows of ``results.json`` and the time series of the runs. Angles are in degrees.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from treadline.core import paper
from treadline.core.arrays import markov_parameters
from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.io.runs import COMPLETED, LOG
from treadline.playback import Recording, read_recording
from treadline.report._results import PAPER_FRICTION, Cell, Impulse, ModelFigures, Results, Steered, Straight, Turn, read_part
from treadline.report._run_page import checked_series, write_page, write_run_page
from treadline.report.comparison import IMPULSE_S, answer, comparisons
from treadline.report.html_pages import in_base64
from treadline.report.labels import run_words
from treadline.report.player_page import write_player
from treadline.report.run_figure import Series
from treadline.report.side_view import SideViews
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, STYLE, WIDTH_IN, panels_of, plain_log_labels, svg_of

BY_SLOPE: dict[float, str] = {20: ORANGE, 25: BLUE, 28: GREEN, 30: RED}
BY_HEADING = ("#000000", GREY, BLUE, GREEN, RED)
TURN_SHOWN_S = 12.0
"""Span of a turn from ±30° in which belts, place and margins change."""


def _figure(height_in: float, rows: int, x: str, y: Sequence[str], width_in: float = WIDTH_IN) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels with a common label of the horizontal axes and one of each vertical axis."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = list(figure.subplots(rows, len(y) // rows, squeeze=False).ravel())
    for ax, label in zip(axes, y, strict=True):
        ax.set_xlabel(x)
        ax.set_ylabel(label)
    return figure, axes


@mpl.rc_context(STYLE)
def impulse(ours: Impulse) -> Figure:
    """Return Fig. 8: impulse responses of our model over those of Eq. (12)."""
    labels = ("heading θ [rad]", "angular velocity ω [rad/s]")
    figure, axes = _figure(4.6, 2, "time after the impulse [s]", (labels[0], labels[0], labels[1], labels[1]))
    steps = round(IMPULSE_S / paper.SAMPLING_TIME_S) + 1
    printed, t_printed = markov_parameters(paper.A, paper.B, paper.C, paper.D, steps), np.arange(steps) * paper.SAMPLING_TIME_S
    for row, response in enumerate((ours.heading_rad, ours.yaw_rate_rad_s)):
        for column, (values, belt) in enumerate(((response.left_m_s, "left"), (response.right_m_s, "right"))):
            ax = axes[2 * row + column]
            ax.step(np.asarray(ours.t_s), values, where="post", color=BLUE, label="ours")
            ax.step(t_printed, printed[:, row, column], where="post", color=ORANGE, label="Eq. (12)")
            ax.set_xlim(0.0, IMPULSE_S)
            ax.set_title(f"impulse on u{column + 1} ({belt} track, 1 m/s)")
    axes[0].legend()
    return figure


@mpl.rc_context(STYLE)
def singular_values(slopes: Sequence[ModelFigures]) -> Figure:
    """Return the singular values of the Hankel matrix, one line per slope."""
    figure, (ax,) = _figure(2.8, 1, "index", ("σ / σ₁",), width_in=5.2)
    for item in slopes:
        values = np.asarray(item.singular_values)
        values = values[values > 1e-6 * values[0]]
        style = "o-" if item.friction == PAPER_FRICTION else "s--"
        label = f"{item.slope_deg:g}°, {item.friction[0]:g}/{item.friction[1]:g}"
        ax.semilogy(np.arange(1, len(values) + 1), values / values[0], style, color=BY_SLOPE.get(item.slope_deg, GREY), label=label)
    plain_log_labels(ax.yaxis)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.axvline(2.5, color=GREY, linestyle=":")
    ax.text(2.55, 0.5, "rank 2", color=GREY)
    ax.legend(title="slope, friction", fontsize=7)
    return figure


@mpl.rc_context(STYLE)
def dead_zone(rows: Sequence[Steered]) -> Figure:
    """Return yaw rate over belt difference, one colour per heading: simulated (marks) and quasi-static Coulomb friction (lines)."""
    figure, (ax,) = _figure(3.2, 1, "belt difference [m/s]", ("yaw rate towards straight [°/s]",), width_in=5.6)
    headings = sorted({row.heading_deg for row in rows})
    for heading, colour in zip(headings, BY_HEADING, strict=False):
        line = [row for row in rows if row.heading_deg == heading]
        apart = [row.difference_m_s for row in line]
        ax.plot(apart, [abs(row.theory_deg_s) for row in line], color=colour, linewidth=1.2)
        ax.plot(apart, [abs(row.yaw_rate_deg_s) for row in line], "o", color=colour, label=f"{heading:g}°")
    ax.set_yscale("symlog", linthresh=0.1)
    plain_log_labels(ax.yaxis)
    ax.legend(title="heading", fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


@mpl.rc_context(STYLE)
def straight(runs: Sequence[tuple[Straight, Series]]) -> Figure:
    """Return Fig. 9: heading and lateral place over time, open against closed loop."""
    figure, axes = _figure(3.2, 1, "time [s]", ("heading [°]", "lateral drift [m]"))
    for row, series in runs:
        style, label = "-" if row.loop == "closed" else "--", f"{row.slope_deg:g}° {row.loop}"
        for ax, values in zip(axes, (series["heading_deg"], series["y_m"] - series["y_m"][0]), strict=True):
            ax.plot(series["t_s"], values, style, color=BY_SLOPE.get(row.slope_deg, GREY), label=label, linewidth=1.2)
    axes[0].legend(ncols=2, fontsize=7)
    return figure


@mpl.rc_context(STYLE)
def turns(runs: Sequence[tuple[Turn, Series]]) -> Figure:
    """Return Fig. 10: heading from two starts, belt speeds and distance up the flight."""
    labels = ("heading [°]", "heading [°]", "belt speed [m/s]", "distance up the flight [m]")
    figure, axes = _figure(5.0, 2, "time [s]", labels)
    for ax in axes[len(runs) : 2]:
        ax.set_visible(False)
    for (row, series), ax in zip(runs, axes[:2], strict=False):
        ax.plot(series["t_s"], series["heading_deg"], color=BLUE, label="heading (truth)")
        ax.plot(series["t_s"], series["estimate_deg"], ":", color=ORANGE, label="heading (estimate)")
        ax.set_title(f"start at {row.start_heading_deg:+.0f}°" + ("" if row.verdict in COMPLETED else f", {row.verdict}"))
        ax.axhspan(-2.0, 2.0, color=GREY, alpha=0.15)
        ax.legend()
    for (row, series), colour in zip(runs, (BLUE, RED), strict=False):
        early, start = series["t_s"] <= TURN_SHOWN_S, f"{row.start_heading_deg:+.0f}°"
        t = series["t_s"][early]
        axes[2].step(t, series["left_m_s"][early], where="post", color=colour, label=f"{start} left")
        axes[2].step(t, series["right_m_s"][early], "--", where="post", color=colour, label=f"{start} right")
        axes[3].plot(t, series["x_m"][early] - series["x_m"][0], color=colour, label=start)
    axes[2].legend(ncols=2, fontsize=7)
    axes[3].legend()
    return figure


@mpl.rc_context(STYLE)
def table_two(rows: Sequence[Cell], allowed: Sequence[Cell]) -> Figure:
    """Return Table II as bars on Table I's friction: the paper's, ours, and ours with roll-back allowed."""
    rows = [cell for cell in rows if cell.friction == PAPER_FRICTION]
    figure, axes = _figure(3.0, 1, "slope, start heading", ("RMS heading [°]", "largest roll-back [m]"))
    place = np.arange(len(rows))
    by_start = {(cell.slope_deg, cell.start_heading_deg): cell for cell in allowed}
    sliding = [by_start.get((cell.slope_deg, cell.start_heading_deg)) for cell in rows]
    axes[0].bar(place - 0.27, np.array([cell.paper_deg for cell in rows], dtype=float), 0.25, color=GREY, label="paper")
    groups: tuple[tuple[str, Sequence[Cell | None], str], ...] = (
        ("climb-safe", rows, BLUE),
        *([("roll-back allowed", sliding, ORANGE)] if any(sliding) else []),
    )
    for k, (name, cells, colour) in enumerate(groups):
        height = np.array([cell.rms_heading_deg if cell else None for cell in cells], dtype=float)
        spread = [(cell.sd or 0.0) if cell else 0.0 for cell in cells]
        back = np.array([cell.roll_back_m if cell else None for cell in cells], dtype=float)
        axes[0].bar(place + 0.27 * k, height, 0.25, yerr=spread, color=colour, label=f"ours, {name}")
        axes[1].bar(place + 0.3 * (k - 0.5), back, 0.28, color=colour, label=f"ours, {name}")
    for ax in axes:
        ax.set_xticks(place, [f"{cell.slope_deg:g}°\n{cell.start_heading_deg:+g}°" for cell in rows])
        ax.margins(y=0.4)
        ax.legend(fontsize=7, loc="upper left")
    return figure


@mpl.rc_context(STYLE)
def seat(series: Series) -> Figure:
    """Return Fig. 11: the seat's pitch from the flight's slope to level."""
    figure, axes = _figure(2.8, 1, "time [s]", ("pitch [°]", "seat pitch, first 5 s [°]"))
    axes[0].plot(series["t_s"], series["seat_pitch_deg"], color=BLUE, label="seat")
    axes[0].plot(series["t_s"], series["pitch_deg"], "--", color=GREY, label="chassis")
    axes[0].legend()
    early = series["t_s"] <= 5.0
    axes[1].plot(series["t_s"][early], series["seat_pitch_deg"][early], color=BLUE)
    return figure


@mpl.rc_context(STYLE)
def margins(runs: Sequence[tuple[Turn, Series]]) -> Figure:
    """Return friction used over friction available, and the tip-over margin, which the paper does not show."""
    figure, axes = _figure(2.8, 1, "time [s]", ("friction used / available", "tip-over margin [°]"))
    for (row, series), colour in zip(runs, (BLUE, RED), strict=False):
        early = series["t_s"] <= TURN_SHOWN_S
        label = f"start {row.start_heading_deg:+.0f}°"
        axes[0].plot(series["t_s"][early], series["friction_use"][early], color=colour, label=label)
        axes[1].plot(series["t_s"][early], series["stability_margin_deg"][early], color=colour, label=label)
    axes[0].axhline(1.0, color=GREY, linestyle=":")
    axes[0].legend()
    return figure


PNG = b"\x89PNG\r\n\x1a\n"
STAGES = (
    "(a) depth image",
    "(b) Canny edges",
    "(c) edges without abrupt depth, lines",
    "(d) lines of near-zero slope",
    "(e) merged lines, most frequent slope",
    "(f) localisation",
)

R = TypeVar("R", Straight, Turn)


def write_reproduction_page(folder: Path, each: Callable[[str, Callable[[Any], Any], Sequence[Any]], list[Any]]) -> Path:
    """Write ``report.html`` of a reproduce folder, and a page of each of its runs that kept a log.

    Args:
        folder: Folder that a reproduction wrote.
        each: Receives the function that writes the page of a run, and the runs.

    Raises:
        SettingsError: If a file in it lacks or mistypes something.
    """
    results = read_part(folder / "results.json", Results)
    runs, stages = folder / "runs", _stages(folder / "figures")
    drawn = _drawn(results, runs)
    pages = [page for page in each("page of a run", _run_page, _pages(runs, _main_runs(results))) if page is not None]
    svg = {name: svg_of(figure) for name, figure in drawn.items()}
    return write_page(
        folder,
        "reproduce.html.j2",
        svg,
        {name: panels_of(figure) for name, figure in drawn.items()},
        r=results,
        answer=answer(results),
        rows={section: comparisons(results, section) for section in ("paper", "beyond", "machine")},
        pages=pages,
        lost=[name for name in _main_runs(results) if not _inside(runs, name).is_dir()],
        stages=stages,
        shown_s=IMPULSE_S,
        versions=json.dumps(results.versions),
    )


def _drawn(results: Results, runs: Path) -> dict[str, Figure]:
    """Return the figures of the parts that were measured, by name."""
    driven, turned = _with_series(runs, results.fig09), _with_series(runs, results.fig10[:2])
    drawn: dict[str, Figure] = {}
    if results.fig08 is not None:
        drawn["fig08"] = impulse(results.fig08.impulse)
        drawn["singular-values"] = singular_values(results.fig08.slopes)
    if results.dead_zone:
        drawn["dead-zone"] = dead_zone(results.dead_zone)
    if driven:
        drawn["fig09"] = straight(driven)
    if turned:
        drawn["fig10"], drawn["margins"] = turns(turned), margins(turned)
    if results.table2:
        drawn["table2"] = table_two(results.table2, results.table2_roll_back_allowed)
    if results.fig11 is not None and (folder := _inside(runs, results.fig11.run)).is_dir():
        drawn["fig11"] = seat(checked_series(folder))
    return drawn


def _main_runs(results: Results) -> list[str]:
    """Return the names of the runs that get a whole page: those behind the figures, and the traversals."""
    straight = [row.run for row in results.fig09 if row.slope_deg == paper.FIG10_SLOPE_DEG and row.loop == "closed"]
    turned = [row.run for row in results.fig10[:2]]
    seat = [results.fig11.run] if results.fig11 else []
    printed = [row.run for row in results.literal.runs if row.run is not None] if results.literal else []
    lugged = [row.run for row in results.lugs if not row.course.startswith("turn")]
    return [*straight, *turned, *seat, *printed, *lugged]


def _pages(runs: Path, main: Sequence[str]) -> list[tuple[Path, int | None]]:
    """Return the folders of the runs with a result and a log: those with a whole page, numbered, then those with a player."""
    others = sorted(path.name for path in runs.iterdir() if path.name not in main) if runs.is_dir() else []
    named = [*((name, number) for number, name in enumerate(main)), *((name, None) for name in others)]
    found = [(_inside(runs, name), number) for name, number in named]
    return [(path, number) for path, number in found if (path / LOG).is_file() and (path / "result.json").is_file()]


def _run_page(run: tuple[Path, int | None]) -> dict[str, Any] | None:
    """Write the page of a run; return name and side view of the link to it, or None for a log that cannot be read.

    Without a number the page is the player alone, at a fifth of the CPU time of a whole page, and the link has no side view. The
    figures of a run without page are those of results.json.
    """
    path, number = run
    unreadable = TreadlineError if number is None else LogFormatError
    try:
        recording = read_recording(path) if number is None else write_run_page(path)
    except unreadable:
        return None
    if number is None:
        write_player(recording, path / "report.html")
    view = None if number is None else _side_view(recording, path.name, number)
    played = {"verdict": recording.verdict or "", "duration_s": recording.duration_s}
    return {"name": path.name, "is_main": number is not None, "svg": view, **played}


def _side_view(recording: Recording, name: str, number: int) -> str | None:
    """Return a side view of a run at half of its time; None without poses."""
    if not recording.has_poses:
        return None
    views, t_s = SideViews(recording, f"run{number}"), 0.5 * recording.duration_s
    return Markup(views.definitions + views.view(t_s, f"Side view, {run_words(name)}, at {t_s:.0f} s"))  # noqa: S704 - drawn by this package


def _with_series(runs: Path, rows: Sequence[R]) -> list[tuple[R, Series]]:
    """Return the rows with their runs' series; a run whose folder is missing is left out."""
    return [(row, checked_series(_inside(runs, row.run))) for row in rows if _inside(runs, row.run).is_dir()]


def _inside(runs: Path, name: str) -> Path:
    """Return a run's folder, which must lie in ``runs`` also where it is a link."""
    path = runs / name
    if path.resolve().parent != runs.resolve():
        raise SettingsError(f"{path}: leads out of {runs}; a report is drawn from its own folder alone")
    return path


def _stages(folder: Path) -> list[tuple[str, str]]:
    found = []
    for number, caption in enumerate(STAGES, start=1):
        path = folder / f"fig05-{number}.png"
        if path.is_file():
            data = path.read_bytes()
            if not data.startswith(PNG):  # a link to some other file must not end up on a page that is passed on
                raise SettingsError(f"{path}: not a PNG picture; make the folder again")
            found.append((caption, f"data:image/png;base64,{in_base64(data)}"))
    return found
