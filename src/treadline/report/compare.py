"""Rows of the summary, computed from ``results.json``: our figure, the paper's figure, the target and the verdict."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from treadline.core import paper
from treadline.report.comparison import NO_TARGET, Comparison, judged, written
from treadline.report.results import PAPER_FRICTION, BeltRun, Cell, ModelFigures, Results, Straight
from treadline.report.sensitivity import with_moves

QUICK = "quick run: not judged"
TABLE_SLOPES = {float(slope) for slope, _ in paper.TABLE_II}
RMS_TARGETS = {0.62: 2.3, 0.9: 2.0}
"""Target RMS heading over 80 s from ±30°, average of the slopes [deg], by friction along the belt."""
ROLL_BACK_TARGETS = {25: 0.02, 28: 0.05, 30: 0.15}
"""Largest accepted roll-back [m] with Table I's friction, by slope [deg]."""
SMOOTH_BELT = "none"
"""Lug of a smooth belt, as a scenario names it."""
PASSENGER_M_S2 = 1.5
"""Target of the passenger's largest acceleration [m/s²], as a mean over 50 ms."""
PITCH_RATE_DEG_S = 15.0
"""Target of the largest pitch rate on a traversal [°/s]."""
MODEL_TARGETS = (20.0, 85.0, 0.6)
"""Where the chair can be identified: σ₂/σ₃, VAF of the yaw rate [%], RMSE of the heading five seconds ahead [deg]."""
IDENTIFIABLE_VAF = 50.0
"""VAF of the yaw rate [%] below which a record holds more noise than motion: the dead zone."""
TILT_DEG = 0.5
"""Gravity error of the IMU for which the steady targets are set."""


def comparisons(results: Results) -> list[Comparison]:
    """Return all rows of the summary.

    The targets hold for whole runs: a figure of a shortened run is shown next to its target without a verdict.
    """
    rows = [
        *_printed_controller(results),
        *_frame(results),
        *_table_two(results),
        *_straight(results.fig09),
        *(row for item in (results.fig08.slopes if results.fig08 else ()) for row in _identified(item)),
        *_seat(results),
        *_speed(results),
    ]
    if not results.quick:
        return [with_moves(row, results.sensitivity) for row in rows]
    return [replace(row, verdict=QUICK) if row.from_runs and row.verdict != NO_TARGET else row for row in rows]


def _printed_controller(results: Results) -> list[Comparison]:
    if results.literal is None:
        return []
    gap = results.literal.max_gap_to_print
    where = "from the printed A, B, Q, R"
    asked = max(results.literal.asked_m_s, key=abs)
    return [
        judged(
            "Eq. (14): largest difference of our K from the printed K",
            gap,
            "",
            target=5e-4,
            printed="0",
            conditions=where,
            from_runs=False,
        ),
        Comparison(
            what="Eq. (11b), (12), (14): track speed commanded at 30°",
            ours=f"{asked:.2f} m/s",
            paper=f"at most {results.literal.max_speed_m_s:g} m/s (Table I)",
            conditions="from the printed matrices, chair at rest",
        ),
    ]


def _frame(results: Results) -> list[Comparison]:
    seen = results.fig05
    if seen is None:
        return []
    robust, printed = (_degrees(angle) for angle in (seen.robust_heading_deg, seen.heading_deg))
    return [
        Comparison(
            what=f"Fig. 5: estimated heading, true heading {seen.true_heading_deg:.2f}°",
            ours=robust,
            paper=f"{printed} by Eq. (2), computed here",
            conditions=f"one frame; {seen.conditions}",
            figure="fig05/28/robust_heading_deg",
        )
    ]


def _degrees(angle_deg: float | None) -> str:
    return "none" if angle_deg is None else f"{angle_deg:.2f}°"


def _table_two(results: Results) -> list[Comparison]:
    rows = []
    for friction in sorted({tuple(cell.friction) for cell in results.table2}):
        cells = [cell for cell in results.table2 if tuple(cell.friction) == friction]
        starts = sorted({cell.start_heading_deg for cell in cells}, reverse=True)
        rows += [
            *(_average([cell for cell in cells if cell.start_heading_deg == start], start) for start in starts),
            *(row for slope in _slopes(cells) for row in _turn([cell for cell in cells if cell.slope_deg == slope])),
            *_comfort(cells),
            *_steady(cells, results.gravity_error_deg),
        ]
        if list(friction) == PAPER_FRICTION:
            rows += lug_rows(results.lugs)
    return [*rows, *_roll_back_allowed(results.table2_roll_back_allowed)]


def _on(cells: Sequence[Cell]) -> str:
    """Return the friction of some cells as words."""
    along, across = cells[0].friction
    return f"friction {along:g}/{across:g}"


def _part(cells: Sequence[Cell]) -> str:
    """Return the first part of the sensitivity keys of some cells' figures."""
    along, across = cells[0].friction
    return f"table2/{along:g}-{across:g}"


def _comfort(cells: Sequence[Cell]) -> list[Comparison]:
    known = [cell for cell in cells if cell.passenger_m_s2 is not None]
    if not known:
        return []
    worst = max(known, key=lambda cell: cell.passenger_m_s2 or 0.0)
    parts = (worst.vertical_m_s2, worst.longitudinal_m_s2, worst.lateral_m_s2)
    split = "" if None in parts else "; vertical {:.2f}, longitudinal {:.2f}, lateral {:.2f} m/s²".format(*parts)
    return [
        judged(
            f"passenger's acceleration in the turns, {_on(cells)}",
            worst.passenger_m_s2,
            "m/s²",
            target=PASSENGER_M_S2,
            conditions=f"largest mean over 50 ms, at {worst.slope_deg:g}°{split}; {worst.conditions}",
            figure=f"{_part(cells)}/passenger_m_s2",
        )
    ]


def lug_rows(runs: Sequence[BeltRun]) -> list[Comparison]:
    """Return comfort and roll-back with lugs next to those with smooth belts, the rubber's stiffness bracketed."""
    turns = [run for run in runs if run.is_turn]
    slopes = sorted({run.slope_deg for run in turns})
    rows = [
        _lug_row(f"roll-back at {slope:g}°", turns, slope, "roll_back_m", "m", ROLL_BACK_TARGETS.get(int(slope)))
        for slope in slopes
    ]
    rows += [
        _lug_row(f"passenger's acceleration in the turn at {slope:g}°", turns, slope, "passenger_m_s2", "m/s²", PASSENGER_M_S2)
        for slope in slopes
    ]
    whole = [run for run in runs if not run.is_turn]
    for course in sorted({run.course for run in whole}):
        on_course = [run for run in whole if run.course == course]
        slope = on_course[0].slope_deg
        rows += [
            _lug_row(f"passenger's acceleration, {course}", on_course, slope, "passenger_m_s2", "m/s²", PASSENGER_M_S2),
            _lug_row(f"largest pitch rate, {course}", on_course, slope, "pitch_rate_deg_s", "°/s", PITCH_RATE_DEG_S),
        ]
    return [row for row in rows if row is not None]


def _lug_row(
    what: str, runs: Sequence[BeltRun], slope_deg: float, score: str, unit: str, target: float | None
) -> Comparison | None:
    """Return a figure with lugs of nominal rubber next to the same with smooth belts; None without both runs."""
    here = [run for run in runs if run.slope_deg == slope_deg]
    smooth = [run for run in here if run.lug == SMOOTH_BELT]
    lugged = sorted((run for run in here if run.lug != SMOOTH_BELT), key=lambda run: run.rubber_s or 0.0)
    if not smooth or not lugged:
        return None
    nominal = lugged[len(lugged) // 2]
    row = judged(
        f"{what}, lugs {nominal.lug} mm",
        getattr(nominal, score),
        unit,
        target=target,
        conditions=f"smooth belts {written(getattr(smooth[0], score), unit)} in the same run; {_bracket(lugged, score, unit)}"
        f"{nominal.duration_s:.0f} s, seed {nominal.seed}, statistical camera",
        figure=f"lugs/{nominal.course}/{score}",
    )
    ended = [run for run in (*smooth, *lugged) if run.verdict not in ("time_up", "arrived")]
    return replace(row, conditions="; ".join([row.conditions, *(f"{run.run}: {run.verdict} ({run.cause})" for run in ended)]))


def _bracket(lugged: Sequence[BeltRun], score: str, unit: str) -> str:
    if len(lugged) < 2:
        return ""
    values = [getattr(run, score) for run in lugged]
    rubber = f"{lugged[0].rubber_s:g} to {lugged[-1].rubber_s:g} s"
    return f"{written(min(values), unit)} to {written(max(values), unit)} with rubber of {rubber}; "


def _slopes(cells: Sequence[Cell]) -> list[float]:
    return sorted({cell.slope_deg for cell in cells})


def _mean(cells: Sequence[Cell], of: Callable[[Cell], float]) -> float:
    return float(np.mean([of(cell) for cell in cells]))


def _average(cells: Sequence[Cell], start_deg: float) -> Comparison:
    whole = {cell.slope_deg for cell in cells} == TABLE_SLOPES and abs(start_deg) == 30.0
    printed = paper.TABLE_II_AVERAGE.get(int(start_deg)) if whole else None
    return judged(
        f"Table II: RMS heading from {start_deg:+g}°, average of {_listed(_slopes(cells))}, {_on(cells)}",
        _mean(cells, lambda cell: cell.rms_heading_deg),
        "°",
        target=RMS_TARGETS.get(cells[0].friction[0]) if whole else None,
        printed="–" if printed is None else f"{printed}°",
        conditions=f"climb-safe; world yaw {_mean(cells, lambda cell: cell.rms_yaw_deg):.2f}°; {cells[0].conditions}",
        figure=f"{_part(cells)}/rms_heading_deg" if whole else "",
    )


def _roll_back_allowed(cells: Sequence[Cell]) -> list[Comparison]:
    if not cells:
        return []
    whole = set(_slopes(cells)) == TABLE_SLOPES
    yaw, back = _mean(cells, lambda cell: cell.rms_yaw_deg), max(cell.roll_back_m for cell in cells)
    return [
        judged(
            f"Table II with roll-back allowed: average of {_listed(_slopes(cells))}",
            _mean(cells, lambda cell: cell.rms_heading_deg),
            "°",
            target=2.4 if whole else None,
            printed=f"{np.mean(list(paper.TABLE_II_AVERAGE.values())):.2f}°" if whole else "–",
            conditions=f"world yaw {yaw:.2f}°; roll-back up to {back:.2f} m; {cells[0].conditions}",
            figure="table2_roll_back_allowed/28/rms_heading_deg",
        )
    ]


def _turn(cells: Sequence[Cell]) -> list[Comparison]:
    slope = cells[0].slope_deg
    back = ROLL_BACK_TARGETS.get(int(slope)) if slope.is_integer() and cells[0].friction == PAPER_FRICTION else None
    starts = ", ".join(f"{start:+g}°" for start in sorted({cell.start_heading_deg for cell in cells}, reverse=True))
    conditions = f"climb-safe, worst of starts at {starts}; {cells[0].conditions}"
    times = [cell.settle_s for cell in cells if cell.settle_s is not None]
    return [
        judged(
            f"roll-back at {slope:g}°, {_on(cells)}",
            max(cell.roll_back_m for cell in cells),
            "m",
            target=back,
            conditions=conditions,
            figure=f"{_part(cells)}/{slope:g}/roll_back_m",
        ),
        judged(
            f"settling to ±2° at {slope:g}°, {_on(cells)}",
            max(times) if len(times) == len(cells) else None,
            "s",
            target=None,
            printed="10–20 s (Fig. 10)" if slope == paper.FIG10_SLOPE_DEG else "–",
            conditions=conditions,
            figure=f"{_part(cells)}/{slope:g}/settle_s",
        ),
    ]


def _steady(cells: Sequence[Cell], tilt_deg: float) -> list[Comparison]:
    means = [cell.steady_rms_heading_deg for cell in cells if cell.steady_rms_heading_deg is not None]
    worst = [cell.worst_steady_rms_heading_deg for cell in cells if cell.worst_steady_rms_heading_deg is not None]
    if not means or not worst:
        return []
    conditions = f"t > 20 s, {tilt_deg:g}° of gravity error in the IMU"
    # On Table I's friction the dead zone leaves the heading where the turn ended, so no target is set.
    meant = tilt_deg == TILT_DEG and cells[0].friction != PAPER_FRICTION
    return [
        judged(
            f"steady RMS heading, mean, {_on(cells)}",
            float(np.mean(means)),
            "°",
            target=0.12 if meant else None,
            conditions=conditions,
            figure=f"{_part(cells)}/steady_rms_heading_deg",
        ),
        judged(
            f"steady RMS heading, worst run, {_on(cells)}", max(worst), "°", target=0.2 if meant else None, conditions=conditions
        ),
    ]


def _straight(runs: Sequence[Straight]) -> list[Comparison]:
    made = []
    closed, opened = ([run for run in runs if run.loop == loop] for loop in ("closed", "open"))
    if closed:
        conditions = f"{_span(closed)}, worst of {_listed([run.slope_deg for run in closed])}"
        rms, aside = max(run.rms_heading_deg for run in closed), max(run.lateral_m for run in closed)
        made += [
            judged(
                "Fig. 9: closed loop, RMS heading",
                rms,
                "°",
                target=0.15,
                printed="near zero",
                conditions=conditions,
                figure="fig09/28/rms_heading_deg",
            ),
            judged(
                "Fig. 9: closed loop, lateral drift", aside, "m", target=0.15, conditions=conditions, figure="fig09/28/lateral_m"
            ),
        ]
    if opened:
        final, largest = (
            ", ".join(f"{round(run.final_heading_deg, 2) + 0.0:g}°" for run in opened),
            max(run.max_abs_heading_deg for run in opened),
        )
        slopes = _listed([run.slope_deg for run in opened])
        conditions = (
            f"{_span(opened)}; at {slopes}; largest heading {largest:.2g}°, drift {max(run.lateral_m for run in opened):.2g} m"
        )
        made.append(
            Comparison(
                what="Fig. 9: open loop, final heading",
                ours=final,
                paper="increases gradually",
                conditions=conditions,
                figure="fig09_open/28/final_heading_deg",
            )
        )
    return made


def _span(runs: Sequence[Straight]) -> str:
    return f"{max(run.duration_s for run in runs):.0f} s, right belt 2 % faster, seed {runs[0].seed}"


def _identified(item: ModelFigures) -> list[Comparison]:
    at, where = f"at {item.slope_deg:g}°, friction {item.friction[0]:g}/{item.friction[1]:g}", item.conditions
    ratio, share = item.sigma2_over_sigma3, item.yaw_rate_vaf_percent
    if share < IDENTIFIABLE_VAF:
        why = "not identifiable: the belts do not turn the chair (dead zone)"
        return [
            Comparison(
                what=f"yaw rate one step ahead {at}, VAF", ours=f"{share:.0f} %", paper="rank 2", conditions=f"{why}; {where}"
            )
        ]
    gap, vaf, ahead = MODEL_TARGETS
    along, across = item.friction
    ground = f"{item.slope_deg:g}" + ("" if item.friction == PAPER_FRICTION else f"-mu{along:g}-{across:g}")
    return [
        judged(f"Fig. 8: σ₂/σ₃ {at}", ratio, "", target=gap, at_least=True, printed="rank 2", conditions=where),
        judged(
            f"yaw rate one step ahead {at}, VAF",
            share,
            "%",
            target=vaf,
            at_least=True,
            conditions=where,
            figure=f"fig08/{ground}/yaw_rate_vaf_percent",
        ),
        judged(f"heading five seconds ahead {at}, RMSE", item.heading_5s_rmse_deg, "°", target=ahead, conditions=where),
    ]


def _seat(results: Results) -> list[Comparison]:
    if results.fig11 is None:
        return []
    error, where = abs(results.fig11.steady_error_deg), results.fig11.conditions
    return [
        judged(
            "Fig. 11: steady seat error",
            error,
            "°",
            target=None,
            printed="about 0°",
            conditions=where,
            figure="fig11/28/steady_error_deg",
        )
    ]


def _speed(results: Results) -> list[Comparison]:
    made = []
    if results.speed is not None:
        made += [
            judged(
                "physics alone, simulated over CPU seconds",
                results.speed.physics_real_time_factor,
                "×",
                target=50.0,
                at_least=True,
                conditions="one core, median of five spans of 10 s, 28°",
                from_runs=False,
            ),
            judged(
                "camera, vision, fusion, control and physics, CPU per simulated second",
                results.speed.loop_cpu_s_per_s,
                "s",
                target=0.10,
                conditions="median over the runs of Table II, on the cores of this machine",
                from_runs=False,
            ),
        ]
    if results.wall_s is not None:
        limit, what = (60.0, "reproduce --quick") if results.quick else (300.0, "reproduce")
        made.append(
            judged(f"{what}, wall clock", results.wall_s, "s", target=limit, conditions="after installation", from_runs=False)
        )
    return made


def _listed(degrees: Sequence[float]) -> str:
    return ", ".join(f"{value:g}°" for value in degrees)
