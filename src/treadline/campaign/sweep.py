"""Sweep execution: draws, runs, journal, tables, summary.

::

    spec.toml, seed ── sampling ──► Episode k ── pool | cluster ──► Row k ──► journal.jsonl ──► runs.csv, summary.json, report.html

Run k depends only on spec, seed and k, so results are identical with one process, four or a cluster, and after a restart.
"""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.campaign._campaign_page import thumbnail, view_of, write_page
from treadline.campaign._cluster import Cluster
from treadline.campaign._draws import LISTS
from treadline.campaign._journal import Journal
from treadline.campaign._pool import Episode, Pool, Row
from treadline.campaign._results import FAILED, clopper_pearson, flat, harm, has_rms, summarise, write_tables
from treadline.campaign._sobol_sampling import Sampling, generation_size, points, run_seed, search
from treadline.campaign.spec import SHAPE, Spec, scenario_toml
from treadline.core.arrays import CONFIDENCE
from treadline.core.errors import SettingsError
from treadline.core.files import read_json, write_json, write_whole
from treadline.io.runs import git_commit, write_manifest
from treadline.report.labels import channel, suffix

__all__ = [
    "SHOWN", "Cluster", "Episode", "Pool", "Row", "SweepPlan", "clopper_pearson", "has_failures", "lines", "replay_command",
    "run_sweep", "thumbnail", "view_of",
]  # fmt: skip

SHOWN = (
    "min_stability_margin_deg", "max_pitch_rate_deg_s", "aligned_rms_heading_deg", "aligned_max_heading_deg", "rms_heading_deg",
    "steady_rms_heading_deg", "max_abs_heading_deg", "roll_back_m", "seat_max_deg", "passenger_max_m_s2", "passenger_lateral_m_s2",
    "duration_s",
)  # fmt: skip
"""Scores in the printed summary, if present; summary.json has all scores."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """Definition of a sweep: file, number of runs, seed and mode."""

    spec: Spec
    runs: int
    seed: int = 0
    sampling: Sampling = "random"
    adversarial: bool = False
    """Whether to search for the worst score instead of sampling."""
    score: str = "min_stability_margin_deg"
    """Score that ranks the worst runs."""
    climb_options: tuple[str, ...] = ()
    """Options of ``treadline climb`` that all runs share: controller and plug-ins. They are part of what ``--resume`` compares."""

    def __post_init__(self) -> None:
        least = generation_size(self.runs) if self.adversarial else 1
        if self.runs < least:
            raise SettingsError(f"--runs is {self.runs}; at least {least}")
        if self.adversarial and not self.spec.dimension:
            raise SettingsError(f"{self.spec.path}: no random draws, so there is nothing to search; add a draw")

    @property
    def total(self) -> int:
        """Number of runs that will be executed: complete generations of a search."""
        return self.runs - self.runs % generation_size(self.runs) if self.adversarial else self.runs

    @property
    def identity(self) -> dict[str, Any]:
        """Identity that must match on resume; the number of runs may grow, except in a search."""
        same = {"spec": self.spec.digest, "seed": self.seed, "sampling": self.sampling}
        same |= {"options": shlex.join(self.climb_options) or None}
        return same | ({"search for": self.score, "runs": self.runs} if self.adversarial else {"search for": "nothing"})

    def first_points(self) -> Iterator[Float[np.ndarray, " dimension"]]:
        """Yield the points of the cube that no score is needed for: those of all runs, or of a search's first generation."""
        first = generation_size(self.runs) if self.adversarial else self.runs
        return points(self.sampling, self.spec.dimension, self.seed, first)

    def episode(self, index: int, point: Float[np.ndarray, " dimension"]) -> Episode:
        """Return run ``index`` at a point of the unit cube."""
        drawn = self.spec.at(point.tolist(), f"run {index}")
        return Episode(index=index, seed=run_seed(self.seed, index), scenario=drawn.scenario, values=drawn.values)


def run_sweep(
    plan: SweepPlan,
    folder: Path,
    runners: Pool | Cluster,
    *,
    resume: bool,
    begin: Callable[[int], None],
    done: Callable[[Row, int], None],
) -> dict[str, Any]:
    """Execute the missing runs; write and return the summary.

    Args:
        plan: Definition of the sweep.
        folder: Folder of the results.
        runners: Executor of the runs.
        resume: Whether to continue an existing sweep.
        begin: Called with the number of runs to execute.
        done: Called with each row as it ends and the number of remaining runs.
    """
    for index, point in enumerate(plan.first_points()):
        plan.episode(index, point)  # all are validated before the first run
    with runners, Journal(folder, plan.identity, plan.total, resume=resume) as journal:
        _write_what_was_asked(plan, folder)
        left = plan.total - len(journal)
        begin(left)
        try:
            for generation in _generations(plan, journal):
                missing = (plan.episode(index, point) for point, index in generation if index not in journal)
                for row in runners.results(missing):
                    journal.add(row)
                    left -= 1
                    done(row, left)
        except KeyboardInterrupt:
            journal.reload()
            with suppress(SettingsError):
                _write_results(plan, folder, journal)
            raise
        return _write_results(plan, folder, journal)


def _generations(plan: SweepPlan, journal: Journal) -> Iterator[Iterable[tuple[Float[np.ndarray, " dimension"], int]]]:
    """Yield points with the indices of their runs: all at once, or generation after generation of a search.

    The runs of a generation must be in the journal before the next one is drawn; an interrupted search ends there.
    """
    indices = count()
    if not plan.adversarial:
        yield zip(plan.first_points(), indices, strict=False)
        return
    first = np.array(list(plan.first_points()))

    def score(index: int) -> float | None:
        return harm(flat(journal[index]), plan.score) if index in journal else None

    for generation in search(first, score, generations=plan.total // len(first), seed=plan.seed):
        yield zip(generation, indices, strict=False)


def _write_results(plan: SweepPlan, folder: Path, journal: Journal) -> dict[str, Any]:
    """Write tables, scenarios of the worst runs and of all that did not arrive, summary and page; return the summary."""
    files = write_tables(folder, journal)
    drawn = [*dict.fromkeys([draw.key for draw in plan.spec.draws]), *SHAPE]
    choices = dict.fromkeys(draw.key for draw in plan.spec.draws if draw.choice is not None and draw.key not in LISTS)
    summary = summarise(journal, drawn, [key for key in choices if "missing" not in key], plan.score)
    for row in summary["worst"]:
        row["replay"] = replay_command(folder, row, plan.climb_options)
    views = _write_scenarios(plan, folder, journal, {row["index"] for row in summary["worst"]})
    cpu_s = sum(row.get("cpu_s") or 0.0 for row in journal)
    times = {"cpu_s": cpu_s, "traversals_per_cpu_hour": 3600.0 * summary["runs"] / cpu_s if cpu_s else None}
    write_json(folder / "summary.json", summary)
    write_json(folder / "times.json", times)
    page = write_page(folder, summary, times, journal, drawn, views)
    return summary | times | {"files": [str(path) for path in files], "report": str(page)}


def _write_scenarios(plan: SweepPlan, folder: Path, journal: Journal, worst: set[int]) -> dict[int, str]:
    """Write the scenarios of the worst runs and of all that did not arrive; return the side views of the worst."""
    for old in (folder / "scenarios").glob("*.toml"):
        old.unlink()  # with fewer runs it was among the worst
    views: dict[int, str] = {}
    for generation in _generations(plan, journal):
        for point, index in generation:
            if index not in journal or ((row := journal[index])["verdict"] == "arrived" and index not in worst):
                continue
            scenario = plan.episode(index, point).scenario
            note = f"run {index} of {plan.spec.path.name}, seed {plan.seed}: {row['verdict']}"
            write_whole(folder / "scenarios" / f"{index:04d}.toml", scenario_toml(scenario, note))
            if index in worst and (view := thumbnail(row, scenario)) is not None:
                views[index] = view
    return views


def lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the printed lines of the summary."""
    total = summary["runs"]
    said = [f"{total} runs; shares with {100 * CONFIDENCE:.0f} % bounds:"]
    for name, share in sorted(summary["verdicts"].items(), key=lambda item: -item[1]["count"]):
        low, high = (100.0 * bound for bound in share["bounds"])
        said.append(f"  {name:13s} {share['count']:5d}  {100 * share['share']:6.2f} %  ({low:.2f} to {high:.2f})")
    for name in SHOWN:
        if name in summary["scores"]:
            score, unit = summary["scores"][name], suffix(channel(name).unit or "")
            words = [
                word for word in (("rms", "median", "worst") if has_rms(name) else ("median", "worst")) if score[word] is not None
            ]
            figures = ", ".join(f"{'RMS' if word == 'rms' else word} {score[word]:.3g}{unit}" for word in words)
            of = "" if score["averaged"] == score["count"] else f"; averages of {score['averaged']} runs of {score['count']}"
            said.append(f"  {name}: {figures} (run {score['worst_run']:04d}{of})")
    return said


def has_failures(summary: Mapping[str, Any]) -> bool:
    """Whether a run fell or failed."""
    return any(summary["verdicts"].get(verdict, {"count": 0})["count"] for verdict in FAILED)


def replay_command(folder: Path, row: Mapping[str, Any], options: Sequence[str] = ()) -> str:
    """Return the shell command that repeats a run, with the options that all runs of its sweep share."""
    name = f"{row['index']:04d}"
    scenario, out = folder / "scenarios" / f"{name}.toml", folder / "reruns" / name
    return shlex.join(["treadline", "climb", str(scenario), "--seed", str(row["seed"]), "--out", str(out), *options])


def _write_what_was_asked(plan: SweepPlan, folder: Path) -> None:
    """Write spec and manifest. Several commits in it mean that the sweep was continued with another version."""
    manifest = folder / "manifest.json"
    before = read_json(manifest)["settings"]["commits"] if manifest.exists() else []
    commits = list(dict.fromkeys([*before, git_commit()]))
    write_whole(folder / "spec.toml", plan.spec.text)
    asked = {"file": plan.spec.path.name, "runs": plan.runs, "worst by": plan.score, "commits": commits}
    if plan.spec.fixed:
        asked |= {"set": {".".join(keys): value for keys, value in plan.spec.fixed.items()}}
    write_manifest(folder, plan.identity | asked, plan.seed)
