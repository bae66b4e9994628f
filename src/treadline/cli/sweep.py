"""``treadline sweep``: many traversals, sampled from the distributions in a file."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Literal

from treadline import sweeps
from treadline.cli._arguments import BLOCKS, BlockOptions, Force, Set, choice, claim, set_values
from treadline.cli._output import Answer, Progress
from treadline.cli.compile import compile_once
from treadline.core.printing import say


def sweep(
    spec: str,
    /,
    *,
    runs: int,
    seed: int = 0,
    out: Path = Path("sweep"),
    changes: Set = None,
    blocks: BlockOptions = BLOCKS,
    sampling: Literal["random", "sobol"] = "random",
    workers: int | None = None,
    cluster: str | None = None,
    resume: bool = False,
    adversarial: bool = False,
    score: str = "min_stability_margin_deg",
    force: Force = False,
) -> Answer:
    """Sample scenarios from a file's distributions, run each, and summarise the outcomes.

    Writes runs.csv (and runs.parquet where pyarrow is installed), summary.json, report.html, spec.toml and manifest.json. Under
    scenarios/ lie the ten worst runs and each run that did not arrive, with the command that repeats it. The exit code is 1 when
    a run fell or failed.

    Args:
        spec: Scenario file with [[draw]] tables, or the name of a shipped one: envelope, outside.
        runs: Number of runs; --resume lengthens an existing sweep. An adversarial search runs whole generations.
        seed: Random seed of the samples and of the runs; run k does not depend on the number of runs.
        out: Folder of the results. Default: sweep.
        sampling: Independent random samples, or a Sobol sequence.
        workers: Number of processes. Default: the number of cores.
        cluster: Address of a Dask scheduler, or "local" to start one here.
        resume: Continue the sweep in the folder, which must be the same sweep.
        adversarial: Search for the worst score within the ranges instead of sampling.
        score: Score that ranks the worst runs, and that the adversarial search minimises.
    """
    from treadline.campaign.sweep import lines
    from treadline.core.errors import SettingsError
    from treadline.run.run_scores import Scores

    choice("--score", score, [field.name for field in fields(Scores) if field.name != "phases"])
    if resume and force:
        raise SettingsError("give --resume or --force, not both: one continues the sweep in the folder, the other replaces it")
    claim(out, force=force, resume=resume)
    with Progress("sweep") as progress:

        def begin(left: int) -> None:
            compile_once()  # mistakes have been found
            progress.begin(left)

        def done(row: Mapping[str, Any], left: int) -> None:
            progress.done(f"run {row['index']:04d} {row['verdict']}, {_spoken(left * progress.part_s)} left")

        try:
            swept = sweeps.sweep(
                spec,
                runs,
                seed,
                out=out,
                set=set_values(changes),
                **asdict(blocks),
                sampling=sampling,
                workers=workers,
                cluster=cluster,
                resume=resume,
                replace=force,
                adversarial=adversarial,
                score=score,
                on_begin=begin,
                on_run=done,
            )
        except KeyboardInterrupt as stopped:
            stopped.add_note("the same command with --resume continues it")
            raise
    summary = swept.summary
    if summary["runs"] < runs:
        say(f"treadline: {summary['runs']} runs of {runs}: a search runs whole generations")
    values = summary | {"run": str(out), "seed": seed, "sampling": sampling}
    worst = summary["worst"][0]
    figure = f"{worst[score]:.4g}" if isinstance(worst[score], float) else worst[score]
    rate = summary["traversals_per_cpu_hour"]
    return Answer(
        values=values,
        summary=[
            *lines(summary),
            f"worst: run {worst['index']:04d} {worst['verdict']}, {score} {figure}; repeat it with",
            f"  {worst['replay']}",
            f"results: {out}/runs.csv; report: {summary['report']}" + (f"; {rate:.0f} runs per CPU hour" if rate else ""),
        ],
        code=int(not swept),
    )


def _spoken(duration_s: float) -> str:
    if duration_s < 90.0:
        return f"{duration_s:.0f} s"
    return f"{duration_s / 60.0:.0f} min" if duration_s < 5400.0 else f"{duration_s / 3600.0:.1f} h"
