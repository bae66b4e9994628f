"""Report page of a reproduction: one self-contained HTML file, drawn from the files of its folder.

The template engine escapes text; figures are inline SVG drawn by this package; a content security policy forbids requests and
scripts. The page links to the pages of the reproduction's runs, which play them.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from markupsafe import Markup
from matplotlib.figure import Figure

from treadline.core import paper
from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.io.runs import LOG
from treadline.playback import Recording, read_recording
from treadline.report import _reproduction_figures as figures
from treadline.report._html import in_base64
from treadline.report._results import Results, Straight, Turn, read_part
from treadline.report._run_page import checked_series, write_page, write_run_page
from treadline.report.comparison import comparisons
from treadline.report.player_page import write_player
from treadline.report.side_view import SideViews
from treadline.report.svg_figures import panels_of, svg_of

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


def write_reproduction_page(folder: Path) -> Path:
    """Write ``report.html`` of a reproduce folder, and a page of each of its runs that kept a log.

    Raises:
        SettingsError: If a file in it lacks or mistypes something.
    """
    results = read_part(folder / "results.json", Results)
    runs, stages = folder / "runs", _stages(folder / "figures")
    named = _main_runs(results)
    drawn = _drawn(results, runs)
    linked, cards = [], []
    for name in named:
        if (recording := _main_page(_inside(runs, name))) is not None:
            linked.append(name)
            cards += _card(name, recording, len(linked) - 1)
    others = _other_runs(runs, named)
    svg = {name: svg_of(figure) for name, figure in drawn.items()}
    return write_page(
        folder,
        "reproduce.html.j2",
        svg,
        {name: panels_of(figure) for name, figure in drawn.items()},
        r=results,
        rows=comparisons(results),
        linked=[*linked, *others],
        others=others,
        cards=cards,
        stages=stages,
        shown_s=figures.IMPULSE_SHOWN_S,
        versions=json.dumps(results.versions),
    )


def _drawn(results: Results, runs: Path) -> dict[str, Figure]:
    """Return the figures of the parts that were measured, by name."""
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
        drawn["fig11"] = figures.seat(checked_series(_inside(runs, results.fig11.run)))
    return drawn


def _main_runs(results: Results) -> list[str]:
    """Return the names of the runs that get a whole page: those behind the figures, and the traversals."""
    straight = [row.run for row in results.fig09 if row.slope_deg == paper.FIG10_SLOPE_DEG and row.loop == "closed"]
    turned = [row.run for row in results.fig10[:2]]
    seat = [results.fig11.run] if results.fig11 else []
    printed = [row.run for row in results.literal.runs if row.run is not None] if results.literal else []
    lugged = [row.run for row in results.lugs if not row.is_turn]
    return [*straight, *turned, *seat, *printed, *lugged]


def _main_page(folder: Path) -> Recording | None:
    """Write the whole page of a run; None for a run without result, or without a readable log: its figures are in results.json."""
    if not (folder / "result.json").is_file():
        return None
    try:
        return write_run_page(folder)
    except LogFormatError:
        return None


def _other_runs(runs: Path, named: Sequence[str]) -> list[str]:
    """Write a page that plays each further run with a log; return the names of the runs that have one.

    The page is the player alone, at a fifth of the CPU time of a run's whole page: ``treadline report`` makes that one.
    """
    played = []
    for path in sorted(runs.iterdir()) if runs.is_dir() else []:
        if path.name in named or not ((path / LOG).is_file() and (path / "result.json").is_file()):
            continue
        try:
            recording = read_recording(_inside(runs, path.name))
        except TreadlineError:
            continue  # a damaged log has no page; the figures are those of results.json
        write_player(recording, path / "report.html")
        played.append(path.name)
    return played


def _card(name: str, recording: Recording, number: int) -> list[dict[str, Any]]:
    """Return a side view of a run at half of its time, for the link to its player; nothing without poses."""
    if not recording.has_poses:
        return []
    views, t_s = SideViews(recording, f"run{number}"), 0.5 * recording.duration_s
    drawn = views.definitions + views.view(t_s, f"Side view of {name} at {t_s:.0f} s")
    verdict, duration_s = recording.verdict or "", recording.duration_s
    return [{"name": name, "svg": Markup(drawn), "verdict": verdict, "duration_s": duration_s}]  # noqa: S704 - drawn by this package


def _with_series(runs: Path, rows: Sequence[R]) -> list[tuple[R, figures.Series]]:
    return [(row, checked_series(_inside(runs, row.run))) for row in rows]


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
