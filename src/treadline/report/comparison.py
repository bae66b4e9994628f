"""Table of the reproduction's figures: our figure, the paper's figure, the target and the verdict.

The summary of the report page, the README's table and ``docs/evidence/results.json`` are rows of the table in
``data/reproduction_figures.toml``, computed from one ``results.json``; ``benchmarks/publish.py`` writes the last two.
"""

import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.io.runs import COMPLETED
from treadline.report._results import PAPER_FRICTION, BeltRun, Cell, Moves, Results, Straight
from treadline.report.labels import suffix
from treadline.scenario.shipped_files import DATA

REACHED, NO_TARGET, QUICK = "reached", "–", "quick run: not judged"
TABLE_SLOPES = {float(slope) for slope, _ in paper.TABLE_II}
RMS_TARGETS = {0.62: 2.3, 0.9: 2.0}
"""Target RMS heading over 80 s from ±30°, average of the slopes [deg], by friction along the belt."""
ROLL_BACK_TARGETS = {25: 0.02, 28: 0.05, 30: 0.15}
"""Largest accepted roll-back [m] with Table I's friction, by slope [deg]."""
IDENTIFIABLE_VAF = 50.0
"""VAF of the yaw rate [%] below which a record holds more noise than motion: the dead zone."""
TILT_DEG = 0.5
"""Gravity error of the IMU for which the steady targets are set."""
PUBLISHED_SEEDS = 5
"""Seeds of Table II in published figures. The RMS headings of five seeds differ by 0.01 to 0.04°; two show the figure."""
SMOOTH_BELT = "none"
"""Lug of a smooth belt, as a scenario names it."""

Values = dict[str, Any]
"""Values of one group of results, by name; ``part`` is the first part of the group's keys in the uncertainty budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """Entry of the table; texts are templates, filled with the values of a group of results."""

    label: str
    of: str
    """Name of the value: a number, or a text that has no target."""
    unit: str = ""
    paper: str = "–"
    target: float | str | None = None
    """Largest accepted value, or the name of the group's value that holds it."""
    at_least: bool = False
    """Whether the target is the smallest accepted value."""
    conditions: str = "{conditions}"
    from_runs: bool = True
    """Whether the figure depends on the duration of the runs: a quick run does not judge it."""
    headline: bool = False
    """Whether the entry is a row of the README, not of the summary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRow:
    """One row of the summary or of the README."""

    figure: str
    paper: str
    ours: str
    conditions: str
    target: str = "–"
    verdict: str = NO_TARGET
    """``reached``, ``missed by …``, ``–`` without a target, or that a quick run is not judged."""
    sensitivity: str = ""
    """Change of the figure with step size, stiffness and friction, in words; empty where it was not measured."""


TABLE = {
    kind: tuple(Figure(**entry) for entry in entries)
    for kind, entries in tomllib.loads((DATA / "reproduction_figures.toml").read_text(encoding="utf-8")).items()
}
"""Figures by the kind of group that they are computed from, in the order of ``_groups``."""


def comparisons(results: Results, *, headline: bool = False) -> list[FigureRow]:
    """Return all rows of the summary, or those of the README; a part that was not measured has none.

    The targets hold for whole runs: a figure of a shortened run is shown next to its target without a verdict.
    """
    return [
        _row(entry, values, results) for kind, values in _groups(results) for entry in TABLE[kind] if entry.headline is headline
    ]


def moves_text(moves: Moves) -> str:
    """Return the changes of a figure as words, with the variations that lose the figure or its target."""
    sources = ((moves.step, "step size"), (moves.stiffness, "stiffness"), (moves.friction, "friction ±20 %"))
    known = ", ".join(f"±{_two_digits(value)}{suffix(moves.unit)} with {source}" for value, source in sources if value is not None)
    where = f" ({moves.conditions})" if moves.conditions else ""
    lists = (("no figure with", moves.lost), ("margin exceeded with", moves.exceeded), ("target missed with", moves.missed))
    return "; ".join([*([f"{known}{where}"] if known else []), *(f"{text} {', '.join(names)}" for text, names in lists if names)])


# ---- one row ----


def _row(entry: Figure, values: Values, results: Results) -> FigureRow:
    """Return an entry evaluated on a group of results; an absent number misses every target."""
    value, target = values[entry.of], values[entry.target] if isinstance(entry.target, str) else entry.target
    moves = None if results.quick else results.sensitivity.get(f"{values.get('part', '')}/{entry.of}")
    known = value is not None and (isinstance(value, str) or math.isfinite(value))
    row = {
        "figure": entry.label.format_map(values),
        "paper": entry.paper.format_map(values),
        "ours": "none" if not known else value if isinstance(value, str) else _written(value, entry.unit),
        "conditions": entry.conditions.format_map(values),
        "sensitivity": "" if moves is None else moves_text(moves),
    }
    if target is None:
        return FigureRow(**row)
    gap = None if not known else target - value if entry.at_least else value - target
    if results.quick and entry.from_runs:
        verdict = QUICK
    elif values.get("early"):
        verdict = "missed: a run ended early"
    elif gap is None:
        verdict = "missed"
    else:
        verdict = REACHED if gap <= 0.0 else f"missed by {_rounded(gap, 2)}{suffix(entry.unit)}"
    return FigureRow(**row, target=f"{'≥' if entry.at_least else '≤'} {target:g}{suffix(entry.unit)}", verdict=verdict)


def _written(value: float, unit: str) -> str:
    """Return a value with three digits, a length to the millimetre."""
    return (f"{value:.3f}" if unit == "m" else _rounded(value, 3)) + suffix(unit)


def _rounded(value: float, digits: int) -> str:
    """Return a value with some digits, or as an integer from 100 on: never in exponential form above 1."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.{digits}g}"


def _two_digits(value: float) -> str:
    """Return a value with two digits, without an exponent; below 0.001 it is 0.000."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}" if value >= 0.001 else f"{value:.3f}"


# ---- groups of results ----


def _groups(results: Results) -> Iterator[tuple[str, Values]]:
    """Yield kind and values of each group of results, in the order of the rows."""
    if (printed := results.literal) is not None:
        asked = f"{max(printed.asked_m_s, key=abs):.2f} m/s"
        yield "literal", {"gap": printed.max_gap_to_print, "asked": asked, "limit": printed.max_speed_m_s}
    if (seen := results.fig05) is not None:
        robust, printed_ = ("none" if a is None else f"{a:.2f}°" for a in (seen.robust_heading_deg, seen.heading_deg))
        values = {"robust_heading_deg": robust, "printed": printed_, "true": seen.true_heading_deg}
        yield "fig05", {"part": "fig05/28", "conditions": seen.conditions, **values}
    yield from _table_two(results)
    yield from _straight(results.fig09)
    yield from _models(results)
    if (seat := results.fig11) is not None:
        error = abs(seat.steady_error_deg)
        settling = "does not settle" if seat.settle_s is None else f"settles in {seat.settle_s:.1f} s"
        values = {"steady_error_deg": error, "settling": f"{error:.3f}°, {settling}", "conditions": seat.conditions}
        yield "fig11", {"part": "fig11/28", **values}
    yield from _whole_traversals([run for run in results.lugs if not run.is_turn])
    if (speed := results.speed) is not None:
        yield "speed", {"physics": speed.physics_real_time_factor, "loop": speed.loop_cpu_s_per_s}
    if results.wall_s is not None:
        what, limit = ("reproduce --quick", 100.0) if results.quick else ("reproduce", 430.0)
        yield "wall clock", {"what": what, "wall_s": results.wall_s, "limit": limit}


def _table_two(results: Results) -> Iterator[tuple[str, Values]]:
    for along, across in sorted({tuple(cell.friction) for cell in results.table2}):
        cells = [cell for cell in results.table2 if cell.friction == [along, across]]
        on_paper = cells[0].friction == PAPER_FRICTION
        slopes = sorted({cell.slope_deg for cell in cells})
        common = {"friction": f"friction {along:g}/{across:g}", "part": f"table2/{along:g}-{across:g}"}
        for start in sorted({cell.start_heading_deg for cell in cells})[::-1]:
            yield "table2, start", common | _average([cell for cell in cells if cell.start_heading_deg == start], start)
        for slope in slopes:
            here = [cell for cell in cells if cell.slope_deg == slope]
            target = ROLL_BACK_TARGETS.get(int(slope)) if slope.is_integer() and on_paper else None
            yield "table2, slope", common | {"part": f"{common['part']}/{slope:g}", "back_target": target} | _worst(here)
        yield from ((kind, common | values) for kind, values in (*_comfort(cells), *_steady(cells, results.gravity_error_deg)))
        if on_paper:
            yield from _lug_groups(results.lugs)
            yield from _published_turns(cells, slopes)
    if results.table2_roll_back_allowed:
        yield "table2_roll_back_allowed", _allowed(results.table2_roll_back_allowed)


def _means(cells: Sequence[Cell]) -> Values:
    """Return the means of some cells over their slopes; a cell whose runs all ended early has none."""
    headings = [cell.rms_heading_deg for cell in cells if cell.rms_heading_deg is not None]
    yaws = [cell.rms_yaw_deg for cell in cells if cell.rms_yaw_deg is not None]
    slopes = sorted({cell.slope_deg for cell in cells if cell.rms_heading_deg is not None})
    return {
        "slopes": _listed(slopes) or "no slope",
        "rms_heading_deg": float(np.mean(headings)) if headings else None,
        "yaw": f"{np.mean(yaws):.2f}°" if yaws else "–",
        "conditions": cells[0].conditions + _early(cells),
        "early": sum(len(cell.ended_early) for cell in cells),
    }


def _early(cells: Sequence[Cell]) -> str:
    """Return the runs that ended early, for the conditions of a row."""
    ends = [f"{cell.slope_deg:g}°, {cell.start_heading_deg:+g}°, {end}" for cell in cells for end in cell.ended_early]
    return f"; ended early and not averaged: {'; '.join(ends)}" if ends else ""


def _average(cells: Sequence[Cell], start_deg: float) -> Values:
    """Return the means from one start; paper and target are those of the three slopes of Table II."""
    values = {"start": start_deg, **_means(cells)}
    if {cell.slope_deg for cell in cells} != TABLE_SLOPES or abs(start_deg) != 30.0:
        return {**values, "part": "", "printed": "–", "rms_target": None}
    return {
        **values,
        "printed": f"{paper.TABLE_II_AVERAGE[int(start_deg)]}°",
        "rms_target": RMS_TARGETS.get(cells[0].friction[0]),
    }


def _worst(cells: Sequence[Cell]) -> Values:
    """Return roll-back and settling time of the worst start on one slope."""
    times = [cell.settle_s for cell in cells]
    starts = sorted({cell.start_heading_deg for cell in cells})[::-1]
    return {
        "slope": cells[0].slope_deg,
        "roll_back_m": max(cell.roll_back_m for cell in cells),
        "settle_s": None if None in times else max(time for time in times if time is not None),
        "printed_settling": "10–20 s (Fig. 10)" if cells[0].slope_deg == paper.FIG10_SLOPE_DEG else "–",
        "starts": ", ".join(f"{start:+g}°" for start in starts),
        "conditions": cells[0].conditions + _early(cells),
    }


def _comfort(cells: Sequence[Cell]) -> Iterator[tuple[str, Values]]:
    known = [cell for cell in cells if cell.passenger_m_s2 is not None]
    if known:
        worst = max(known, key=lambda cell: cell.passenger_m_s2 or 0.0)
        parts = (worst.vertical_m_s2, worst.longitudinal_m_s2, worst.lateral_m_s2)
        split = "" if None in parts else "; vertical {:.2f}, longitudinal {:.2f}, lateral {:.2f} m/s²".format(*parts)
        values = {"passenger_m_s2": worst.passenger_m_s2, "slope": worst.slope_deg, "split": split}
        yield "table2, comfort", {**values, "conditions": worst.conditions}


def _steady(cells: Sequence[Cell], tilt_deg: float) -> Iterator[tuple[str, Values]]:
    means = [cell.steady_rms_heading_deg for cell in cells if cell.steady_rms_heading_deg is not None]
    worst = [cell.worst_steady_rms_heading_deg for cell in cells if cell.worst_steady_rms_heading_deg is not None]
    if means and worst:
        # On Table I's friction the dead zone leaves the heading where the turn ended, so no target is set.
        meant = tilt_deg == TILT_DEG and cells[0].friction != PAPER_FRICTION
        targets = {"mean_target": 0.12 if meant else None, "worst_target": 0.2 if meant else None}
        yield "table2, steady", {"steady_rms_heading_deg": float(np.mean(means)), "worst": max(worst), "tilt": tilt_deg, **targets}


def _allowed(cells: Sequence[Cell]) -> Values:
    whole = {cell.slope_deg for cell in cells} == TABLE_SLOPES
    return {
        "part": "table2_roll_back_allowed/28",
        **_means(cells),
        "back": max(cell.roll_back_m for cell in cells),
        "rms_target": 2.4 if whole else None,
        "printed": f"{np.mean(list(paper.TABLE_II_AVERAGE.values())):.2f}°" if whole else "–",
    }


def _published_turns(cells: Sequence[Cell], slopes: Sequence[float]) -> Iterator[tuple[str, Values]]:
    """Yield the cells of each slope and the worst turns of all, slopes and starts side by side."""
    worst = []
    for slope in slopes:
        here = sorted((cell for cell in cells if cell.slope_deg == slope), key=lambda cell: -cell.start_heading_deg)
        worst.append(_worst(here))
        sides = {
            "starts": " / ".join(f"{cell.start_heading_deg:+g}°" for cell in here),
            "printed": " / ".join("–" if cell.paper_deg is None else f"{cell.paper_deg:g}°" for cell in here),
            "rms": " / ".join("–" if cell.rms_heading_deg is None else f"{cell.rms_heading_deg:.2f}°" for cell in here),
        }
        yield "table2, cells", {"slope": slope, "conditions": here[0].conditions + _early(here), **sides}
    settled = ("never" if turn["settle_s"] is None else f"{turn['settle_s']:.1f}" for turn in worst)
    back = " / ".join(f"{turn['roll_back_m']:.3f}" for turn in worst)
    at = " / ".join(f"{slope:g}°" for slope in slopes)
    yield "table2, turns", {"at": at, "back": f"{back} m", "settled": f"{' / '.join(settled)} s"}
    for _, values in _comfort(cells):
        yield "table2, passenger", {"most": _written(values["passenger_m_s2"], "m/s²")}


def _lug_groups(runs: Sequence[BeltRun]) -> Iterator[tuple[str, Values]]:
    """Yield comfort and roll-back with lugs next to those with smooth belts: turns by slope, then whole traversals."""
    turns, whole = ([run for run in runs if run.is_turn is turn] for turn in (True, False))
    slopes = sorted({run.slope_deg for run in turns})
    by_slope = [([run for run in turns if run.slope_deg == slope], f" in the turn at {slope:g}°") for slope in slopes]
    courses = sorted({run.course for run in whole})
    by_course = [([run for run in whole if run.course == course], f", {course}") for course in courses]
    for kind, score, unit in (("lugs, roll-back", "roll_back_m", "m"), ("lugs, passenger", "passenger_m_s2", "m/s²")):
        yield from ((kind, values) for here, where in by_slope for values in _lugged(here, where, score, unit))
    for here, where in by_course:
        yield from (("lugs, passenger", values) for values in _lugged(here, where, "passenger_m_s2", "m/s²"))
        yield from (("lugs, pitch", values) for values in _lugged(here, where, "pitch_rate_deg_s", "°/s"))


def _lugged(runs: Sequence[BeltRun], where: str, score: str, unit: str) -> Iterator[Values]:
    """Yield a score with lugs of nominal rubber, the rubber's stiffness bracketed; nothing without smooth belts or without lugs."""
    smooth = [run for run in runs if run.lug == SMOOTH_BELT]
    lugged = sorted((run for run in runs if run.lug != SMOOTH_BELT), key=lambda run: run.rubber_s or 0.0)
    if not smooth or not lugged:
        return
    nominal, values = lugged[len(lugged) // 2], [getattr(run, score) for run in lugged]
    bracket = f"{_written(min(values), unit)} to {_written(max(values), unit)} with rubber of "
    bracket += f"{lugged[0].rubber_s:g} to {lugged[-1].rubber_s:g} s; " if len(lugged) > 1 else ""
    ended = [run for run in (*smooth, *lugged) if run.verdict not in COMPLETED]
    yield {
        "part": f"lugs/{nominal.course}",
        "slope": nominal.slope_deg,
        "where": where,
        "lug": nominal.lug,
        score: getattr(nominal, score),
        "back_target": ROLL_BACK_TARGETS.get(int(nominal.slope_deg)),
        "smooth": _written(getattr(smooth[0], score), unit),
        "bracket": bracket if len(lugged) > 1 else "",
        "duration": nominal.duration_s,
        "seed": nominal.seed,
        "ended": "".join(f"; {run.run}: {run.verdict} ({run.cause})" for run in ended),
    }


def _whole_traversals(runs: Sequence[BeltRun]) -> Iterator[tuple[str, Values]]:
    smooth, lugged = ([run for run in runs if (run.lug == SMOOTH_BELT) is flat] for flat in (True, False))
    if smooth and lugged:
        one, other = smooth[0], lugged[0]
        both = f"{one.passenger_m_s2:.2g} / {other.passenger_m_s2:.2g} m/s²"
        verdicts = f"{one.verdict} / {other.verdict}"
        yield "lugs", {"course": one.course, "lug": other.lug, "both": both, "verdicts": verdicts, "seed": one.seed}


def _straight(runs: Sequence[Straight]) -> Iterator[tuple[str, Values]]:
    closed, opened = ([run for run in runs if run.loop == loop] for loop in ("closed", "open"))
    if closed:
        rms, lateral = max(run.rms_heading_deg for run in closed), max(run.lateral_m for run in closed)
        conditions = f"{_span(closed)}, worst of {_listed([run.slope_deg for run in closed])}"
        values = {"rms_heading_deg": rms, "lateral_m": lateral, "conditions": conditions}
        yield "fig09, closed", {"part": "fig09/28", **values}
    if opened:
        final = ", ".join(f"{round(run.final_heading_deg, 2) + 0.0:g}°" for run in opened)
        largest, drift = max(run.max_abs_heading_deg for run in opened), max(run.lateral_m for run in opened)
        at = _listed([run.slope_deg for run in opened])
        conditions = f"{_span(opened)}; at {at}; largest heading {largest:.2g}°, drift {drift:.2g} m"
        yield "fig09, open", {"part": "fig09_open/28", "final_heading_deg": final, "conditions": conditions}
    if closed and opened:
        both = f"{rms:.2f}°, {_written(lateral, 'm')}"
        both += f" (open loop: {max(run.rms_heading_deg for run in opened):.1f}°, {drift:.1f} m)"
        yield "fig09", {"both": both, "duration": closed[0].duration_s}


def _span(runs: Sequence[Straight]) -> str:
    early = "".join(f"; {run.run} ended early: {run.verdict}" for run in runs if run.verdict not in COMPLETED)
    return f"{max(run.duration_s for run in runs):.0f} s, right belt 2 % faster, seed {runs[0].seed}{early}"


def _models(results: Results) -> Iterator[tuple[str, Values]]:
    if results.fig08 is None:
        return
    for item in results.fig08.slopes:
        along, across = item.friction
        ground = f"{item.slope_deg:g}" + ("" if item.friction == PAPER_FRICTION else f"-mu{along:g}-{across:g}")
        kind = "fig08, slope" if item.yaw_rate_vaf_percent >= IDENTIFIABLE_VAF else "fig08, dead zone"
        at, share = f"at {item.slope_deg:g}°, friction {along:g}/{across:g}", f"{item.yaw_rate_vaf_percent:.0f} %"
        yield kind, {"part": f"fig08/{ground}", "at": at, "share": share, **item.model_dump()}
    main = results.fig08
    share = f"{main.yaw_rate_vaf_percent:.0f} %"
    yield "fig08", {"slope": main.slope_deg, "share": share, "conditions": main.conditions}


def _listed(degrees: Sequence[float]) -> str:
    return ", ".join(f"{value:g}°" for value in degrees)
