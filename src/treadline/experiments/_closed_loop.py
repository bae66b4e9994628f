"""Fig. 9, Fig. 10 and Table II: straight up with one belt faster, and back to zero from ±30°, on three slopes.

Paper: Section VI.C.1, VI.C.2, Fig. 9, Fig. 10, Table II. "Over the 80 s, transient included" is the reading that agrees with the
printed numbers of Table II; the paper does not state the interval. Each of its rows also has roll-back, contact, passenger
acceleration and margins. With Table I's friction frames are rendered; with the other friction the statistical camera replaces them.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.core.models import ControllerDesign
from treadline.experiments.job_pool import RunJob
from treadline.experiments.plan import (
    FIG10_SLOPE,
    PAPER_FRICTION,
    STARTS_DEG,
    Friction,
    ReproducePlan,
    straight,
    suffix_of,
    turn,
    without_images,
)

PAPER_LABEL = {30: "anticlockwise", -30: "clockwise"}
KINDS = {"climb-safe": "turn", "paper": "turn-rollback"}
"""Allocation: the one that keeps the chair from sliding, and the one that lets it slide for a faster turn."""
FIG09_KEYS = (
    "slope_deg",
    "loop",
    "duration_s",
    "final_heading_deg",
    "rms_heading_deg",
    "max_abs_heading_deg",
    "lateral_m",
    "roll_back_m",
    "seat_rms_deg",
    "verdict",
    "seed",
    "run",
)
FIG10_KEYS = (
    "slope_deg",
    "start_heading_deg",
    "rms_heading_deg",
    "settle_s",
    "steady_rms_heading_deg",
    "roll_back_m",
    "lateral_m",
    "seed",
    "run",
)


def straight_jobs(plan: ReproducePlan, controller: ControllerDesign | None, runs: Path) -> list[RunJob]:
    """Return one run per slope straight up, for Fig. 9: in closed loop, or without a controller in open loop."""
    loop = "open" if controller is None else "closed"
    return [
        RunJob(
            name=f"straight-{slope}-{loop}",
            scenario=straight(slope, loop, plan.straight_s),
            seed=plan.seeds[0],
            controller=controller,
            runs=runs,
            labels={"kind": "straight", "slope_deg": slope, "loop": loop},
            image_every=50 if loop == "closed" and slope == FIG10_SLOPE else 0,
        )
        for slope in plan.slopes_deg
    ]


def turn_jobs(plan: ReproducePlan, controller: ControllerDesign, runs: Path, allocation: str = "climb-safe") -> list[RunJob]:
    """Return one run per friction, slope, start and seed, for Fig. 10 and Table II."""
    kind, made = KINDS[allocation], []
    for friction, slope, start, seed in itertools.product(plan.frictions, plan.slopes_deg, STARTS_DEG, plan.seeds):
        rendered = friction == PAPER_FRICTION
        first = allocation == "climb-safe" and rendered and slope == FIG10_SLOPE and seed == plan.seeds[0]
        scenario = turn(slope, start, plan.turn_s, allocation=allocation, friction=friction)
        labels = {
            "kind": kind,
            "slope_deg": slope,
            "friction": friction,
            "start_heading_deg": start,
            "loop": "closed",
            "camera": "rendered" if rendered else "statistical",
        }
        made.append(
            RunJob(
                name=f"{kind}-{slope}{suffix_of(friction)}-{'plus' if start > 0 else 'minus'}30-seed{seed}",
                scenario=scenario if rendered else without_images(scenario),
                seed=seed,
                controller=controller,
                runs=runs,
                labels=labels,
                image_every=10 if first and start > 0 else 0,
            )
        )
    return made


def fig09(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs of Fig. 9: each slope closed and open."""
    ordered = sorted(results, key=lambda result: (result["slope_deg"], result["loop"]))
    return [{key: result[key] for key in FIG09_KEYS} for result in ordered]


def fig10(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs of Fig. 10: ±30° at 28°, first seed."""
    first = min(result["seed"] for result in results)
    chosen = (FIG10_SLOPE, first, PAPER_FRICTION)
    return [
        {key: result[key] for key in FIG10_KEYS}
        for result in results
        if (result["slope_deg"], result["seed"], result["friction"]) == chosen
    ]


def table2(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return Table II: one row per friction, slope and start, mean and standard deviation over the seeds."""
    cells: dict[tuple[Friction, int, int], list[dict[str, Any]]] = {}
    for result in results:
        cells.setdefault((result["friction"], result["slope_deg"], result["start_heading_deg"]), []).append(result)
    ordered = sorted(cells.items(), key=lambda cell: (cell[0][0], -cell[0][2]))
    return [_row(friction, slope, start, runs) for (friction, slope, start), runs in ordered]


def _row(friction: Friction, slope: int, start: int, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return one row: means of headings, and the worst of the other scores over the seeds; None where no run has a score."""

    def of(score: str) -> list[float]:
        return [run[score] for run in runs if run[score] is not None]

    def worst(score: str) -> float | None:
        return max(of(score), default=None)

    rms, steady = np.array(of("rms_heading_deg")), of("steady_rms_heading_deg")
    margin = min(of("min_stability_margin_deg"))
    return {
        "slope_deg": slope,
        "friction": list(friction),
        "start_heading_deg": start,
        "paper_label": PAPER_LABEL[start],
        "rms_heading_deg": float(rms.mean()),
        "sd": float(rms.std(ddof=1)) if rms.size > 1 else None,
        "rms_yaw_deg": float(np.mean(of("rms_yaw_deg"))),
        "seeds": len(runs),
        "paper_deg": paper.TABLE_II[(slope, start)],
        "roll_back_m": worst("roll_back_m"),
        "lateral_m": worst("lateral_m"),
        "settle_s": worst("settle_s") if len(of("settle_s")) == len(runs) else None,
        "steady_rms_heading_deg": float(np.mean(steady)) if steady else None,
        "worst_steady_rms_heading_deg": worst("steady_rms_heading_deg"),
        "passenger_m_s2": worst("passenger_max_m_s2"),
        "vertical_m_s2": worst("passenger_vertical_m_s2"),
        "longitudinal_m_s2": worst("passenger_longitudinal_m_s2"),
        "lateral_m_s2": worst("passenger_lateral_m_s2"),
        "margin_deg": margin,
        "seconds_below_7_deg": worst("seconds_below_7_deg"),
        "min_stability_margin_deg": margin,
        "max_friction_use": worst("max_friction_use"),
        "airborne_share": worst("airborne_share"),
        "max_contact_force_share": worst("max_contact_force_share"),
        "unconverged_share": worst("unconverged_share"),
        "belt_force_n": worst("max_belt_force_n"),
        "belt_power_w": worst("peak_power_w"),
        "verdicts": sorted({run["verdict"] for run in runs}),
        "conditions": f"{runs[0]['duration_s']:.0f} s, seeds {', '.join(str(run['seed']) for run in runs)}, "
        f"{runs[0]['camera']} camera",
    }
