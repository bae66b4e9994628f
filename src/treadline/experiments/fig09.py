"""Fig. 9: straight up for 300 s with one belt 2 % faster, open loop against closed loop.

Paper: Section VI.C.1, Fig. 9.
"""

from pathlib import Path
from typing import Any

from treadline.core.models import ControllerDesign
from treadline.experiments.jobs import RunJob
from treadline.experiments.plan import FIG10_SLOPE, ReproducePlan, straight

KEYS = (
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


def open_jobs(plan: ReproducePlan, runs: Path) -> list[RunJob]:
    """Return one run per slope that nothing steers."""
    return _jobs(plan, "open", None, runs)


def closed_jobs(plan: ReproducePlan, controller: ControllerDesign, runs: Path) -> list[RunJob]:
    """Return one run per slope that the controller steers."""
    return _jobs(plan, "closed", controller, runs)


def rows(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the figure's runs: each slope closed and open."""
    ordered = sorted(results, key=lambda result: (result["slope_deg"], result["loop"]))
    return [{key: result[key] for key in KEYS} for result in ordered]


def _jobs(plan: ReproducePlan, loop: str, controller: ControllerDesign | None, runs: Path) -> list[RunJob]:
    return [
        RunJob(
            name=f"straight-{slope}-{loop}",
            scenario=straight(slope, loop, plan.straight_s),
            seed=plan.seeds[0],
            controller=controller,
            folder=runs / f"straight-{slope}-{loop}",
            labels={"kind": "straight", "slope_deg": slope, "loop": loop},
            image_every=50 if loop == "closed" and slope == FIG10_SLOPE else 0,
        )
        for slope in plan.slopes_deg
    ]
