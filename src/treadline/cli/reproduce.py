"""``treadline reproduce``: every figure and table of the paper; ``treadline report``: the page of a run or of all runs."""

from pathlib import Path

from treadline.cli._arguments import Force, choice, claim
from treadline.cli._output import Answer
from treadline.cli.compile import compile_once


def reproduce(
    *,
    out: Path = Path("reproduce"),
    quick: bool = False,
    workers: int | None = None,
    plant: str = "mujoco",
    seeds: int | None = None,
    force: Force = False,
) -> Answer:
    """Reproduce the paper and write one report that compares our figures with the paper's.

    Excites, identifies, tunes, climbs, levels the seat and detects the stair on 25, 28 and 30°; writes report.html, results.json,
    figures/*.svg and runs/.

    Args:
        out: Folder of the results. Default: reproduce.
        quick: Run fewer items, each at its full length, in about a minute: Eq. (12) to (14), Fig. 5, 8, 10 and 11, Table II at 28°.
        workers: Number of processes. Default: the number of cores.
        plant: Simulator: mujoco, or gazebo (Fig. 8, 9, 10 and Table II in Gazebo 11, with a controller identified there, next to
            MuJoCo).
        seeds: Number of seeds of Table II; published figures have five. Default: two; one with --quick or --plant gazebo.
    """
    import time
    from dataclasses import replace

    from treadline.cli._output import Progress
    from treadline.core.errors import SettingsError
    from treadline.core.processes import default_workers
    from treadline.experiments import gazebo
    from treadline.experiments.plan import QUICK, WHOLE
    from treadline.experiments.reproduce import reproduce_paper
    from treadline.io.runs import remove
    from treadline.report.comparison import PUBLISHED_SEEDS, answer

    choice("--plant", plant, ("mujoco", "gazebo"))
    plan = QUICK if quick else WHOLE
    if seeds is not None and not 1 <= seeds <= PUBLISHED_SEEDS:
        raise SettingsError(f"--seeds is {seeds}; from 1 to {PUBLISHED_SEEDS}")
    plan = replace(plan, seeds=tuple(range(seeds or (1 if plant == "gazebo" else len(plan.seeds)))))
    claim(out, force=force)
    remove(out, ("results.json", "report.html"))  # an interrupted run must not leave an older result
    compile_once()
    started = time.monotonic()
    run = gazebo.reproduce_in_gazebo if plant == "gazebo" else reproduce_paper
    with Progress("reproduce") as progress:
        values = run(plan, out, workers=workers or default_workers(), progress=progress)
    done = f"done in {time.monotonic() - started:.0f} s; results: {out / 'results.json'}"
    if plant == "gazebo":
        return Answer(values=values, summary=[*gazebo.summary(values), done])
    return Answer(values=values, summary=[*answer(values), done, f"report: {out / 'report.html'}"])


def report(run: Path, /) -> Answer:
    """Draw the report of a run folder, or of a whole reproduce folder, from its files alone.

    Args:
        run: A folder that climb, or reproduce, wrote.
    """
    from treadline.report import write_report

    path = write_report(run)
    return Answer(values={"path": str(path)}, summary=[f"report: {path}"])
