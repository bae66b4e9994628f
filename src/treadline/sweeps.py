"""Many simulated traversals from Python: ``tl.sweep``.

Nothing heavy is imported at the top: each function loads what it needs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from treadline.core.printing import Printable, pandas_for

if TYPE_CHECKING:
    from treadline.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sweep(Printable):
    """Result of many simulated traversals, as ``tl.sweep`` returns it; true if no run fell or failed.

    Examples:
        >>> import treadline as tl
        >>> slopes = {"drive": {"duration_s": 1}, "draw": [{"key": "stair.slope_deg", "uniform": [24, 28]}]}
        >>> swept = tl.sweep(slopes, 1, out="slopes", set={"sensors.camera": "statistical"}, workers=1)
        >>> bool(swept), swept.summary["verdicts"]["time_up"]["count"]
        (True, 1)
    """

    summary: dict[str, Any]
    """What ``summary.json`` holds: ``runs``, ``verdicts`` with shares and bounds, ``scores``, ``worst`` and others."""
    folder: Path
    """Folder of the results: runs.csv, report.html, journal.jsonl and the scenarios of the worst runs."""

    def __bool__(self) -> bool:
        """Return whether no run fell or failed."""
        from treadline.campaign.sweep import has_failures

        return not has_failures(self.summary)

    def frame(self) -> Any:
        """Return the runs as a data frame of pandas: drawn values, verdict and scores.

        Raises:
            TreadlineError: If pandas is not installed.
        """
        return pandas_for("sweep.frame()").read_csv(self.folder / "runs.csv", index_col="index")

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the number of runs, and the share of each verdict with its bounds of 95 %."""
        rows = []
        for name, share in self.summary["verdicts"].items():
            low, high = (100.0 * bound for bound in share["bounds"])
            rows.append((name, f"{share['count']} ({100.0 * share['share']:.1f} %, {low:.1f} to {high:.1f})"))
        return f"{self.summary['runs']} runs; report: {self.summary['report']}", rows


@dataclass(frozen=True, slots=True, kw_only=True)
class RunScenario:
    """Function from a scenario and a seed to the summary of one run, for the processes of a campaign.

    Plug-ins are named by text, so that each process loads them itself.
    """

    controller: str | None = None
    detector: str | None = None
    estimator: str | None = None

    def __call__(self, scenario: "Scenario", seed: int, watched_s: float) -> Mapping[str, Any]:
        """Return the summary of one run; a held chair is simulated for ``watched_s`` more seconds."""
        from treadline.campaign.sweep import view_of
        from treadline.playback import RecordingBuilder
        from treadline.run.episode import run_episode
        from treadline.run.resolve import resolve

        setup = resolve(scenario, self.controller, seed, detector=self.detector, estimator=self.estimator)
        builder = RecordingBuilder(setup.mission.chair, setup.scenario, seed=seed)
        summary = run_episode(setup, sink=builder, after_hold_s=watched_s).summary()
        return summary | view_of(builder.build())


def sweep(
    spec: str | Path | Mapping[str, object],
    runs: int,
    seed: int = 0,
    *,
    out: str | Path,
    set: "Mapping[str, object] | None" = None,  # noqa: A002 - as --set
    controller: str | None = None,
    detector: str | None = None,
    estimator: str | None = None,
    sampling: Literal["random", "sobol"] = "random",
    workers: int | None = None,
    cluster: str | None = None,
    resume: bool = False,
    replace: bool = False,
    adversarial: bool = False,
    score: str = "min_stability_margin_deg",
    on_begin: Callable[[int], None] | None = None,
    on_run: Callable[[Mapping[str, Any], int], None] | None = None,
) -> Sweep:
    """Return the results of many simulated traversals, sampled from stated distributions.

    The processes of a sweep import the main program anew: in a script, call this under ``if __name__ == "__main__":``.

    Args:
        spec: Scenario file with ``[[draw]]`` tables, name of a shipped one, or what such a file holds as a dict.
        runs: Number of runs; with ``resume`` it lengthens an existing sweep. An adversarial search runs whole generations.
        seed: Random seed of the samples and of the runs; run k does not depend on the number of runs.
        out: Folder of the results.
        set: Values that hold in every run, by dotted key, as in ``tl.read_scenario``.
        controller: Controller file, ``module:Class``, or entry point name: text, since each process loads it.
        detector: Stair detector, likewise.
        estimator: Heading estimator, likewise.
        sampling: Independent random samples, or a Sobol sequence.
        workers: Number of processes; the number of cores when left out.
        cluster: Address of a Dask scheduler, or ``local`` to start one here.
        resume: Whether to continue the sweep in the folder, which must be the same sweep.
        replace: Whether to replace an existing sweep.
        adversarial: Whether to search for the worst score within the ranges instead of sampling.
        score: Score that ranks the worst runs, and that the search minimises.
        on_begin: Receives the number of runs to execute.
        on_run: Receives the row of each run as it ends, and the number of runs left.

    Raises:
        SettingsError: If the spec, an option or a plug-in is invalid, or the folder holds another sweep.

    Examples:
        >>> import treadline as tl
        >>> slopes = {"drive": {"duration_s": 1}, "draw": [{"key": "stair.slope_deg", "uniform": [24, 28]}]}
        >>> tl.sweep(slopes, 2, out="slopes", set={"sensors.camera": "statistical"}, workers=1).summary["runs"]
        2
    """
    from treadline.campaign.spec import read_spec
    from treadline.campaign.sweep import Cluster, Pool, SweepPlan, run_sweep
    from treadline.core.processes import default_workers
    from treadline.io.runs import JOURNAL, remove
    from treadline.run.resolve import resolved_blocks

    resolved_blocks(controller, detector, estimator)  # loaded once here, so that a mistake is found before a process starts
    blocks = {"controller": controller, "detector": detector, "estimator": estimator}
    plan = SweepPlan(
        spec=read_spec(spec, set),
        runs=runs,
        seed=seed,
        sampling=sampling,
        adversarial=adversarial,
        score=score,
        climb_options=tuple(word for name, value in blocks.items() if value is not None for word in (f"--{name}", value)),
    )
    count, run = min(workers or default_workers(), plan.total), RunScenario(**blocks)
    runners = Pool(run, count) if cluster is None else Cluster(run, cluster, count)
    if replace:
        remove(Path(out), (JOURNAL,))
    begin, done = on_begin or (lambda _left: None), on_run or (lambda _row, _left: None)
    return Sweep(summary=run_sweep(plan, Path(out), runners, resume=resume, begin=begin, done=done), folder=Path(out))
