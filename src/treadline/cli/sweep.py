"""``treadline sweep``: many traversals, drawn from what a file says."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from treadline.cli.answer import Answer
from treadline.cli.numbers import choice
from treadline.cli.progress import Progress

if TYPE_CHECKING:
    from treadline.scenario import Scenario


def sweep(
    spec: str,
    /,
    *,
    runs: int,
    seed: int = 0,
    out: Path = Path("sweep"),
    sampling: Literal["random", "sobol"] = "random",
    workers: int | None = None,
    cluster: str | None = None,
    resume: bool = False,
    adversarial: bool = False,
    score: str = "min_stability_margin_deg",
) -> Answer:
    """Draw scenarios from a file's distributions, fly each, and count what became of them.

    Writes runs.csv (and runs.parquet where pyarrow is installed), summary.json, report.html, spec.toml, manifest.json, and
    under scenarios/ each run that did not arrive and the ten worst, with the command that flies it again. The exit code is
    1 when a run fell or failed.

    Args:
        spec: A scenario file with [[draw]] tables, or the name of a shipped one: envelope, outside.
        runs: How many; a sweep that is there is lengthened with --resume. A search flies whole generations of them.
        seed: Of the draws and of all that chance does in the runs; run k is the same however many there are.
        out: Folder of the results.
        sampling: Each run by itself, or Sobol's points, which leave no gaps.
        workers: Processes; as many as there are cores when left out.
        cluster: Address of a Dask scheduler, or "local" to start one here.
        resume: Go on with the sweep in the folder, which must be this one.
        adversarial: Look for the worst score within the ranges instead of drawing.
        score: What the worst runs are worst at, and what the adversary looks for.
    """
    from treadline.campaign.cluster import Cluster
    from treadline.campaign.pool import Pool
    from treadline.campaign.spec import read_spec
    from treadline.campaign.summary import FAILED, lines
    from treadline.campaign.sweep import SweepPlan, run_sweep
    from treadline.errors import SettingsError
    from treadline.processes import default_workers

    if workers is not None and workers < 1:
        raise SettingsError(f"--workers is {workers}; at least 1")
    choice("--score", score, scores())
    plan = SweepPlan(spec=read_spec(spec), runs=runs, seed=seed, sampling=sampling, adversarial=adversarial, score=score)
    count = min(workers or default_workers(), plan.total)
    runners = Pool(fly, count) if cluster is None else Cluster(fly, cluster, count)
    if plan.total < runs:
        sys.stderr.write(f"treadline: {plan.total} runs of {runs}: a search flies whole generations\n")
    try:
        with _Left() as progress:
            summary = run_sweep(plan, out, runners, resume=resume, begin=progress.begin, done=progress.done)
    except KeyboardInterrupt as stopped:
        stopped.add_note("the same command with --resume goes on with it")
        raise
    values = summary | {"run": str(out), "seed": seed, "sampling": sampling}
    worst = summary["worst"][0]
    rate = summary["traversals_per_cpu_hour"]
    return Answer(
        values=values,
        summary=[
            *lines(summary),
            f"worst: run {worst['index']:04d} {worst['verdict']}, {score} {_short(worst[score])}; fly it again with",
            f"  {worst['replay']}",
            f"results: {out}/runs.csv; report: {summary['report']}" + (f"; {rate:.0f} runs per CPU hour" if rate else ""),
        ],
        code=int(any(summary["verdicts"].get(verdict, {"count": 0})["count"] for verdict in FAILED)),
    )


def scores() -> tuple[str, ...]:
    """Return the names of the scores of a traversal that are numbers."""
    from dataclasses import fields

    from treadline.experiments.scores import Scores

    return tuple(field.name for field in fields(Scores) if field.name != "phases")


def fly(scenario: "Scenario", seed: int, watched_s: float) -> Mapping[str, Any]:
    """Return what one traversal came to; here the campaign gets its simulator, as the mission gets its plant."""
    from treadline.experiments.shipped import shipped_controller
    from treadline.experiments.traverse import traverse
    from treadline.mechanics.chair import read_chair

    controller = shipped_controller(read_chair(scenario.chair.model).name)
    return traverse(scenario, controller=controller, seed=seed, after_hold_s=watched_s).summary()


class _Left:
    """Progress by runs, with the time that is left: the pace so far, for those still to come."""

    def __init__(self) -> None:
        self._progress: Progress | None = None
        self._started, self._flown = 0.0, 0

    def __enter__(self) -> "_Left":
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.__exit__(None, None, None)

    def begin(self, left: int) -> None:
        """Start the clock; of a sweep that is gone on with, only what is left counts."""
        self._started = time.monotonic()
        if left:
            self._progress = Progress("sweep", left)
            self._progress.__enter__()

    def done(self, row: Mapping[str, Any], left: int) -> None:
        """Count one run."""
        self._flown += 1
        left_s = (time.monotonic() - self._started) / self._flown * left
        if self._progress is not None:
            self._progress.done(f"run {row['index']:04d} {row['verdict']}, {_spoken(left_s)} left")


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _spoken(duration_s: float) -> str:
    if duration_s < 90.0:
        return f"{duration_s:.0f} s"
    return f"{duration_s / 60.0:.0f} min" if duration_s < 5400.0 else f"{duration_s / 3600.0:.1f} h"
