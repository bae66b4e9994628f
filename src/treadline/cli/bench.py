"""``treadline bench``: scores of a policy on the tasks of StairBench."""

from pathlib import Path
from typing import Literal

from treadline.cli._arguments import Force, claim, words
from treadline.cli._output import Answer, Progress

TASKS, EPISODES, ALL_EPISODES = ("StairUp", "StairDown", "Straighten", "Kerb", "Buildings"), 60, 200
"""Tasks and episodes of each task; ``--full`` runs all tasks, with more episodes."""


def bench(
    policy: str,
    /,
    *,
    tasks: str | None = None,
    episodes: int | None = None,
    full: bool = False,
    see: Literal["oracle", "tracker"] = "oracle",
    vehicle: str = "wheelchair",
    physics: Literal["nominal", "fast"] = "nominal",
    friction: float | None = None,
    workers: int | None = None,
    out: Path = Path("bench"),
    force: Force = False,
) -> Answer:
    """Score a policy on stairs, kerbs and buildings: episodes of fixed seeds, from 0 to 1, with intervals.

    Writes scores.json, and report.html with side views of the best and the worst episode of each task. Needs the extra bench.

    Args:
        policy: module:Class, file.py:Class, FILE.onnx, or a baseline: random, straight, proportional, or shipped, the mission with
            its planners and its shipped controller.
        tasks: Tasks: StairUp, StairDown, Straighten, Kerb, Buildings, FtrUp, FtrDown. Default: the first five.
        episodes: Number of episodes of each task. Default: 60, with --full 200.
        full: Run all tasks with 200 episodes.
        see: What the policy observes: ground truth (oracle), or the chair's own estimates (tracker).
        vehicle: Shipped chair, or path of a chair's file.
        physics: Numerical settings: nominal, or fast, with which policies learn.
        friction: Belt friction coefficient in place of the tasks' own; FTR-Bench has 10.
        workers: Number of processes. Default: the number of cores.
        out: Folder of the results. Default: bench.
    """
    from treadline.core.errors import SettingsError
    from treadline.core.processes import default_workers

    try:
        from treadline.bench.policies import SHIPPED
        from treadline.bench.scoring import BenchRun, run_bench, table
        from treadline.bench.tasks import TASKS as KNOWN
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        raise SettingsError("treadline bench needs gymnasium, which is missing; pip install 'treadline[bench]'") from None
    count = (ALL_EPISODES if full else EPISODES) if episodes is None else episodes
    if count < 1:
        raise SettingsError(f"--episodes is {count}; at least 1")
    claim(out, force=force)
    named = words("--tasks", tasks) if tasks else tuple(KNOWN) if full else TASKS
    seen: Literal["oracle", "tracker"] = "tracker" if policy == SHIPPED else see
    run = BenchRun(policy=policy, see=seen, vehicle=vehicle, physics=physics, friction=friction)
    with Progress("bench", count * len(named)) as progress:
        values = run_bench(run, named, count, workers or default_workers(), out, progress.done)
    return Answer(values=values, summary=[*table(values), f"report: {values['report']}"])
