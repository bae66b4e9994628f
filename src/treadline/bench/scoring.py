"""Scores of policies: ``policy, task, seed -> row of an episode -> mean of a task with its interval``.

The score of an episode is ``arrived · min(1, T₀/T) · [margin ≥ 5°] · [passenger ≤ 2.5 m/s²]``, from 0 to 1: T is its duration, T₀
that of the way at the task's speed. The shipped controller runs with its mission and is scored alike.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from treadline.bench.environment import StairEnv
from treadline.bench.observers import OBSERVATION
from treadline.bench.policies import SHIPPED, Policy, Spaces, load_policy
from treadline.bench.tasks import TaskSetup
from treadline.campaign.sweep import Episode, Pool, Row, clopper_pearson, thumbnail, view_of
from treadline.core.arrays import CONFIDENCE
from treadline.core.errors import SettingsError
from treadline.core.files import write_json, write_whole
from treadline.core.ports import Truth
from treadline.io.runs import git_commit
from treadline.playback import RecordingBuilder
from treadline.run.ending import Ending
from treadline.run.episode import Sink, traverse
from treadline.run.run_scores import Scores, Trace, score
from treadline.scenario.scenario import Scenario
from treadline.vehicle.comfort import SETTLED_RAD

MARGIN_DEG = 5.0
"""Least tip-over margin of an episode that counts [°]: the reserve for what is not measured, ``tip_over_margin.UNKNOWN_RAD``."""
PASSENGER_M_S2 = 2.5
"""Largest acceleration of the passenger in an episode that counts [m/s²]: five eighths of that at which a person slides on the
seat, ``run.ending.ROUGH_M_S2``."""
LONGEST_S, PATIENCE_S = 0.1, 5.0
"""Longest mean time of a policy's step [s], five steps of the environment, and time beyond it for loading [s]."""
SCORES = ("duration_s", "min_stability_margin_deg", "passenger_max_m_s2", "final_heading_deg")
KEPT = ("task", "seed", "verdict", "cause", "score", *SCORES)
"""Columns of the stored episodes, and those among them that are scores of the ground truth."""
MERIT = itemgetter("score", "min_stability_margin_deg")
"""Order of episodes: by score, then by the least tip-over margin."""


def episode_score(scores: Scores, par_s: float, *, arrived: bool) -> float:
    """Return the score of an episode, from 0 to 1.

    Args:
        scores: Scores of its ground truth.
        par_s: Duration of the way at the task's speed.
    """
    is_safe = scores.min_stability_margin_deg >= MARGIN_DEG and scores.passenger_max_m_s2 <= PASSENGER_M_S2
    return min(1.0, par_s / scores.duration_s) if arrived and is_safe else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRun(TaskSetup):
    """TaskSetup with a policy: the function from a scenario and its seed to the row of an episode, for the processes of a campaign.

    The shipped controller reads sensors: give it ``see="tracker"``.
    """

    policy: str
    """Source of the policy."""
    physics: str = "nominal"

    def __call__(self, scenario: Scenario, seed: int, watched_s: float) -> Row:
        """Return verdict, score and the pose at the least tip-over margin of one episode."""
        del watched_s
        chair, truths = scenario.read_chair(), list[Truth]()
        builder = RecordingBuilder(chair, scenario, seed=seed)

        def sink(signal: Any, t_s: float) -> None:
            builder(signal, t_s)
            if isinstance(signal, Truth):
                truths.append(signal)

        verdict, cause = (self._shipped if self.policy == SHIPPED else self._driven)(scenario, seed, sink)
        found = score(Trace.of(truths), upward=scenario.drive.direction == "up")
        way_m = Ending(scenario, chair).way_m(truths[0].x_m)
        value = episode_score(found, way_m / scenario.drive.speed_m_s, arrived=verdict == "arrived")
        kept = {name: getattr(found, name) for name in SCORES}
        return {"verdict": verdict, "cause": cause, "score": value} | kept | view_of(builder.build())

    def _driven(self, scenario: Scenario, seed: int, sink: Sink) -> tuple[str, str | None]:
        """Return verdict and cause of an episode of the environment."""
        env = StairEnv(**{item.name: getattr(self, item.name) for item in fields(TaskSetup)})
        env.sink = sink
        policy = load_policy(self.policy)(Spaces(observation=tuple(OBSERVATION), action=tuple(env.scales)))
        (seen, info), taken_s, steps = env.reset(seed=seed, options={"scenario": scenario}), 0.0, 0
        while "verdict" not in info:
            began = time.perf_counter()
            action = _asked(policy, self.policy, seen, steps)
            taken_s, steps = taken_s + time.perf_counter() - began, steps + 1
            if taken_s > LONGEST_S * steps + PATIENCE_S:
                raise SettingsError(f"policy {self.policy} takes {taken_s / steps:.2f} s a step; at most {LONGEST_S:g} s")
            seen, *_, info = env.step(action)
        return info["verdict"], info["cause"]

    def _shipped(self, scenario: Scenario, seed: int, sink: Sink) -> tuple[str, str | None]:
        """Return verdict and cause of a run of the mission."""
        run = traverse(scenario, seed=seed, sink=sink, open_plant=self.open_plant)
        is_square = abs(float(run.trace["heading_rad"][-1])) <= SETTLED_RAD
        arrived = run.verdict == "end_of_flight" and is_square
        return "arrived" if arrived else run.verdict.removesuffix("_rough"), run.cause


def _asked(policy: Policy, source: str, seen: np.ndarray, step: int) -> np.ndarray:
    """Return a policy's action; an error in it is one line that names it."""
    try:
        action = policy(seen)
    except Exception as error:  # the policy is foreign code
        raise SettingsError(f"policy {source} raised {type(error).__name__} at step {step}: {error}") from error
    if action is None:
        raise SettingsError(f"policy {source} returned nothing at step {step}; wanted an array of actions")
    return action


def run_bench(
    run: BenchRun, tasks: Sequence[str], episodes: int, workers: int, out: Path, done: Callable[[str], object]
) -> dict[str, Any]:
    """Run all episodes, write ``scores.json`` and ``report.html``, and return the scores.

    Episodes have the seeds from 0 on, whatever their number.

    Args:
        run: Run of an episode; its task is ignored.
        episodes: Number of episodes of each task.
        done: Called with the name of each episode as it ends.

    Raises:
        SettingsError: If a policy, a vehicle or a task is not usable, or an episode raises an error.
    """
    if run.policy != SHIPPED:
        load_policy(run.policy)  # a mistake is found before a process starts
    setups = [replace(run, task=task) for task in tasks]
    drawn = [
        Episode(index=number, seed=seed, scenario=setup.scenario(seed), values={"task": setup.task})
        for number, (setup, seed) in enumerate(product(setups, range(episodes)))
    ]
    rows: list[Row] = []
    with Pool(run, workers) as pool:
        for row in pool.results(drawn):
            name = f"{row['task']}, seed {row['seed']}"
            if row["verdict"] in {"error", "crashed"}:
                raise SettingsError(f"{name}: {row['cause'].removeprefix('SettingsError: ')}")
            rows.append(row)
            done(f"{name}: {row['verdict']}")
    rows.sort(key=itemgetter("index"))
    found = {task: [row for row in rows if row["task"] == task] for task in tasks}
    values = {name: getattr(run, name) for name in ("policy", "see", "vehicle", "physics", "friction")}
    values |= {"commit": git_commit(), "tasks": {task: summarise(found[task]) for task in tasks}}
    write_json(out / "scores.json", values | {"episodes": [{name: row[name] for name in KEPT} for row in rows]})
    return values | {"report": str(_write_page(drawn, found, values, out))}


def table(values: Mapping[str, Any]) -> list[str]:
    """Return the printed lines of the scores."""
    said = [f"{values['policy']}, {values['see']}, {values['physics']} physics; scores with {100 * CONFIDENCE:.0f} % bounds:"]
    for name, task in values["tasks"].items():
        low, high = task["interval"]
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in task["verdicts"].items())
        said.append(f"  {name:11s} {task['score']:.3f}  ({low:.3f} to {high:.3f})  {task['episodes']} episodes: {verdicts}")
    return said


def _write_page(drawn: Sequence[Episode], found: Mapping[str, Sequence[Row]], values: Mapping[str, Any], out: Path) -> Path:
    from markupsafe import Markup

    from treadline.report.html_pages import page_of

    def view(row: Row) -> Markup:
        return Markup(thumbnail(row, drawn[row["index"]].scenario) or "")  # noqa: S704 - drawn by this package

    shown = {task: {"best": max(rows, key=MERIT), "worst": min(rows, key=MERIT)} for task, rows in found.items()}
    write_whole(out / "report.html", page_of("bench.html.j2", {}, values=values, shown=shown, view=view))
    return out / "report.html"


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Return mean score, interval and counts of a task's episodes.

    The interval is that of a proportion: of all numbers from 0 to 1 with one mean, those that are 0 or 1 vary most.
    """
    scores = np.array([row["score"] for row in rows])
    verdicts = [row["verdict"] for row in rows]
    return {
        "episodes": len(rows),
        "score": float(scores.mean()),
        "interval": list(clopper_pearson(float(scores.sum()), len(rows))),
        "verdicts": {name: verdicts.count(name) for name in sorted(set(verdicts))},
        "duration_s": float(np.median([row["duration_s"] for row in rows])),
    }
