"""Fig. 8, 9, 10 and Table II: excite and identify; straight up with one belt faster; back to zero from ±30°, on three slopes.

Paper: Section IV, Section VI.B, VI.C.1, VI.C.2, Fig. 8, Fig. 9, Fig. 10, Table II. For Fig. 8, heading comes from the vision,
angular velocity from the IMU; a second recording as long, with another seed, is the validation record.

"Over the 80 s, transient included" is the reading that agrees with the printed numbers of Table II; the paper does not state the
interval. Each of its rows also has roll-back, contact, passenger acceleration and margins. With Table I's friction frames are
rendered; with the other friction the statistical camera replaces them.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.core.angles import DEG
from treadline.core.linear_systems import h_step_rmse, impulse_response
from treadline.core.models import ControllerDesign, InputOutputRecord, LinearModel
from treadline.experiments._job_pool import RunJob
from treadline.experiments.plan import (
    FIG10_SLOPE,
    PAPER_FRICTION,
    PASSENGER,
    STARTS_DEG,
    Friction,
    Ground,
    ReproducePlan,
    excitation,
    straight,
    suffix_of,
    text_of,
    turn,
    without_images,
)
from treadline.identification import IdentificationOptions, identify
from treadline.io.runs import COMPLETED
from treadline.report.comparison import IMPULSE_S
from treadline.run.excitation_run import PERIOD_S, excite
from treadline.run.resolve import Opener, PlantName
from treadline.scenario.scenario import Scenario

KINDS = {"climb-safe": ("turn", "Table II"), "paper": ("turn-rollback", "Table II with roll-back allowed")}
"""Kind and title by allocation: the one that keeps the chair from sliding, and the one that lets it slide for a faster turn."""
FIG09_KEYS = (
    "slope_deg", "loop", "duration_s", "final_heading_deg", "rms_heading_deg", "max_abs_heading_deg",
    "lateral_m", "roll_back_m", "seat_rms_deg", "verdict", "seed", "run",
)  # fmt: skip
FIG10_KEYS = (
    "slope_deg", "start_heading_deg", "rms_heading_deg", "settle_s", "steady_rms_heading_deg",
    "roll_back_m", "lateral_m", "verdict", "seed", "run",
)  # fmt: skip


def straight_jobs(plan: ReproducePlan, controller: ControllerDesign | None, runs: Path) -> list[RunJob]:
    """Return one run per slope straight up, for Fig. 9: in closed loop, or without a controller in open loop."""
    loop = "open" if controller is None else "closed"
    return [
        RunJob(
            name=f"straight-{slope}-{loop}",
            title=f"Fig. 9, {slope}°, {loop} loop",
            scenario=straight(slope, loop, plan.straight_s),
            seed=plan.seeds[0],
            controller=controller,
            runs=runs,
            labels={"kind": "straight", "slope_deg": slope, "loop": loop},
            image_every=50 if loop == "closed" and slope == FIG10_SLOPE else 0,
        )
        for slope in (() if plan.quick else plan.slopes_deg)
    ]


def turn_jobs(plan: ReproducePlan, controller: ControllerDesign, runs: Path, allocation: str = "climb-safe") -> list[RunJob]:
    """Return one run per friction, slope, start and seed, for Fig. 10 and Table II."""
    (kind, table), made = KINDS[allocation], []
    for friction, slope, start, seed in itertools.product(plan.frictions, plan.slopes_deg, STARTS_DEG, plan.seeds):
        rendered = friction == PAPER_FRICTION
        first = allocation == "climb-safe" and rendered and slope == FIG10_SLOPE and seed == plan.seeds[0]
        scenario = turn(slope, start, plan.turn_s, allocation=allocation, friction=friction)
        labels = {
            "kind": kind,
            "slope_deg": slope,
            "friction": friction,
            "start_heading_deg": start,
            "camera": "rendered" if rendered else "statistical",
        }
        made.append(
            RunJob(
                name=f"{kind}-{slope}{suffix_of(friction)}-{'plus' if start > 0 else 'minus'}30-seed{seed}",
                title=f"{table}, {slope}°, from {start:+d}°{text_of(friction)}, seed {seed}",
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


SLIP_AND_CONTACT = ("max_friction_use", "airborne_share", "max_contact_force_share", "unconverged_share")
WORST = ("roll_back_m", "lateral_m", "seconds_below_7_deg", *SLIP_AND_CONTACT)
"""Scores of which a row of Table II holds the largest of all runs."""


def _row(friction: Friction, slope: int, start: int, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return one row: headings of the completed runs alone, and the worst of the other scores over all seeds.

    A score is None where no run has it.
    """
    completed = [run for run in runs if run["verdict"] in COMPLETED]

    def of(score: str, among: Sequence[dict[str, Any]] = runs) -> list[float]:
        return [run[score] for run in among if run[score] is not None]

    def worst(score: str) -> float | None:
        return max(of(score), default=None)

    def mean(score: str) -> float | None:
        return float(np.mean(values)) if (values := of(score, completed)) else None

    rms, settled = of("rms_heading_deg", completed), of("settle_s", completed)
    margin = min(of("min_stability_margin_deg"))
    return {
        "slope_deg": slope,
        "friction": list(friction),
        "start_heading_deg": start,
        "paper_label": "anticlockwise" if start > 0 else "clockwise",
        "rms_heading_deg": mean("rms_heading_deg"),
        "sd": float(np.std(rms, ddof=1)) if len(rms) > 1 else None,
        "rms_yaw_deg": mean("rms_yaw_deg"),
        "seeds": len(runs),
        "averaged": len(completed),
        "ended_early": [ending(run) for run in runs if run not in completed],
        "paper_deg": paper.TABLE_II[(slope, start)],
        **{score: worst(score) for score in WORST},
        **{key: worst(score) for key, score in PASSENGER.items()},
        "settle_s": max(settled) if len(settled) == len(runs) else None,
        "steady_rms_heading_deg": mean("steady_rms_heading_deg"),
        "worst_steady_rms_heading_deg": max(of("steady_rms_heading_deg", completed), default=None),
        "margin_deg": margin,
        "min_stability_margin_deg": margin,
        "belt_force_n": worst("max_belt_force_n"),
        "belt_power_w": worst("peak_power_w"),
        "verdicts": sorted({run["verdict"] for run in runs}),
        "conditions": f"{max(of('duration_s')):.0f} s, seed{'s' if runs[1:] else ''} "
        f"{', '.join(str(run['seed']) for run in runs)}, {runs[0]['camera']} camera",
    }


def ending(run: dict[str, Any]) -> str:
    """Return how a run ended early, in words."""
    cause = f": {run['cause']}" if run["cause"] else ""
    return f"seed {run['seed']} {run['verdict']} after {run['duration_s']:.1f} s{cause}"


AHEAD_S = 5.0
"""Horizon of the heading forecast [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExciteJob:
    """One recording of random track speeds."""

    ground: Ground
    samples: int
    seed: int
    runs: Path
    """Folder of the run folders."""
    image_every: int
    scenario: Scenario | None
    """Scenario of the run; None for the excitation scenario of the ground."""
    open_plant: Opener | PlantName = "mujoco"

    @property
    def name(self) -> str:
        """Name of the run folder."""
        return f"excite-{self.ground.name}-seed{self.seed}"

    @property
    def title(self) -> str:
        """Text of the progress line."""
        return f"Fig. 8, random belt speeds at {self.ground.slope_deg}°{text_of(self.ground.friction)}, seed {self.seed}"

    def run(self) -> "Recorded":
        """Drive; return the job and its record."""
        record, _ = excite(
            self.scenario or excitation(self.ground),
            folder=self.runs / self.name,
            samples=self.samples,
            period_s=PERIOD_S,
            seed=self.seed,
            image_every=self.image_every,
            open_plant=self.open_plant,
        )
        return self, record


Recorded = tuple[ExciteJob, InputOutputRecord]
"""Job of an excitation, and its record."""


def evaluate(fitted: ExciteJob, record: InputOutputRecord, fresh: InputOutputRecord | None) -> tuple[LinearModel, dict[str, Any]]:
    """Return the model of one ground, which names it, and Fig. 8's figures for it."""
    found = identify(record, IdentificationOptions(method="okid-era", validation=fresh))
    origin = {"slope_deg": fitted.ground.slope_deg, "friction": list(fitted.ground.friction), "seed": fitted.seed}
    model, report = replace(found.model, provenance={**found.model.provenance, "identified_on": origin}), found.report
    values = np.asarray(report.singular_values, dtype=float)
    steps = round(IMPULSE_S / model.dt_s)
    response = impulse_response(model, steps)
    ahead = h_step_rmse(model, fresh if fresh is not None else record, round(AHEAD_S / model.dt_s))
    figures = {
        "slope_deg": fitted.ground.slope_deg,
        "friction": list(fitted.ground.friction),
        "singular_values": values.tolist(),
        "rank": report.order,
        "lags": report.lags,
        "sigma2_over_sigma3": float(values[1] / values[2]),
        "yaw_rate_vaf_percent": report.one_step_vaf_percent["yaw_rate_rad_s"],
        "heading_5s_rmse_deg": float(ahead[0]) / DEG,
        "poles": report.poles,
        "fit_percent": report.percent,
        "one_step_vaf_percent": report.one_step_vaf_percent,
        "whiteness_p": report.whiteness_p,
        "warnings": list(report.warnings),
        "impulse": {
            "t_s": (np.arange(steps) * model.dt_s).tolist(),
            "heading_rad": {name: response[:, 0, j].tolist() for j, name in enumerate(model.input_names)},
            "yaw_rate_rad_s": {name: response[:, 1, j].tolist() for j, name in enumerate(model.input_names)},
        },
        "samples": len(record),
        "seed": fitted.seed,
        "run": fitted.name,
        "conditions": f"{len(record)} samples at {model.dt_s:g} s, seed {fitted.seed}; "
        + ("validated on another recording" if fresh is not None else "validated on the same recording"),
    }
    return model, figures
