"""Ours, the paper's, the target and a verdict: computed from the results, never written by hand."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from treadline import paper
from treadline.report.comparison import NO_TARGET, Comparison, judged
from treadline.report.results import PAPER_FRICTION, Cell, Identified, Results, Straight
from treadline.report.sensitivity import with_moves

QUICK = "quick run: not judged"
TABLE_SLOPES = {float(slope) for slope, _ in paper.TABLE_II}
RMS_TARGETS = {0.62: 2.3, 0.9: 2.0}
"""By friction along the belt: RMS heading over 80 s from ±30°, average of the slopes [deg]."""
ROLL_BACK_TARGETS = {25: 0.02, 28: 0.05, 30: 0.15}
"""By slope [deg], on Table I's friction: largest roll-back [m]."""
PASSENGER_M_S2 = 1.5
"""Largest acceleration of the passenger in a turn."""
MODEL_TARGETS = (20.0, 85.0, 0.6)
"""Where the chair can be identified: σ₂/σ₃, VAF of the yaw rate [%], RMSE of the heading five seconds ahead [deg]."""
IDENTIFIABLE_VAF = 50.0
"""VAF of the yaw rate [%] below which a record holds more noise than motion: the dead zone."""
TILT_DEG = 0.5
"""Gravity error of the IMU for which the steady targets are set."""


def comparisons(results: Results) -> list[Comparison]:
    """Return all rows of the summary.

    The targets are for whole runs: in a quick one, what rests on shortened runs stands beside its target unjudged.
    """
    rows = [
        *_recipe(results),
        *_sight(results),
        *_table_two(results),
        *_straight(results.fig09),
        *(row for item in (results.fig08.slopes if results.fig08 else ()) for row in _identified(item)),
        *_seat(results),
        *_speed(results),
    ]
    if not results.quick:
        return [with_moves(row, results.sensitivity) for row in rows]
    return [replace(row, verdict=QUICK) if row.from_runs and row.verdict != NO_TARGET else row for row in rows]


def _recipe(results: Results) -> list[Comparison]:
    if results.literal is None:
        return []
    gap = results.literal.max_gap_to_print
    where = "from the printed A, B, Q, R"
    asked = max(results.literal.asked_m_s, key=abs)
    return [
        judged("Eq. (14): largest gap of our K to the print", gap, "", target=5e-4, printed="0", conditions=where, from_runs=False),
        Comparison(
            what="Eq. (11b), (12), (14): track speed asked at 30°",
            ours=f"{asked:.2f} m/s",
            paper=f"at most {results.literal.max_speed_m_s:g} m/s (Table I)",
            conditions="from the printed matrices, chair at rest",
        ),
    ]


def _sight(results: Results) -> list[Comparison]:
    seen = results.fig05
    if seen is None:
        return []
    robust, printed = (_degrees(angle) for angle in (seen.robust_heading_deg, seen.heading_deg))
    return [
        Comparison(
            what=f"Fig. 5: heading seen of {seen.true_heading_deg:.2f}°",
            ours=robust,
            paper=f"{printed} by Eq. (2), run here",
            conditions=f"one frame; {seen.conditions}",
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
    return [*rows, *_roll_back_allowed(results.table2_roll_back_allowed)]


def _on(cells: Sequence[Cell]) -> str:
    """Return the friction of some cells as words."""
    along, across = cells[0].friction
    return f"friction {along:g}/{across:g}"


def _part(cells: Sequence[Cell]) -> str:
    """Return the key under which the sensitivity of some cells' figures stands."""
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
            f"{_span(opened)}; at {slopes}; largest on the way {largest:.2g}°, drift {max(run.lateral_m for run in opened):.2g} m"
        )
        made.append(
            Comparison(what="Fig. 9: open loop, final heading", ours=final, paper="increases gradually", conditions=conditions)
        )
    return made


def _span(runs: Sequence[Straight]) -> str:
    return f"{max(run.duration_s for run in runs):.0f} s, right belt 2 % faster, seed {runs[0].seed}"


def _identified(item: Identified) -> list[Comparison]:
    at, where = f"at {item.slope_deg:g}°, friction {item.friction[0]:g}/{item.friction[1]:g}", item.conditions
    ratio, share = item.sigma2_over_sigma3, item.yaw_rate_vaf_percent
    if share < IDENTIFIABLE_VAF:
        told = f"{share:.0f} % of the yaw rate explained: not identifiable, the belts do not turn the chair (dead zone)"
        return [Comparison(what=f"Fig. 8: model {at}", ours=told, paper="rank 2", conditions=where)]
    gap, vaf, ahead = MODEL_TARGETS
    return [
        judged(f"Fig. 8: σ₂/σ₃ {at}", ratio, "", target=gap, at_least=True, printed="rank 2", conditions=where),
        judged(
            f"yaw rate one step ahead {at}, VAF",
            share,
            "%",
            target=vaf,
            at_least=True,
            conditions=where,
            figure=f"fig08/{item.slope_deg:g}/yaw_rate_vaf_percent",
        ),
        judged(f"heading five seconds ahead {at}, RMSE", item.heading_5s_rmse_deg, "°", target=ahead, conditions=where),
    ]


def _seat(results: Results) -> list[Comparison]:
    if results.fig11 is None:
        return []
    error, where = abs(results.fig11.steady_error_deg), results.fig11.conditions
    return [judged("Fig. 11: steady seat error", error, "°", target=None, printed="about 0°", conditions=where)]


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
