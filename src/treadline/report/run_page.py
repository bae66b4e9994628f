"""Report pages: self-contained HTML files, drawn from the files of a folder.

The template engine escapes text; figures are inline SVG drawn by this package; a content security policy forbids requests, and
scripts except the player's, by its hash. The report of a reproduction links to the pages of its main runs, which play them.
"""

import base64
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from treadline.core import paper
from treadline.core.errors import SettingsError, TreadlineError
from treadline.core.models import write_whole
from treadline.core.printing import p_text
from treadline.io.runs import LOG, read_series
from treadline.playback import Recording, read_recording
from treadline.report import svg_figures as figures
from treadline.report.compare import comparisons
from treadline.report.film_strip import film_strip
from treadline.report.headline import headline
from treadline.report.motion import read_motion
from treadline.report.player_page import embedded, environment, player_data, write_player
from treadline.report.recorded_series import recording_of
from treadline.report.results import Manifest, Results, RunResult, Straight, Turn, read_part
from treadline.report.run_figure import single_run
from treadline.report.score_labels import score_groups
from treadline.report.side_view import SideViews

PNG = b"\x89PNG\r\n\x1a\n"
LARGEST_RATIO = 100_000
"""Ratio of singular values beyond which the smaller one is a rounding error of the data."""
STAGES = (
    "(a) depth image",
    "(b) Canny edges",
    "(c) edges without abrupt depth, lines",
    "(d) lines of near-zero slope",
    "(e) merged lines, most frequent slope",
    "(f) localisation",
)
COLUMNS = (
    "t_s",
    "heading_deg",
    "estimate_deg",
    "pitch_deg",
    "seat_pitch_deg",
    "stability_margin_deg",
    "left_m_s",
    "right_m_s",
    "x_m",
    "y_m",
    "friction_use",
)
"""Columns of series.csv that the figures draw."""


R = TypeVar("R", Straight, Turn)


def write_report(folder: Path) -> Path:
    """Write ``report.html`` of a reproduce folder and of its main runs, or of one run's folder.

    Raises:
        SettingsError: If the folder holds neither, or a file in it lacks or mistypes something.
    """
    if (folder / "results.json").exists():
        return _whole(folder)
    if (folder / "result.json").exists():
        return _single(folder)
    if (folder / "journal.jsonl").exists():
        there = "its report.html is there" if (folder / "report.html").exists() else "treadline sweep --resume finishes it"
        raise SettingsError(f"{folder}: a sweep's folder; {there}")
    if (folder / "manifest.json").exists():
        raise SettingsError(f"{folder}: no result.json: this run was interrupted, or goes on; make it again to report it")
    raise SettingsError(f"{folder}: no results.json (reproduce) and no result.json (climb, excite); nothing to report")


def _whole(folder: Path) -> Path:
    results = read_part(folder / "results.json", Results)
    runs, stages = folder / "runs", _stages(folder / "figures")
    linked = _linked_runs(runs, results)
    straight, turned = _with_series(runs, results.fig09), _with_series(runs, results.fig10[:2])
    drawn: dict[str, Figure] = {}
    if results.fig08 is not None:
        drawn["fig08"] = figures.impulse(results.fig08.impulse)
        drawn["singular-values"] = figures.singular_values(results.fig08.slopes)
    if results.dead_zone:
        drawn["dead-zone"] = figures.dead_zone(results.dead_zone)
    if straight:
        drawn["fig09"] = figures.straight(straight)
    if turned:
        drawn["fig10"], drawn["margins"] = figures.turns(turned), figures.margins(turned)
    if results.table2:
        drawn["table2"] = figures.table_two(results.table2, results.table2_roll_back_allowed)
    if results.fig11 is not None:
        drawn["fig11"] = figures.seat(_series(_inside(runs, results.fig11.run)))
    others = _other_runs(runs, linked)
    cards = [_card(name, _run_page(_inside(runs, name)), number) for number, name in enumerate(linked)]
    return _render(
        folder,
        "reproduce.html.j2",
        drawn,
        panelled=True,
        r=results,
        rows=comparisons(results),
        linked=[*linked, *others],
        others=others,
        cards=[card for card in cards if card is not None],
        stages=stages,
        shown_s=figures.IMPULSE_SHOWN_S,
        versions=json.dumps(results.versions),
    )


def _other_runs(runs: Path, linked: Sequence[str]) -> list[str]:
    """Write a page that plays each further run with a log; return the names of the runs that have one.

    The page is the player alone, at a fifth of the CPU time of a run's whole page: ``treadline report`` makes that one.
    """
    played = []
    for path in sorted(runs.iterdir()) if runs.is_dir() else []:
        if path.name in linked or not ((path / LOG).is_file() and (path / "result.json").is_file()):
            continue
        try:
            recording = read_recording(_inside(runs, path.name))
        except TreadlineError:
            continue  # a damaged log has no page; the figures are those of results.json
        write_player(recording, path / "report.html")
        played.append(path.name)
    return played


def _card(name: str, recording: Recording, number: int) -> dict[str, Any] | None:
    """Return a side view of a run at half of its time, for the link to its player; None without poses."""
    if not recording.has_poses:
        return None
    views, t_s = SideViews(recording, f"run{number}"), 0.5 * recording.duration_s
    drawn = views.definitions + views.view(t_s, f"Side view of {name} at {t_s:.0f} s")
    return {"name": name, "svg": Markup(drawn), "verdict": recording.verdict or "", "duration_s": recording.duration_s}  # noqa: S704 - drawn by this package


def _single(folder: Path) -> Path:
    _run_page(folder)
    return folder / "report.html"


def _run_page(folder: Path) -> Recording:
    """Write the page of a run; return its recording."""
    result = read_part(folder / "result.json", RunResult)
    manifest = read_part(folder / "manifest.json", Manifest)
    if result.seed is not None and result.seed != manifest.seed:
        raise SettingsError(f"{folder}: result.json is of seed {result.seed}, manifest.json of {manifest.seed}; make the run again")
    series, (motion, unread) = _series(folder), read_motion(folder)
    recording = recording_of(folder, series, result)
    data = player_data(recording)
    _render(
        folder,
        "run.html.j2",
        {"run": single_run(series, result, motion)},
        player=embedded(data, recording),
        missing=recording.missing,
        strip=film_strip(recording, data["images"]) if recording.has_poses else None,
        result=result,
        manifest=manifest,
        headline=headline(result, manifest, folder.name),
        groups=score_groups(result),
        moved=motion is not None,
        unread=unread,
        banded=len(result.course) > 1,
        settings=json.dumps(manifest.settings, indent=1),
    )
    return recording


def _linked_runs(runs: Path, results: Results) -> list[str]:
    """Return the names of the runs that get a page of their own: those behind the figures, and the traversals."""
    straight = [row.run for row in results.fig09 if row.slope_deg == paper.FIG10_SLOPE_DEG and row.loop == "closed"]
    turned = [row.run for row in results.fig10[:2]]
    seat = [results.fig11.run] if results.fig11 else []
    printed = [row.run for row in results.literal.runs if row.run is not None] if results.literal else []
    lugged = [row.run for row in results.lugs if not row.is_turn]
    return [name for name in (*straight, *turned, *seat, *printed, *lugged) if (_inside(runs, name) / "result.json").exists()]


def _with_series(runs: Path, rows: Sequence[R]) -> list[tuple[R, figures.Series]]:
    return [(row, _series(_inside(runs, row.run))) for row in rows]


def _inside(runs: Path, name: str) -> Path:
    """Return a run's folder, which must lie in ``runs`` also where it is a link."""
    path = runs / name
    if path.resolve().parent != runs.resolve():
        raise SettingsError(f"{path}: leads out of {runs}; a report is drawn from its own folder alone")
    return path


def _series(folder: Path) -> figures.Series:
    """Return the columns of a run's series.csv, checked.

    Raises:
        SettingsError: If it is missing, is not a table, or lacks a column.
    """
    path = folder / "series.csv"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns of a table without rows
            series = read_series(folder)
    except OSError as error:
        raise SettingsError(f"{path}: {error.strerror}") from None
    except (ValueError, IndexError, UserWarning) as error:
        said = " ".join(str(error).split())[:80]
        raise SettingsError(f"{path}: not a table of numbers ({said}); make the run again") from None
    missing = [name for name in COLUMNS if name not in series]
    if missing:
        raise SettingsError(f"{path}: no column '{missing[0]}'; make the run again")
    if not np.isfinite(series["t_s"]).all():
        raise SettingsError(f"{path}: a time in t_s is not a number; make the run again")
    return series


def _render(folder: Path, template: str, drawn: dict[str, Figure], *, panelled: bool = False, **values: Any) -> Path:
    texts = {name: figures.svg_of(figure) for name, figure in drawn.items()}
    panels = {name: figures.panels_of(figure) if panelled else [texts[name]] for name, figure in drawn.items()}
    page = page_of(template, panels, **values)
    for name, text in texts.items():
        write_whole(folder / "figures" / f"{name}.svg", '<?xml version="1.0" encoding="utf-8"?>\n' + text)
    path = folder / "report.html"
    write_whole(path, page)
    return path


def page_of(template: str, drawings: Mapping[str, Sequence[str]], **values: Any) -> str:
    """Return a page: a template with drawings (name → SVG of each panel) inline and every other value escaped."""
    engine = environment()
    filters: dict[str, Callable[..., str]] = {"number": _number, "degrees": "{:g}°".format, "p_value": p_text, "ratio": ratio}
    engine.filters.update(filters)
    inline = {
        # The package's own drawings, in which text is paths, are the only markup that is not escaped.
        name: Markup("".join(_inlined(text, f"{name}-{k}") for k, text in enumerate(panels)))  # noqa: S704
        for name, panels in drawings.items()
    }
    return engine.get_template(template).render(svg=inline, **values)


def _inlined(svg: str, name: str) -> str:
    """Return an SVG for a page: its ids prefixed, so that drawings do not share definitions; no namespaces, HTML has them."""
    for old, new in (
        (' xmlns="http://www.w3.org/2000/svg"', ""),
        (' xmlns:xlink="http://www.w3.org/1999/xlink"', ""),
        ("xlink:href", "href"),
        (' id="', f' id="{name}-'),
        ("url(#", f"url(#{name}-"),
        ('href="#', f'href="#{name}-'),
    ):
        svg = svg.replace(old, new)
    return svg


def _stages(folder: Path) -> list[tuple[str, str]]:
    found = []
    for number, caption in enumerate(STAGES, start=1):
        path = folder / f"fig05-{number}.png"
        if path.is_file():
            data = path.read_bytes()
            if not data.startswith(PNG):  # a link to some other file must not end up on a page that is passed on
                raise SettingsError(f"{path}: not a PNG picture; make the folder again")
            found.append((caption, "data:image/png;base64," + base64.b64encode(data).decode()))
    return found


def ratio(value: float) -> str:
    """Return a ratio of singular values; beyond ``LARGEST_RATIO`` the smaller one is a rounding error."""
    return f"> {LARGEST_RATIO:g}" if value > LARGEST_RATIO else f"{value:.1f}"


def _number(value: float | None, digits: int = 2, unit: str = "") -> str:
    return "–" if value is None else f"{round(value, digits) + 0.0:.{digits}f}{unit}"
