"""Reproduction of the whole paper: excite, identify, tune, climb, level the seat, detect; ``results.json`` holds every figure.

Each phase is a list of jobs for the pool, and phases exchange data alone. Runs without the controller are made while the recordings
for its identification are being made.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import median_high
from typing import Any, Protocol

from treadline.control.tune import tune
from treadline.core.files import read_json, write_json
from treadline.core.models import ControllerDesign
from treadline.core.printing import plain
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.experiments import _dead_zone, _fig05, _fig08_to_fig10, _lugs, as_printed, fig11
from treadline.experiments._fig08_to_fig10 import ExciteJob, Recorded
from treadline.experiments._job_pool import Call, Job, JobPool, RunJob
from treadline.experiments._sensitivity import SENSITIVITY, with_nearest, with_sensitivity
from treadline.experiments.plan import (
    CONTROLLER_GROUND,
    PAPER_FRICTION,
    Ground,
    ReproducePlan,
    excitation,
    straight,
    without_images,
)
from treadline.io.runs import provenance
from treadline.plant.mujoco import open_plant
from treadline.report import write_report
from treadline.report.comparison import TILT_DEG

FIT_SEED, FRESH_SEED = 0, 1
"""Seeds of the recording for fitting and of the recording for validation."""
RENDERED_COST = 1.7
"""Processor time of a run with rendered frames over that of one with the statistical camera: 10.9 s and 6.5 s, turns of 80 s on
a loaded machine. It orders jobs and enters no result."""


class Reporter(Protocol):
    """Receives the progress of a reproduction."""

    def begin(self, total: int) -> None:
        """Receive the number of jobs."""

    def done(self, title: str) -> None:
        """Receive the title of a finished job."""

    def running(self, titles: str) -> None:
        """Receive the titles of the jobs that run."""


def reproduce_paper(plan: ReproducePlan, out: Path, *, workers: int, progress: Reporter) -> dict[str, Any]:
    """Run everything and write ``results.json``, ``report.html``, ``model-*.json``, ``controller.json`` and ``runs/``.

    Returns:
        The values of ``results.json``.
    """
    started = time.monotonic()
    runs, figures = out / "runs", out / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    first, second = excitations(plan, runs), _steerless(plan, out)
    third = _drives(plan, as_printed.paper_controller(0.2), runs)  # as many runs as with the controller still to be tuned
    jobs: list[Job[Any]] = [*first, *second, *third]
    pages_of_runs = sum(isinstance(job, ExciteJob | RunJob) for job in jobs) + 1  # and the page of the seat's run
    progress.begin(len(jobs) + pages_of_runs)

    with JobPool(workers, progress.done, progress.running) as pool:
        excited, steerless = pool.begin(first), pool.begin(second)
        controller, fig08_by_ground = learn(plan, excited(), out)
        driven = pool.begin(_drives(plan, controller, runs))
        seat, stages, printed, steered, *opened = steerless()
        kinds, drives = ("turn", "turn-rollback", "straight", "lugs"), driven()
        safe, sliding, closed, lugged = ([run for run in drives if run["kind"] == kind] for kind in kinds)
        progress.running("speed of the simulation")
        values: dict[str, Any] = plain(
            {
                "quick": plan.quick,
                "paper": {"lqr": as_printed.facts()},
                "table1": as_printed.table1(),
                "fig05": stages,
                "fig08": fig08_by_ground[CONTROLLER_GROUND] | {"slopes": list(fig08_by_ground.values())},
                "dead_zone": steered,
                "fig09": _fig08_to_fig10.fig09([*closed, *opened]),
                "fig10": _fig08_to_fig10.fig10(safe),
                "table2": _fig08_to_fig10.table2(safe),
                "table2_roll_back_allowed": _fig08_to_fig10.table2(sliding),
                "lugs": _lugs.rows(lugged),
                "literal": as_printed.facts() | {"runs": [printed]},
                "fig11": seat,
                "controller": {"K": controller.K, "period_s": controller.period_s, **controller.provenance},
                "speed": {
                    "physics_real_time_factor": _physics_real_time_factor(),
                    "loop_cpu_s_per_s": median_high([run["cpu_s"] / run["duration_s"] for run in safe]),
                },
                "gravity_error_deg": TILT_DEG,
                "wall_s": time.monotonic() - started,
                **provenance(),
            }
        )
        values = with_sensitivity(values, with_nearest(read_json(SENSITIVITY)))
        write_json(out / "results.json", values)

        def pages(title: str, function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
            found = pool.map(title, function, items)
            progress.running("report.html")
            return found

        write_report(out, pages)
    return values


def excitations(plan: ReproducePlan, runs: Path) -> list[ExciteJob]:
    """Return the recordings for the identification: one per ground to fit a model, and in a whole plan another to validate it."""
    return [
        ExciteJob(
            ground=ground,
            samples=plan.samples,
            seed=seed,
            runs=runs,
            image_every=50 if ground == CONTROLLER_GROUND and seed == FIT_SEED else 0,
            # The controller is identified with rendered frames; the other grounds need none.
            scenario=None if ground == CONTROLLER_GROUND else without_images(excitation(ground)),
        )
        for ground in plan.grounds
        for seed in ((FIT_SEED,) if plan.quick else (FIT_SEED, FRESH_SEED))
    ]


def learn(plan: ReproducePlan, recordings: Sequence[Recorded], out: Path) -> tuple[ControllerDesign, dict[Ground, dict[str, Any]]]:
    """Return the controller tuned on the identified model, and the figures of each ground; write models and controller."""
    fresh = {job.ground: record for job, record in recordings if job.seed == FRESH_SEED}
    figures: dict[Ground, dict[str, Any]] = {}
    controller: ControllerDesign | None = None
    for job, record in recordings:
        if job.seed != FIT_SEED:
            continue
        ground = job.ground
        model, figures[ground] = _fig08_to_fig10.evaluate(job, record, fresh.get(ground))
        model.save(out / f"model-{ground.name}.json")
        if ground == CONTROLLER_GROUND:
            controller = tune(model)
            controller.save(out / "controller.json")
    if controller is None:
        raise ValueError(f"the plan excites {plan.grounds}, the controller needs {CONTROLLER_GROUND}")
    return controller, figures


def _steerless(plan: ReproducePlan, out: Path) -> list[Job[Any]]:
    """Return the jobs without the identified controller: seat, stages of a frame, printed controller, dead zone, open loops."""
    runs, seed = out / "runs", plan.seeds[0]
    return [
        Call("Fig. 11, seat", fig11.level_seat, (runs / "seat-28", seed)),
        Call("Fig. 5, stages of a frame", _fig05.see_stages, (out / "figures", seed)),
        as_printed.job(plan, runs),
        Call("dead zone, 28°", _dead_zone.rows, (seed,)),
        *_fig08_to_fig10.straight_jobs(plan, None, runs),
    ]


def _drives(plan: ReproducePlan, controller: ControllerDesign, runs: Path) -> list[RunJob]:
    """Return all runs with the identified controller, the longest first: the workers then end together."""
    sliding = replace(plan, seeds=plan.seeds[:1], frictions=(PAPER_FRICTION,), slopes_deg=() if plan.quick else plan.slopes_deg)
    drives = [
        *_fig08_to_fig10.straight_jobs(plan, controller, runs),
        *_fig08_to_fig10.turn_jobs(plan, controller, runs),
        *_fig08_to_fig10.turn_jobs(sliding, controller, runs, "paper"),
        *_lugs.jobs(plan, controller, runs),
    ]
    return sorted(drives, key=_cost, reverse=True)


def _cost(job: RunJob) -> float:
    """Return the processor time that a run takes, up to a factor."""
    is_rendered = job.scenario.sensors.camera_model != "statistical" and job.scenario.control.vision != "truth"
    return job.scenario.drive.duration_s * (RENDERED_COST if is_rendered else 1.0)


def _physics_real_time_factor() -> float:
    """Return simulated seconds per CPU second with the physics alone: median of five spans of 10 s of climbing at 28°."""
    cpu_s = []
    with closing(open_plant(straight(28, "open", 60.0), seed=0)) as plant:
        plant.start()
        for from_s in (0.0, 10.0, 20.0, 30.0, 40.0, 50.0):
            plant.write(TrackCommand(t_s=from_s, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=from_s, rate_m_s=0.0))
            started = time.process_time()
            plant.advance(from_s + 10.0)
            cpu_s.append(time.process_time() - started)
    return 10.0 / median_high(cpu_s[1:])  # in the first span caches and branch predictors warm up
