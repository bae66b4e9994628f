"""Table II and Fig. 10: heading from ±30° back to zero, on three slopes.

Paper: Section VI.C.2, Fig. 10, Table II. "Over the 80 s, transient included" is the reading that agrees with the
printed numbers; the paper does not say. Roll-back stands beside each figure.
"""

from pathlib import Path
from typing import Any

import numpy as np

from treadline import paper
from treadline.experiments.jobs import RunJob
from treadline.experiments.plan import FIG10_SLOPE, STARTS_DEG, Plan, turn
from treadline.models import ControllerDesign

PAPER_LABEL = {30: "anticlockwise", -30: "clockwise"}
VARIANTS = {"climb-safe": "turn", "paper": "turn-rollback"}
"""Allocation: the one that keeps the chair from sliding, and the one that lets it slide for a faster turn."""


def jobs(plan: Plan, controller: ControllerDesign, runs: Path, allocation: str) -> list[RunJob]:
    """Return one job per slope, start and seed."""
    prefix = VARIANTS[allocation]
    made = []
    for slope in plan.slopes_deg:
        for start in STARTS_DEG:
            for seed in plan.seeds:
                name = f"{prefix}-{slope}-{'plus' if start > 0 else 'minus'}30-seed{seed}"
                first = allocation == "climb-safe" and slope == FIG10_SLOPE and seed == plan.seeds[0]
                made.append(
                    RunJob(
                        name=name,
                        scenario=turn(slope, start, plan.turn_s, allocation=allocation),
                        seed=seed,
                        controller=controller,
                        folder=runs / name,
                        labels={
                            "kind": prefix,
                            "slope_deg": slope,
                            "start_heading_deg": start,
                            "loop": "closed",
                        },
                        log=first,
                        image_every=10 if first and start > 0 else 0,
                    )
                )
    return made


def rows(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return Table II: one row per slope and start, mean and standard deviation over the seeds."""
    cells: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for result in results:
        cells.setdefault((result["slope_deg"], result["start_heading_deg"]), []).append(result)
    return [_row(slope, start, runs) for (slope, start), runs in sorted(cells.items(), key=lambda cell: -cell[0][1])]


def _row(slope: int, start: int, runs: list[dict[str, Any]]) -> dict[str, Any]:
    rms = np.array([run["rms_heading_deg"] for run in runs])
    steady = [run["steady_rms_heading_deg"] for run in runs if run["steady_rms_heading_deg"] is not None]
    settle = [run["settle_s"] for run in runs]
    return {
        "slope_deg": slope,
        "start_heading_deg": start,
        "paper_label": PAPER_LABEL[start],
        "rms_heading_deg": float(rms.mean()),
        "sd": float(rms.std(ddof=1)) if rms.size > 1 else None,
        "rms_yaw_deg": float(np.mean([run["rms_yaw_deg"] for run in runs])),
        "seeds": int(rms.size),
        "paper_deg": paper.TABLE_II[(slope, start)],
        "roll_back_m": float(np.max([run["roll_back_m"] for run in runs])),
        "lateral_m": float(np.max([run["lateral_m"] for run in runs])),
        "settle_s": None if None in settle else float(np.max(settle)),
        "steady_rms_heading_deg": float(np.mean(steady)) if steady else None,
        "worst_steady_rms_heading_deg": float(np.max(steady)) if steady else None,
        "passenger_m_s2": _largest(runs, "passenger_max_m_s2"),
        "vertical_m_s2": _largest(runs, "passenger_vertical_m_s2"),
        "longitudinal_m_s2": _largest(runs, "passenger_longitudinal_m_s2"),
        "lateral_m_s2": _largest(runs, "passenger_lateral_m_s2"),
        "margin_deg": float(np.min([run["min_stability_margin_deg"] for run in runs])),
        "seconds_below_7_deg": _largest(runs, "seconds_below_7_deg"),
        "min_stability_margin_deg": float(np.min([run["min_stability_margin_deg"] for run in runs])),
        "max_friction_use": float(np.max([run["max_friction_use"] for run in runs])),
        "verdicts": sorted({run["verdict"] for run in runs}),
        "conditions": f"{runs[0]['duration_s']:.0f} s, seeds {', '.join(str(run['seed']) for run in runs)}",
    }


def _largest(runs: list[dict[str, Any]], score: str) -> float:
    return float(np.max([run[score] for run in runs]))


def fig10(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs of Fig. 10: ±30° at 28°, first seed."""
    keys = (
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
    first = min(result["seed"] for result in results)
    chosen = [result for result in results if result["slope_deg"] == FIG10_SLOPE and result["seed"] == first]
    return [{key: result[key] for key in keys} for result in chosen]
