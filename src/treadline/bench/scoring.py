"""Scores of policies: ``policy, task, seed -> row of an episode -> mean of a task with its interval``.

The score of an episode is ``arrived · min(1, T₀/T) · [margin ≥ 5°] · [passenger ≤ 2.5 m/s²]``, from 0 to 1: T is its duration, T₀
that of the way at the task's speed. The shipped controller runs with its mission and is scored alike.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from treadline.bench.environment import PHYSICS, StairEnv
from treadline.bench.observers import OBSERVATION
from treadline.bench.policies import SHIPPED, Policy, Spaces, load_policy
from treadline.bench.tasks import TASKS, See, draw
from treadline.campaign.sweep import Episode, Pool, Row, clopper_pearson, thumbnail, view_of
from treadline.core.arrays import CONFIDENCE
from treadline.core.errors import SettingsError
from treadline.core.files import write_json, write_whole
from treadline.core.ports import Truth
from treadline.io.runs import git_commit
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.playback import RecordingBuilder
from treadline.run.ending import Ending
from treadline.run.episode import traverse
from treadline.run.run_scores import Scores, Trace, score
from treadline.scenario.scenario import Scenario
from treadline.vehicle.comfort import SETTLED_RAD

MARGIN_DEG = 5.0
"""Least tip-over margin of an episode that counts [°]: the reserve for what is not measured, ``tip_over_margin.UNKNOWN_RAD``."""
PASSENGER_M_S2 = 2.5
"""Largest acceleration of the passenger in an episode that counts [m/s²]: five eighths of that at which a person slides on the
seat, ``run.ending.ROUGH_M_S2``."""
STEP_S, PATIENCE_S = 0.1, 5.0
"""Longest mean time of a policy's step [s], five steps of the environment, and time beyond it for loading [s]."""


def episode_score(scores: Scores, par_s: float, *, arrived: bool) -> float:
    """Return the score of an episode, from 0 to 1.

    Args:
        scores: Scores of its ground truth.
        par_s: Duration of the way at the task's speed.
    """
    is_safe = scores.min_stability_margin_deg >= MARGIN_DEG and scores.passenger_max_m_s2 <= PASSENGER_M_S2
    return min(1.0, par_s / scores.duration_s) if arrived and is_safe else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRun:
    """Function from a scenario and its seed to the row of an episode, for the processes of a campaign."""

    policy: str
    """Source of the policy."""
    task: str
    see: See = "oracle"
    vehicle: str = "wheelchair"
    physics: str = "nominal"
    friction: float | None = None

    def scenario(self, seed: int) -> Scenario:
        """Return the scenario of a seed; the shipped controller reads its sensors."""
        return draw(self.task, seed, see="tracker" if self.policy == SHIPPED else self.see, vehicle=self.vehicle)

    def environment(self) -> StairEnv:
        """Return the environment of the task."""
        settings = {name: value for name, value in asdict(self).items() if name != "policy"}
        return StairEnv(**settings)

    def __call__(self, scenario: Scenario, seed: int, watched_s: float) -> Row:
        """Return verdict, score and the pose at the least tip-over margin of one episode."""
        del watched_s
        return self._shipped(scenario, seed) if self.policy == SHIPPED else self._driven(seed)

    def _driven(self, seed: int) -> Row:
        env, truths = self.environment(), list[Truth]()
        maker = load_policy(self.policy)
        policy = maker(Spaces(observation=tuple(OBSERVATION), action=tuple(env.scales)))
        # The builder is known once the scenario is drawn, and the first readings come with the reset.
        signals: list[tuple[Any, float]] = []
        env.sink = lambda signal, t_s: signals.append((signal, t_s))
        seen, info = env.reset(seed=seed)
        over, taken_s, steps = False, 0.0, 0
        while not over:
            began = time.perf_counter()
            action = _asked(policy, self.policy, seen, steps)
            taken_s, steps = taken_s + time.perf_counter() - began, steps + 1
            if taken_s > STEP_S * steps + PATIENCE_S:
                raise SettingsError(f"policy {self.policy} takes {taken_s / steps:.2f} s a step; at most {STEP_S:g} s")
            seen, _, ended, late, info = env.step(action)
            over = ended or late
        builder = RecordingBuilder(env.chair, env.scenario, seed=seed)
        for signal, t_s in signals:
            builder(signal, t_s)
            if isinstance(signal, Truth):
                truths.append(signal)
        env.close()
        return self._row(Trace.of(truths), env.way_m, env.scenario, info["verdict"], info["cause"]) | view_of(builder.build())

    def _shipped(self, scenario: Scenario, seed: int) -> Row:
        builder = RecordingBuilder(scenario.read_chair(), scenario, seed=seed)
        run = traverse(scenario, seed=seed, sink=builder, open_plant=self._opened)
        ending, trace, verdict = Ending(scenario, scenario.read_chair()), run.trace, run.verdict
        if verdict == "end_of_flight" and abs(float(trace["heading_rad"][-1])) <= SETTLED_RAD:
            verdict = "arrived"
        way_m = ending.way_m(float(trace["x_m"][0]), on_flight=TASKS[self.task].on_flight)
        return self._row(trace, way_m, scenario, verdict.removesuffix("_rough"), run.cause) | view_of(builder.build())

    def _opened(self, scenario: Scenario, seed: int) -> MujocoPlant:
        plant = open_plant(scenario, seed, physics=PHYSICS[self.physics])
        if self.friction is not None:
            plant.set_friction(self.friction)
        return plant

    def _row(self, trace: Trace, way_m: float, scenario: Scenario, verdict: str, cause: str | None) -> Row:
        found = score(trace, upward=scenario.drive.direction == "up")
        value = episode_score(found, way_m / scenario.drive.speed_m_s, arrived=verdict == "arrived")
        kept = ("duration_s", "min_stability_margin_deg", "passenger_max_m_s2", "final_heading_deg")
        return {"verdict": verdict, "cause": cause, "score": value} | {name: getattr(found, name) for name in kept}


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
    runs: Mapping[str, BenchRun], episodes: int, workers: int, out: Path, done: Callable[[str], object]
) -> dict[str, Any]:
    """Run all episodes, write ``scores.json`` and ``report.html``, and return the scores.

    Episodes have the seeds from 0 on, whatever their number.

    Args:
        runs: Run of each task.
        done: Called with the name of each episode as it ends.

    Raises:
        SettingsError: If a policy, a vehicle or a task is not usable, or an episode raises an error.
    """
    found: dict[str, list[Row]] = {}
    for name, run in runs.items():
        if run.policy != SHIPPED:
            load_policy(run.policy)  # a mistake is found before a process starts
            run.environment()
        drawn = [Episode(index=seed, seed=seed, scenario=run.scenario(seed), values={}) for seed in range(episodes)]
        with Pool(run, workers) as pool:
            for row in pool.results(drawn):
                if row["verdict"] in {"error", "crashed"}:
                    raise SettingsError(f"{name}, seed {row['seed']}: {row['cause'].removeprefix('SettingsError: ')}")
                found.setdefault(name, []).append(row)
                done(f"{name} {row['seed']:03d} {row['verdict']}")
    for rows in found.values():
        rows.sort(key=lambda row: row["index"])
    settings = asdict(next(iter(runs.values())))
    del settings["task"]
    values = settings | {"commit": git_commit(), "tasks": {name: summarise(rows) for name, rows in found.items()}}
    write_json(
        out / "scores.json", values | {"episodes": {name: [_without_view(row) for row in rows] for name, rows in found.items()}}
    )
    return values | {"report": str(_write_page(runs, found, values, out))}


def table(values: Mapping[str, Any]) -> list[str]:
    """Return the printed lines of the scores."""
    said = [f"{values['policy']}, {values['see']}, {values['physics']} physics; scores with {100 * CONFIDENCE:.0f} % bounds:"]
    for name, task in values["tasks"].items():
        low, high = task["interval"]
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in task["verdicts"].items())
        said.append(f"  {name:11s} {task['score']:.3f}  ({low:.3f} to {high:.3f})  {task['episodes']} episodes: {verdicts}")
    return said


def _without_view(row: Row) -> Row:
    return {name: value for name, value in row.items() if name not in {"view", "cpu_s", "index"}}


def _write_page(runs: Mapping[str, BenchRun], found: Mapping[str, Sequence[Row]], values: Mapping[str, Any], out: Path) -> Path:
    from markupsafe import Markup

    from treadline.report.html_pages import page_of

    views: dict[str, list[tuple[str, Row, Markup]]] = {}
    for number, (name, rows) in enumerate(found.items()):
        for kind, row in (("best", max(rows, key=_merit)), ("worst", min(rows, key=_merit))):
            # Ids of drawings are unique on the page.
            drawn = thumbnail(row | {"index": 2 * number + (kind == "best")}, runs[name].scenario(row["seed"]))
            views.setdefault(name, []).append((kind, row, Markup(drawn or "")))  # noqa: S704 - drawn by this package
    write_whole(out / "report.html", page_of("bench.html.j2", {}, values=values, views=views))
    return out / "report.html"


def _merit(row: Row) -> tuple[float, float]:
    """Return the order of episodes: by score, then by the least tip-over margin."""
    return row["score"], row["min_stability_margin_deg"]


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Return mean score, interval and counts of a task's episodes.

    The interval is that of a proportion: of all numbers from 0 to 1 with one mean, those that are 0 or 1 vary most.
    """
    scores = np.array([row.get("score") or 0.0 for row in rows])
    verdicts = [row["verdict"] for row in rows]
    return {
        "episodes": len(rows),
        "score": float(scores.mean()),
        "interval": list(clopper_pearson(float(scores.sum()), len(rows))),
        "verdicts": {name: verdicts.count(name) for name in sorted(set(verdicts))},
        "duration_s": float(np.median([row.get("duration_s") or 0.0 for row in rows])),
    }
