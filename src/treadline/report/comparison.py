"""Table of the reproduction's figures: our figure, the paper's figure, the target with its source, and the verdict.

The tables of the report page, the README's table and ``docs/evidence/results.json`` are rows of the table in
``data/reproduction_figures.toml``, computed from one ``results.json``; ``benchmarks/publish.py`` writes the last two. The paper's
own items come in the paper's order. The answer of the page, three sentences, follows from their verdicts.
"""

import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.core.files import DATA
from treadline.io.runs import COMPLETED
from treadline.report._results import PAPER_FRICTION, Cell, Moves, PrintedController, Results, Straight
from treadline.report.labels import run_words, suffix

REACHED, NO_TARGET = "reached", "–"
REPRODUCED, NOT_REPRODUCED = "reproduced", "not reproduced"
TABLE_SLOPES = {float(slope) for slope, _ in paper.TABLE_II}
RMS_TARGETS = {0.62: 2.3, 0.9: 2.0}
"""Target RMS heading over 80 s from ±30°, average of the slopes [deg], by friction along the belt."""
ROLL_BACK_TARGETS = {25: 0.02, 28: 0.05, 30: 0.15}
"""Largest accepted roll-back [m] with Table I's friction, by slope [deg]."""
IDENTIFIABLE_VAF = 50.0
"""VAF of the yaw rate [%] below which a record holds more noise than motion: the dead zone."""
IMPULSE_S = 20.0
"""Span of Fig. 8 that is drawn, of 60 s: both responses have ended by then."""
TILT_DEG = 0.5
"""Tilt of the IMU's gravity direction in the reported runs [°], for which the steady targets are set; usual after calibration."""
PUBLISHED_SEEDS = 5
"""Seeds of Table II in published figures. The RMS headings of five seeds differ by 0.01 to 0.04°; two show the figure."""

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
    source: str = "ours"
    """Source of the target: the paper, a derivation, or ours."""
    conditions: str = "{conditions}"
    section: str = "beyond"
    """Section of the page: the ``paper``'s own items, ``beyond`` the paper, or the speed of this ``machine``."""
    item: str = ""
    """Name of the paper's item in a sentence."""
    test: str = ""
    """Name of the number that is compared with the target, where ``of`` is a text."""
    why: str = ""
    """Reason if the item is not reproduced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRow:
    """One row of the summary or of the README."""

    figure: str
    paper: str
    ours: str
    conditions: str
    target: str = "–"
    verdict: str = NO_TARGET
    """``reached``, ``missed by …``, ``reproduced``, ``not reproduced``, or ``–`` without a target."""
    item: str = ""
    why: str = ""
    """Reason why an item is not reproduced."""
    sensitivity: str = ""
    """Change of the figure with step size, stiffness and friction, in words; empty where it was not measured."""


TABLE = {
    kind: tuple(Figure(**entry) for entry in entries)
    for kind, entries in tomllib.loads((DATA / "reproduction_figures.toml").read_text(encoding="utf-8")).items()
}
"""Figures by the kind of group that they are computed from, in the order of ``_groups``."""


def comparisons(results: Results, section: str = "paper") -> list[FigureRow]:
    """Return the rows of a section; a part that was not measured has none."""
    return [_row(entry, values, results) for kind, values in _groups(results) for entry in TABLE[kind] if entry.section == section]


def answer(tables: object) -> list[str]:
    """Return three sentences on the paper's items: what was reproduced, what was not, and why.

    Args:
        tables: The tables of ``results.json``, or ``Results``.
    """
    rows = comparisons(Results.model_validate(tables))
    done, failed = ([row for row in rows if row.verdict == verdict] for verdict in (REPRODUCED, NOT_REPRODUCED))
    parts = {"Reproduced": [row.item for row in done], "Not reproduced": [row.item for row in failed]}
    parts["Why"] = list(dict.fromkeys(row.why for row in failed))
    return [f"{name}: {'; '.join(items)}." for name, items in parts.items() if items]


def moves_text(moves: Moves) -> str:
    """Return the changes of a figure as words, with the variations that lose the figure or its target."""
    sources = ((moves.step, "step size"), (moves.stiffness, "stiffness"), (moves.friction, "friction ±20 %"))
    changes = ((_rounded(value, 2) if value >= 0.001 else "0.000", source) for value, source in sources if value is not None)
    known = ", ".join(f"±{change}{suffix(moves.unit)} with {source}" for change, source in changes)
    where = f" ({moves.conditions})" if moves.conditions else ""
    lists = (("no figure with", moves.lost), ("margin exceeded with", moves.exceeded), ("target missed with", moves.missed))
    return "; ".join([*([f"{known}{where}"] if known else []), *(f"{text} {', '.join(names)}" for text, names in lists if names)])


# ---- one row ----


def _row(entry: Figure, values: Values, results: Results) -> FigureRow:
    """Return an entry evaluated on a group of results; an absent number misses every target."""
    value, target = values[entry.of], values[entry.target] if isinstance(entry.target, str) else entry.target
    moves = results.sensitivity.get(f"{values.get('part', '')}/{entry.of}")
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
    tested = values[entry.test or entry.of]
    gap = None if tested is None else target - tested if entry.at_least else tested - target
    if entry.section == "paper":
        verdict = REPRODUCED if gap is not None and gap <= 0.0 and not values.get("early") else NOT_REPRODUCED
        why = "a run ended early or is missing" if values.get("early") else entry.why.format_map(values)
        row |= {"item": entry.item.format_map(values), "why": why}
    elif values.get("early"):
        verdict = "missed: a run ended early"
    elif gap is None:
        verdict = "missed"
    else:
        verdict = REACHED if gap <= 0.0 else f"missed by {_rounded(gap, 2)}{suffix(entry.unit)}"
    bound = f"{'≥' if entry.at_least else '≤'} {target:g}{suffix(entry.unit)}"
    return FigureRow(**row, target=f"{bound} ({entry.source})", verdict=verdict)


def _written(value: float, unit: str) -> str:
    """Return a value with three digits, a length to the millimetre."""
    return (f"{value:.3f}" if unit == "m" else _rounded(value, 3)) + suffix(unit)


def _rounded(value: float, digits: int) -> str:
    """Return a value with some digits, or as an integer from 100 on: never in exponential form above 1."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{float(f'{value:.{digits}g}'):g}"


# ---- groups of results ----


def _groups(results: Results) -> Iterator[tuple[str, Values]]:
    """Yield kind and values of each group of results, in the order of the rows: the paper's items in the paper's order first."""
    if (seen := results.fig05) is not None:
        robust, printed = ("none" if a is None else f"{a:.2f}°" for a in (seen.robust_heading_deg, seen.heading_deg))
        gap = None if seen.heading_deg is None else abs(seen.heading_deg - seen.true_heading_deg)
        both = f"{robust}; by Eq. (2) as printed {printed}"
        yield "fig05", {"conditions": seen.conditions, "both": both, "printed": printed, "true": seen.true_heading_deg, "gap": gap}
    yield from _models(results)
    if (printed_controller := results.literal) is not None:
        yield "literal", _printed_controller(printed_controller)
    yield from _straight(results.fig09)
    yield from _paper_turns([cell for cell in results.table2 if cell.friction == PAPER_FRICTION])
    if (seat := results.fig11) is not None:
        settles = "does not settle" if seat.settle_s is None else f"settles to ±1° in {seat.settle_s:.1f} s"
        text = f"{settles}, then {abs(seat.steady_error_deg):.3f}° off"
        yield "fig11", {"conditions": seat.conditions, "text": text, "settle_s": seat.settle_s}
    yield from _table_two(results)
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
    whole = {cell.slope_deg for cell in cells} == TABLE_SLOPES and abs(start_deg) == 30.0
    return {
        **_means(cells),
        "start": start_deg,
        "printed": f"{paper.TABLE_II_AVERAGE[int(start_deg)]}°" if whole else "–",
        "rms_target": RMS_TARGETS.get(cells[0].friction[0]) if whole else None,
    }


def _worst(cells: Sequence[Cell]) -> Values:
    """Return roll-back and settling time of the worst start on one slope."""
    times = [cell.settle_s for cell in cells]
    return {
        "slope": cells[0].slope_deg,
        "roll_back_m": max(cell.roll_back_m for cell in cells),
        "settle_s": None if None in times else max(time for time in times if time is not None),
        "starts": ", ".join(f"{start:+g}°" for start in sorted({cell.start_heading_deg for cell in cells})[::-1]),
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


def _paper_turns(cells: Sequence[Cell]) -> Iterator[tuple[str, Values]]:
    """Yield Fig. 10 and both readings of Table II: over the whole run, and after settling."""
    cells = sorted(cells, key=lambda cell: (cell.slope_deg, -cell.start_heading_deg))
    if turned := [cell for cell in cells if cell.slope_deg == paper.FIG10_SLOPE_DEG]:
        both = ", ".join(f"from {c.start_heading_deg:+g}° {_or_none(c.settle_s, 1, ' s')}" for c in turned)
        yield "fig10", _worst(turned) | {"settled": both, "early": _lacks_runs(turned)}
    if cells:
        pairs = [(c.rms_heading_deg, c.paper_deg) for c in cells]
        gaps = [abs(ours - printed) for ours, printed in pairs if ours is not None and printed is not None]
        names = {"printed": "paper_deg", "whole": "rms_heading_deg", "settled": "steady_rms_heading_deg"}
        values = {key: _by_slope(cells, name) for key, name in names.items()}
        worst = {"gap": max(gaps) if len(gaps) == len(cells) else None, "back": max(cell.roll_back_m for cell in cells)}
        values |= {"at": _listed(sorted({cell.slope_deg for cell in cells})), "conditions": cells[0].conditions + _early(cells)}
        yield "table2", values | worst | {"early": _lacks_runs(cells)}


def _lacks_runs(cells: Sequence[Cell]) -> bool:
    """Return whether a run ended early, or a start of Table II is missing on one of the slopes."""
    there = {(cell.slope_deg, cell.start_heading_deg) for cell in cells}
    return any(cell.ended_early for cell in cells) or len(there) < len(paper.TABLE_II_AVERAGE) * len({slope for slope, _ in there})


def _by_slope(cells: Sequence[Cell], name: str) -> str:
    """Return a value of all cells, both starts of a slope side by side."""
    slopes = dict.fromkeys(cell.slope_deg for cell in cells)
    sides = {slope: [_or_none(getattr(cell, name), 2, "°") for cell in cells if cell.slope_deg == slope] for slope in slopes}
    return "; ".join(f"{slope:g}°: {' / '.join(values)}" for slope, values in sides.items())


def _or_none(value: float | None, digits: int, unit: str) -> str:
    return "none" if value is None else f"{value:.{digits}f}{unit}"


def _straight(runs: Sequence[Straight]) -> Iterator[tuple[str, Values]]:
    closed, opened = ([run for run in runs if run.loop == loop] for loop in ("closed", "open"))
    if not closed or not opened:
        return
    rms, largest = max(run.rms_heading_deg for run in closed), max(run.max_abs_heading_deg for run in opened)
    early = "".join(f"; {run_words(run.run)} ended early: {run.verdict}" for run in runs if run.verdict not in COMPLETED)
    slopes = _listed([run.slope_deg for run in closed])
    values = {"rms": rms, "largest": largest, "early": early, "text": f"{rms:.2f}° ({largest:.1f}°)"}
    values |= {"lateral": max(run.lateral_m for run in closed), "drift": max(run.lateral_m for run in opened)}
    conditions = f"{closed[0].duration_s:.0f} s, right belt 2 % faster, worst of {slopes}, seed {closed[0].seed}{early}"
    yield "fig09", values | {"conditions": conditions}


def _models(results: Results) -> Iterator[tuple[str, Values]]:
    if (main := results.fig08) is None:
        return
    dead = [item.slope_deg for item in main.slopes if item.yaw_rate_vaf_percent < IDENTIFIABLE_VAF]
    explained = main.yaw_rate_vaf_percent if main.rank == paper.RANK else None
    where = f"; on {_listed(dead)} the belts do not turn the chair" if dead else ""
    text = f"rank {main.rank} at {main.slope_deg:g}°, {main.yaw_rate_vaf_percent:.0f} % of the yaw rate one step ahead{where}"
    yield "fig08", {"slope_deg": main.slope_deg, "explained": explained, "text": text, "conditions": main.conditions}
    for item in main.slopes:
        along, across = item.friction
        ground = f"{item.slope_deg:g}" + ("" if item.friction == PAPER_FRICTION else f"-mu{along:g}-{across:g}")
        kind = "fig08, slope" if item.yaw_rate_vaf_percent >= IDENTIFIABLE_VAF else "fig08, dead zone"
        at, share = f"at {item.slope_deg:g}°, friction {along:g}/{across:g}", f"{item.yaw_rate_vaf_percent:.0f} %"
        yield kind, {"part": f"fig08/{ground}", "at": at, "share": share, **item.model_dump()}


def _printed_controller(printed: PrintedController) -> Values:
    """Return K computed again, and what the printed controller does on the stair."""
    return {
        "gap": f"{printed.max_gap_to_print:.1e}",
        "max_gap_to_print": printed.max_gap_to_print,
        "asked": f"{max(printed.asked_m_s, key=abs):.2f} m/s",
        "limit": printed.max_speed_m_s,
        "ends": "; ".join(f"drives {r.duration_s:.1f} s ({r.verdict}), rolls back {r.roll_back_m:.2f} m" for r in printed.runs)
        or "not run",
        "failed": sum(run.verdict not in COMPLETED for run in printed.runs) if printed.runs else None,
    }


def _listed(degrees: Sequence[float]) -> str:
    return ", ".join(f"{value:g}°" for value in degrees)
