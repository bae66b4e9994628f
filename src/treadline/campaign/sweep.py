"""A sweep, whole: draws, flights, journal, tables, summary.

::

    spec.toml, seed ── sampling ──► Flight k ── pool | cluster ──► Row k ──► journal.jsonl ──► runs.csv, summary.json, report.html

Run k is a function of spec, seed and k alone. So results are the same with one process, four or a cluster, and after a kill.
"""

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.campaign.journal import Journal
from treadline.campaign.page import write_page
from treadline.campaign.places import LISTS
from treadline.campaign.pool import Runners
from treadline.campaign.run import Flight, Row
from treadline.campaign.sampling import Sampling, points, run_seed
from treadline.campaign.scenario_file import scenario_toml
from treadline.campaign.search import budget, generation_size, search
from treadline.campaign.spec import SHAPE, Spec
from treadline.campaign.summary import harm, summarise
from treadline.campaign.tables import flat, write_tables
from treadline.errors import SettingsError
from treadline.io.plain import plain
from treadline.io.provenance import git_commit
from treadline.io.runs import write_manifest
from treadline.models import read_json, write_whole

MARGIN = "min_stability_margin_deg"


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """What is to be flown."""

    spec: Spec
    runs: int
    seed: int = 0
    sampling: Sampling = "random"
    adversarial: bool = False
    """Search for the worst score instead of drawing."""
    score: str = MARGIN
    """What the worst runs are worst at."""

    climb_options: tuple[str, ...] = ()
    """Options of ``treadline climb`` that all runs share: controller and plug-ins. They are part of what ``--resume`` compares."""

    def __post_init__(self) -> None:
        least = generation_size(self.runs) if self.adversarial else 1
        if self.runs < least:
            raise SettingsError(f"--runs is {self.runs}; at least {least}")
        if self.seed < 0:
            raise SettingsError(f"--seed is {self.seed}; at least 0")
        if self.adversarial and not self.spec.dimension:
            raise SettingsError(f"{self.spec.path}: chance decides nothing here, so there is nothing to search; draw something")

    @property
    def total(self) -> int:
        """Number of runs that will be made."""
        return budget(self.runs) if self.adversarial else self.runs

    @property
    def identity(self) -> dict[str, Any]:
        """What must be the same for a sweep to be gone on with; more runs may be asked for, but not of a search."""
        same = {"spec": self.spec.digest, "seed": self.seed, "sampling": self.sampling}
        same |= {"options": shlex.join(self.climb_options)} if self.climb_options else {"options": None}
        return same | ({"search for": self.score, "runs": self.runs} if self.adversarial else {"search for": "nothing"})

    def flight(self, index: int, point: Float[np.ndarray, " dimension"]) -> Flight:
        """Return run ``index``, at a point of the cube."""
        drawn = self.spec.at(point.tolist(), f"run {index}")
        return Flight(index=index, seed=run_seed(self.seed, index), scenario=drawn.scenario, values=drawn.values)


def fly_sweep(
    plan: SweepPlan,
    folder: Path,
    runners: Runners,
    *,
    resume: bool,
    begin: Callable[[int], None],
    done: Callable[[Row, int], None],
) -> dict[str, Any]:
    """Fly what is not flown yet; write and return the summary.

    Args:
        plan: What is to be flown.
        folder: Where the results go.
        runners: Who flies.
        resume: Go on with the sweep that is there.
        begin: Hears how many there are to fly.
        done: Hears each row as it ends, and how many are left.
    """
    count = generation_size(plan.runs) if plan.adversarial else plan.runs
    cube = points(plan.sampling, plan.spec.dimension, plan.seed, count)
    first = [plan.flight(index, point) for index, point in enumerate(cube)]  # all are checked before one is flown
    flown: dict[int, Flight] = {}
    with runners, Journal(folder, plan.identity, resume=resume) as journal:
        _write_what_was_asked(plan, folder)
        begin(_left(plan, journal))

        def fly(flights: Sequence[Flight]) -> None:
            flown.update((flight.index, flight) for flight in flights)
            for row in runners.results([flight for flight in flights if flight.index not in journal.rows]):
                journal.add(row)
                done(row, _left(plan, journal))

        try:
            if plan.adversarial:
                _search(plan, cube, fly, journal)
            else:
                fly(first)
        except KeyboardInterrupt:
            journal.look_again()
            with suppress(SettingsError):
                write_results(plan, folder, journal.rows, flown)
            raise
        return write_results(plan, folder, journal.rows, flown)


def write_results(plan: SweepPlan, folder: Path, rows: Mapping[int, Row], flights: Mapping[int, Flight]) -> dict[str, Any]:
    """Write tables, scenarios of the worst and of all that did not arrive, summary and page; return the summary."""
    kept = [rows[index] for index in sorted(rows) if index in flights]
    files = write_tables(folder, kept)
    drawn = [*dict.fromkeys([draw.key for draw in plan.spec.draws]), *SHAPE]
    choices = dict.fromkeys(draw.key for draw in plan.spec.draws if draw.choice is not None and draw.key not in LISTS)
    flat_rows = [flat(row) for row in kept]
    summary = summarise(flat_rows, drawn, [key for key in choices if "missing" not in key], plan.score)
    wanted = {row["index"] for row in kept if row["verdict"] != "arrived"} | {row["index"] for row in summary["worst"]}
    for old in (folder / "scenarios").glob("*.toml"):
        old.unlink()  # fewer runs ago it was among the worst
    for index in sorted(wanted):
        note = f"run {index} of {plan.spec.path.name}, seed {plan.seed}: {rows[index]['verdict']}"
        write_whole(folder / "scenarios" / f"{index:04d}.toml", scenario_toml(flights[index].scenario, note))
    for row in summary["worst"]:
        row["replay"] = replay_command(folder, row, plan.climb_options)
    cpu_s = sum(row.get("cpu_s") or 0.0 for row in kept)
    times = {"cpu_s": cpu_s, "traversals_per_cpu_hour": 3600.0 * len(kept) / cpu_s if cpu_s else None}
    _write_json(folder / "summary.json", summary)
    _write_json(folder / "times.json", times)
    page = write_page(folder, summary, times, flat_rows, drawn)
    return summary | times | {"files": [str(path) for path in files], "report": str(page)}


def replay_command(folder: Path, row: Mapping[str, Any], options: Sequence[str] = ()) -> str:
    """Return the command that flies a run again, for a shell."""
    name = f"{row['index']:04d}"
    scenario, out = folder / "scenarios" / f"{name}.toml", folder / "flown" / name
    return shlex.join(["treadline", "climb", str(scenario), "--seed", str(row["seed"]), "--out", str(out), *options])


def _left(plan: SweepPlan, journal: Journal) -> int:
    return plan.total - sum(index < plan.total for index in journal.rows)


def _search(
    plan: SweepPlan,
    cube: Float[np.ndarray, "count dimension"],
    fly: Callable[[Sequence[Flight]], None],
    journal: Journal,
) -> None:
    found: list[float] = []

    def evaluate(generation: Float[np.ndarray, "count dimension"]) -> list[float]:
        flights = [plan.flight(len(found) + i, point) for i, point in enumerate(generation)]
        fly(flights)
        scores = [harm(flat(journal.rows[flight.index]), plan.score) for flight in flights]
        found.extend(scores)
        return scores

    search(cube, evaluate, generations=plan.total // len(cube), seed=plan.seed)


def _write_what_was_asked(plan: SweepPlan, folder: Path) -> None:
    """Write spec and manifest. More than one commit in it: gone on with by another version, so not all of one kind."""
    manifest = folder / "manifest.json"
    before = read_json(manifest)["settings"]["commits"] if manifest.exists() else []
    commits = list(dict.fromkeys([*before, git_commit()]))
    write_whole(folder / "spec.toml", plan.spec.path.read_text(encoding="utf-8"))
    asked = {"file": plan.spec.path.name, "runs": plan.runs, "worst by": plan.score, "commits": commits}
    write_manifest(folder, plan.identity | asked, plan.seed)


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    write_whole(path, json.dumps(plain(values), indent=1, allow_nan=False) + "\n")
