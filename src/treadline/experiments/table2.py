"""Table II and Fig. 10: heading from ±30° back to zero, on three slopes.

Paper: Section VI.C.2, Fig. 10, Table II. "Over the 80 s, transient included" is the reading that agrees with the
printed numbers; the paper does not state the interval. Each row also has roll-back, contact, passenger acceleration and
margins. With Table I's friction frames are rendered; with the other friction the statistical camera replaces them.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.core.models import ControllerDesign
from treadline.experiments.jobs import RunJob
from treadline.experiments.plan import (
    FIG10_SLOPE,
    PAPER_FRICTION,
    STARTS_DEG,
    Friction,
    ReproducePlan,
    suffix_of,
    turn,
    without_images,
)

PAPER_LABEL = {30: "anticlockwise", -30: "clockwise"}
VARIANTS = {"climb-safe": "turn", "paper": "turn-rollback"}
"""Allocation: the one that keeps the chair from sliding, and the one that lets it slide for a faster turn."""


WORST = {
    "airborne_share": "airborne_share",
    "max_contact_force_share": "max_contact_force_share",
    "unconverged_share": "unconverged_share",
    "belt_force_n": "max_belt_force_n",
    "belt_power_w": "peak_power_w",
}
"""Key of a row and the score whose largest value over the seeds it holds."""


def jobs(plan: ReproducePlan, controller: ControllerDesign, runs: Path, allocation: str) -> list[RunJob]:
    """Return one job per friction, slope, start and seed."""
    prefix, made = VARIANTS[allocation], []
    for friction, slope, start, seed in itertools.product(plan.frictions, plan.slopes_deg, STARTS_DEG, plan.seeds):
        name = f"{prefix}-{slope}{suffix_of(friction)}-{'plus' if start > 0 else 'minus'}30-seed{seed}"
        rendered = friction == PAPER_FRICTION
        first = allocation == "climb-safe" and rendered and slope == FIG10_SLOPE and seed == plan.seeds[0]
        scenario = turn(slope, start, plan.turn_s, allocation=allocation, friction=friction)
        made.append(
            RunJob(
                name=name,
                scenario=scenario if rendered else without_images(scenario),
                seed=seed,
                controller=controller,
                folder=runs / name,
                labels={
                    "kind": prefix,
                    "slope_deg": slope,
                    "friction": friction,
                    "start_heading_deg": start,
                    "loop": "closed",
                    "camera": "rendered" if rendered else "statistical",
                },
                image_every=10 if first and start > 0 else 0,
            )
        )
    return made


def rows(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return Table II: one row per friction, slope and start, mean and standard deviation over the seeds."""
    cells: dict[tuple[Friction, int, int], list[dict[str, Any]]] = {}
    for result in results:
        cells.setdefault((result["friction"], result["slope_deg"], result["start_heading_deg"]), []).append(result)
    ordered = sorted(cells.items(), key=lambda cell: (cell[0][0], -cell[0][2]))
    return [_row(friction, slope, start, runs) for (friction, slope, start), runs in ordered]


def _row(friction: Friction, slope: int, start: int, runs: list[dict[str, Any]]) -> dict[str, Any]:
    rms = np.array([run["rms_heading_deg"] for run in runs])
    steady = [run["steady_rms_heading_deg"] for run in runs if run["steady_rms_heading_deg"] is not None]
    settle = [run["settle_s"] for run in runs]
    return {
        "slope_deg": slope,
        "friction": list(friction),
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
        "passenger_m_s2": _worst(runs, "passenger_max_m_s2"),
        "vertical_m_s2": _worst(runs, "passenger_vertical_m_s2"),
        "longitudinal_m_s2": _worst(runs, "passenger_longitudinal_m_s2"),
        "lateral_m_s2": _worst(runs, "passenger_lateral_m_s2"),
        "margin_deg": float(np.min([run["min_stability_margin_deg"] for run in runs])),
        "seconds_below_7_deg": _worst(runs, "seconds_below_7_deg"),
        "min_stability_margin_deg": float(np.min([run["min_stability_margin_deg"] for run in runs])),
        "max_friction_use": float(np.max([run["max_friction_use"] for run in runs])),
        **{name: _worst(runs, score) for name, score in WORST.items()},
        "verdicts": sorted({run["verdict"] for run in runs}),
        "conditions": f"{runs[0]['duration_s']:.0f} s, seeds {', '.join(str(run['seed']) for run in runs)}, "
        f"{runs[0]['camera']} camera",
    }


def _worst(runs: list[dict[str, Any]], score: str) -> float | None:
    """Return the largest value of a score, or None where no run has it."""
    values = [run[score] for run in runs if run.get(score) is not None]
    return float(np.max(values)) if values else None


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
    chosen = [
        result
        for result in results
        if result["slope_deg"] == FIG10_SLOPE and result["seed"] == first and result["friction"] == PAPER_FRICTION
    ]
    return [{key: result[key] for key in keys} for result in chosen]
