"""Fig. 8, 9, 10 and Table II in Gazebo, as in the paper: excitation, identification and closed loop, each also in MuJoCo.

Paper: Fig. 8, Fig. 9, Fig. 10, Table II.

Both simulators use the statistical camera (decision 0015), so that only their contact models differ. Each row is one run per seed.
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.files import write_json
from treadline.core.printing import plain
from treadline.experiments import _fig08_to_fig10
from treadline.experiments._fig08_to_fig10 import Recorded
from treadline.experiments._job_pool import JobPool
from treadline.experiments.plan import CONTROLLER_GROUND, PAPER_FRICTION, ReproducePlan, excitation, without_images
from treadline.experiments.reproduce import Reporter, excitations, learn
from treadline.io.runs import provenance
from treadline.plant.gazebo import find_environment
from treadline.run.resolve import PlantName

SIMULATORS: tuple[PlantName, ...] = ("gazebo", "mujoco")


def reproduce_in_gazebo(plan: ReproducePlan, out: Path, *, workers: int, progress: Reporter) -> dict[str, Any]:
    """Run both simulators and write ``results.json``; models, ``controller.json`` and ``runs/`` are in one folder per simulator.

    Returns:
        Content of ``results.json``.

    Raises:
        GazeboError: If Gazebo is not installed; raised before any run.
    """
    find_environment()
    started = time.monotonic()
    plan = replace(plan, quick=False, grounds=(CONTROLLER_GROUND,), frictions=(PAPER_FRICTION,))
    drives = 2 * len(plan.slopes_deg) * (1 + len(plan.seeds))
    progress.begin(len(SIMULATORS) * (len(excitations(plan, out)) + drives))
    found = {name: _paper_in(plan, out / name, name, workers=workers, progress=progress) for name in SIMULATORS}
    values: dict[str, Any] = plain(
        {**found, "compared": compared(found["gazebo"], found["mujoco"]), "wall_s": time.monotonic() - started, **provenance()}
    )
    write_json(out / "results.json", values)
    return values


def compared(gazebo: dict[str, Any], mujoco: dict[str, Any]) -> dict[str, Any]:
    """Return the paper's figures in each simulator, and their differences, over the rows of Table II that both completed."""
    rows = zip(gazebo["table2"], mujoco["table2"], strict=True)
    pairs = [(one["rms_heading_deg"], other["rms_heading_deg"]) for one, other in rows]
    whole = np.array([pair for pair in pairs if None not in pair]).reshape(-1, 2)
    means = whole.mean(axis=0).tolist() if len(whole) else (None, None)
    return {
        "table2_mean_deg": dict(zip(SIMULATORS, means, strict=True)),
        "table2_largest_gap_deg": float(np.abs(whole[:, 0] - whole[:, 1]).max()) if len(whole) else None,
        "straight_closed_worst_rms_deg": {
            name: max(row["rms_heading_deg"] for row in rows["fig09"] if row["loop"] == "closed")
            for name, rows in (("gazebo", gazebo), ("mujoco", mujoco))
        },
    }


def summary(values: dict[str, Any]) -> list[str]:
    """Return the table for people."""
    lines = [
        "Gazebo: its tracked-vehicle plugin's turn rule and pyramid friction; MuJoCo: Coulomb friction",
        "RMS heading [deg]          Gazebo  MuJoCo  paper",
    ]
    for one, other in zip(values["gazebo"]["table2"], values["mujoco"]["table2"], strict=True):
        row = f"Table II {one['slope_deg']} deg from {one['start_heading_deg']:+d}"
        cells = (f"{item['rms_heading_deg']:6.2f}" if item["averaged"] else " ended" for item in (one, other))
        lines.append(f"{row:26s} {'  '.join(cells)}  {one['paper_deg']:5.2f}")
    for one, other in zip(values["gazebo"]["fig09"], values["mujoco"]["fig09"], strict=True):
        row = f"Fig. 9 {one['slope_deg']} deg {one['loop']} loop"
        lines.append(f"{row:26s} {one['rms_heading_deg']:6.2f}  {other['rms_heading_deg']:6.2f}")
    return lines


def _paper_in(plan: ReproducePlan, out: Path, open_plant: PlantName, *, workers: int, progress: Reporter) -> dict[str, Any]:
    def report(what: str) -> None:
        progress.done(f"{open_plant} {what}")

    runs = out / "runs"
    here: dict[str, Any] = {"image_every": 0, "open_plant": open_plant}
    excited = without_images(excitation(CONTROLLER_GROUND))
    with JobPool(workers, report) as pool:
        recordings: list[Recorded] = pool.begin([replace(job, scenario=excited, **here) for job in excitations(plan, runs)])()
        controller, fig08_by_ground = learn(plan, recordings, out)
        straight = [job for steered in (controller, None) for job in _fig08_to_fig10.straight_jobs(plan, steered, runs)]
        drives = [*straight, *_fig08_to_fig10.turn_jobs(plan, controller, runs)]
        results = pool.begin([replace(job, scenario=without_images(job.scenario), **here) for job in drives])()
    turns = [result for result in results if result["kind"] == "turn"]
    values: dict[str, Any] = {
        "fig08": fig08_by_ground[CONTROLLER_GROUND],
        "fig09": _fig08_to_fig10.fig09([result for result in results if result["kind"] == "straight"]),
        "fig10": _fig08_to_fig10.fig10(turns),
        "table2": _fig08_to_fig10.table2(turns),
        "controller": {"K": controller.K, "period_s": controller.period_s, **controller.provenance},
    }
    write_json(out / "results.json", values)
    return values
