"""Ours, the paper's, the target and a verdict: computed from the results, never written by hand."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from treadline import paper


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One row of the summary."""

    what: str
    ours: str
    paper: str
    target: str
    verdict: str
    """``reached``, ``missed`` or ``-`` where there is no target."""
    conditions: str


def _row(
    what: str,
    value: float | None,
    *,
    unit: str,
    target: float,
    at_least: bool = False,
    printed: str = "–",
    conditions: str = "",
) -> Comparison:
    sign = "≥" if at_least else "≤"
    if value is None or not math.isfinite(value):
        return Comparison(
            what=what,
            ours="none",
            paper=printed,
            target=f"{sign} {target:g} {unit}".strip(),
            verdict="missed",
            conditions=conditions,
        )
    reached = value >= target if at_least else value <= target
    gap = "" if reached else f" by {abs(value - target):.2g} {unit}".rstrip()
    return Comparison(
        what=what,
        ours=f"{value:.3g} {unit}".strip(),
        paper=printed,
        target=f"{sign} {target:g} {unit}".strip(),
        verdict="reached" if reached else "missed" + gap,
        conditions=conditions,
    )


def comparisons(results: Mapping[str, Any]) -> list[Comparison]:
    """Return all rows of the summary."""
    return [
        _row(
            "Eq. (14): largest gap of our K to the print",
            results["paper"]["lqr"]["max_gap_to_print"],
            unit="",
            target=5e-4,
            printed="0",
            conditions="from the printed A, B, Q, R",
        ),
        *_table_two(results),
        *_straight(results),
        *_identification(results),
        _row(
            "Fig. 11: steady seat error",
            abs(results["fig11"]["steady_error_deg"]),
            unit="°",
            target=0.5,
            printed="about 0°",
            conditions=results["fig11"]["conditions"],
        ),
        *_speed(results),
    ]


def _table_two(results: Mapping[str, Any]) -> list[Comparison]:
    rows, made = results["table2"], []
    slopes = len({row["slope_deg"] for row in rows})
    for start in (30, -30):
        mine = [row for row in rows if row["start_heading_deg"] == start]
        made.append(
            _row(
                f"Table II: RMS heading from {start:+d}°, average of {slopes} slopes",
                float(np.mean([row["rms_heading_deg"] for row in mine])),
                unit="°",
                target=3.0,
                printed=f"{paper.TABLE_II_AVERAGE[start]}°",
                conditions=f"climb-safe; world yaw {np.mean([row['rms_yaw_deg'] for row in mine]):.2f}°; {mine[0]['conditions']}",
            )
        )
    allowed = results.get("table2_roll_back_allowed") or []
    if allowed:
        made.append(
            _row(
                "Table II with roll-back allowed: average",
                float(np.mean([row["rms_heading_deg"] for row in allowed])),
                unit="°",
                target=2.4,
                printed=f"{np.mean(list(paper.TABLE_II_AVERAGE.values())):.2f}°",
                conditions=f"roll-back up to {max(row['roll_back_m'] for row in allowed):.2f} m; {allowed[0]['conditions']}",
            )
        )
    for slope, roll, settle in ((25, 0.02, 4.0), (28, 0.02, 5.0), (30, 0.2, 7.0)):
        mine = [row for row in rows if row["slope_deg"] == slope]
        if not mine:
            continue
        conditions = f"worst of ±30°, {mine[0]['conditions']}"
        made.append(
            _row(f"roll-back at {slope}°", max(row["roll_back_m"] for row in mine), unit="m", target=roll, conditions=conditions)
        )
        times = [row["settle_s"] for row in mine]
        made.append(
            _row(
                f"settling to ±2° at {slope}°",
                None if None in times else max(times),
                unit="s",
                target=settle,
                printed="10–20 s (Fig. 10)" if slope == int(paper.FIG10_SLOPE_DEG) else "–",
                conditions=conditions,
            )
        )
    steady = [row["steady_rms_heading_deg"] for row in rows if row["steady_rms_heading_deg"] is not None]
    worst = [row["worst_steady_rms_heading_deg"] for row in rows if row["worst_steady_rms_heading_deg"] is not None]
    tilt = f"t > 20 s, {results.get('gravity_error_deg', 0)}° of gravity error in the IMU"
    if steady:
        made.append(_row("steady RMS heading, mean", float(np.mean(steady)), unit="°", target=0.12, conditions=tilt))
        made.append(_row("steady RMS heading, worst run", max(worst), unit="°", target=0.2, conditions=tilt))
    return made


def _straight(results: Mapping[str, Any]) -> list[Comparison]:
    closed = [row for row in results["fig09"] if row["loop"] == "closed"]
    conditions = f"{closed[0]['duration_s']:.0f} s, right belt 2 % faster, worst of {len(closed)} slopes, seed {closed[0]['seed']}"
    return [
        _row(
            "Fig. 9: closed loop, RMS heading",
            max(row["rms_heading_deg"] for row in closed),
            unit="°",
            target=0.15,
            printed="near zero",
            conditions=conditions,
        ),
        _row(
            "Fig. 9: closed loop, lateral drift",
            max(row["lateral_m"] for row in closed),
            unit="m",
            target=0.15,
            conditions=conditions,
        ),
    ]


def _identification(results: Mapping[str, Any]) -> list[Comparison]:
    wanted = {25: (20.0, 85.0, 0.6), 28: (20.0, 80.0, 0.7), 30: (12.0, 62.0, 0.8)}
    made = []
    for item in results["fig08"]["slopes"]:
        slope = int(item["slope_deg"])
        gap, vaf, ahead = wanted[slope]
        conditions = item["conditions"]
        made += [
            _row(
                f"Fig. 8: σ₂/σ₃ at {slope}°",
                item["sigma2_over_sigma3"],
                unit="",
                target=gap,
                at_least=True,
                printed="rank 2",
                conditions=conditions,
            ),
            _row(
                f"yaw rate one step ahead at {slope}°, VAF",
                item["yaw_rate_vaf_percent"],
                unit="%",
                target=vaf,
                at_least=True,
                conditions=conditions,
            ),
            _row(
                f"heading five seconds ahead at {slope}°, RMSE",
                item["heading_5s_rmse_deg"],
                unit="°",
                target=ahead,
                conditions=conditions,
            ),
        ]
    return made


def _speed(results: Mapping[str, Any]) -> list[Comparison]:
    speed = results["speed"]
    limit = 60.0 if results["quick"] else 300.0
    return [
        _row(
            "physics alone, simulated over CPU seconds",
            speed["physics_real_time_factor"],
            unit="×",
            target=50.0,
            at_least=True,
            conditions="one core, median of five spans of 10 s, 28°",
        ),
        _row(
            "camera, vision, fusion, control and physics, CPU per simulated second",
            speed["loop_cpu_s_per_s"],
            unit="s",
            target=0.10,
            conditions="median over the runs of Table II, on the cores of this machine",
        ),
        _row("reproduce, wall clock", results["wall_s"], unit="s", target=limit, conditions="after installation"),
    ]
