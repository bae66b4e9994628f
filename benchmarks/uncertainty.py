"""Uncertainty budget: the change of each figure with numerics, friction, masses, lags and lugs, one source at a time.

Run: ``python benchmarks/uncertainty.py`` (24 minutes of one core, extrapolated from 9 of 30 variations; it can be resumed). It
prints the page of evidence; ``--publish`` writes ``docs/evidence/uncertainty.md`` and ``src/treadline/data/sensitivity.json``.
``--runs slide-32.4`` makes one run in all variations.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from uncertainty_figures import BudgetRow, RunOutcomes, budget
from uncertainty_runs import ALL_RUNS, SEED_GROUP, VARIATIONS, BudgetJob, runs_of

from treadline.core.files import write_whole
from treadline.experiments._job_pool import JobPool
from treadline.io.runs import git_commit

ROOT = Path(__file__).parents[1]
EVIDENCE = ROOT / "docs" / "evidence" / "uncertainty.md"
SENSITIVITY = ROOT / "src" / "treadline" / "data" / "sensitivity.json"
SHOWN = ("step", "stiffness", "friction", "friction across", "centre along", "lag", SEED_GROUP)
"""Sources with a column on the page; ``sensitivity.json`` has all of them."""

METHOD = """\
One source at a time is varied in the plant; the mission keeps the nominal chair file, the entered weight and the shipped
controller. Each cell is the largest absolute change of the figure over the variations of the source:

| source | variations (nominal) |
| --- | --- |
| step | 1 and 2.5 ms (2 ms) |
| coarse step | 5 ms, the largest that the contact's time constant allows; not in the sum |
| stiffness | time constant of the contact 0.005 and 0.02 s (0.01 s), rubber included |
| residual | accepted residual of the contact correction 0.001 and 0.1 m/s² (0.01) |
| solves | at most 3 and 20 contact solves per step (10) |
| friction | ±20 % along and across together; "along" and "across" alone are not in the sum |
| chassis mass, passenger mass | ±10 % each |
| centre along, centre up | centre of mass of chassis and passenger ±2 cm |
| lag | lag of the belts' drives ×0.5 and ×2 (0.15 s) |
| lug phase | a quarter and half of the lug pitch; on the runs with lugs alone |
| seed | seeds 1 and 2 (0): sensor noise alone; not in the sum |

Runs, with the statistical camera: Table II from +30°, 80 s, at 25°, 28° and 30° with friction 0.62/0.5 and at 28° with 0.9/0.5;
straight up 28° for 60 s with a belt mismatch of 2 %; 400 samples of excitation at 20°; up-28 and down-28; a braked chair on 28°
for 60 s and on 32.4° for 3 s. In the variations of step, stiffness and friction alone: the turn at 28° with roll-back allowed,
the open loop on 28°, the controller as printed, the seat, the dead zone, the frame of Fig. 5, and lugs of 15 mm every 80 mm
(turns of 4 s, up-28).
RSS is the root sum of squares over the sources in the sum, as far as they were run.

**Bold**: the source changes the figure by more than its margin to the target. †: in a variation of the source
the runs end without the figure. Blank: not run. Other sources and figures without a target: `src/treadline/data/sensitivity.json`.
"""


def main() -> None:
    """Make the runs that are not stored, and print or publish the budget."""
    options = _options()
    folder = Path(options.out)
    jobs = [
        BudgetJob(variation=item, run_name=name, folder=folder)
        for item in VARIATIONS
        for name in runs_of(item)
        if options.runs is None or name in options.runs
    ]
    done: list[str] = []

    def on_done(name: str) -> None:
        done.append(name)
        print(f"\r{len(done)} of {len(jobs)}: {name:50}", end="", file=sys.stderr, flush=True)

    outcomes: dict[str, dict[str, Any]] = {}
    with JobPool(options.workers, on_done) as pool:
        for result in pool.begin(jobs)():
            outcomes.setdefault(result["variation"], {})[result["run"]] = result
    print(file=sys.stderr)
    rows = budget(outcomes)
    if options.publish:
        publish(rows, outcomes)
    else:
        print(markdown(rows, outcomes))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure how far each source of uncertainty moves each headline figure.")
    parser.add_argument("--runs", nargs="+", metavar="RUN", choices=tuple(ALL_RUNS), help="make these runs only; default all")
    parser.add_argument("--workers", type=int, default=1, choices=(1, 2), help="number of processes; default 1")
    parser.add_argument("--out", default="uncertainty/whole", help="folder of the runs' outcomes; those that are there are kept")
    parser.add_argument("--publish", action="store_true", help="write docs/evidence/uncertainty.md and sensitivity.json")
    options = parser.parse_args()
    if options.runs and options.publish:
        parser.error("--publish needs the whole budget; leave out --runs")
    return options


def publish(rows: Sequence[BudgetRow], outcomes: Mapping[str, RunOutcomes]) -> None:
    """Write the evidence and the package's data."""
    EVIDENCE.parent.mkdir(parents=True, exist_ok=True)
    write_whole(EVIDENCE, markdown(rows, outcomes))
    data = {row.figure.key: row.as_json() for row in rows}
    write_whole(SENSITIVITY, json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    print(f"wrote {EVIDENCE.relative_to(ROOT)} and {SENSITIVITY.relative_to(ROOT)}")


def markdown(rows: Sequence[BudgetRow], outcomes: Mapping[str, RunOutcomes]) -> str:
    """Return the page of evidence, of the figures with a target."""
    rows = [row for row in rows if row.figure.is_headline and row.figure.target is not None]
    parts = [
        "# Uncertainty budget of the headline figures",
        f"{datetime.now(tz=UTC):%Y-%m-%d}, commit {(git_commit() or 'unknown')[:12]}: "
        "`nice python benchmarks/uncertainty.py --workers 2 --publish`; outcomes do not depend on the number of workers.",
        METHOD.rstrip(),
        "## Variations that miss a target\n\n" + _reading(rows),
        "## Changes by source\n\n" + _table(rows),
        "## Variations in which a run ends without its figures\n\n" + ("\n".join(_lost(outcomes)) or "None."),
    ]
    return "\n\n".join(parts) + "\n"


def _reading(rows: Sequence[BudgetRow]) -> str:
    lines = []
    for row in rows:
        if row.margin is None:
            continue
        if row.margin < 0.0:
            lines.append(f"* {row.figure.what}: **misses its target** before any variation.")
        elif row.missed:
            missed = ", ".join(f"{name} ({_number(row.values[name])})" for name in row.missed)
            lines.append(f"* {row.figure.what}, margin {_number(row.margin)}: {missed}.")
    return "\n".join(lines) or "None."


def _table(rows: Sequence[BudgetRow]) -> str:
    columns = ["nominal", "target", *SHOWN, "RSS"]
    lines = [f"| figure | {' | '.join(columns)} |", "| --- " * (len(columns) + 1) + "|"]
    for row in rows:
        marked = [f"**{_cell(row, name)}**" if name in row.exceeded else _cell(row, name) for name in SHOWN]
        shown = [_number(row.nominal), _target(row), *marked, _number(row.rss)]
        unit = f" [{row.figure.unit}]" if row.figure.unit else ""
        lines.append(f"| {row.figure.what}{unit} | {' | '.join(shown)} |")
    return "\n".join(lines)


def _cell(row: BudgetRow, name: str) -> str:
    if name not in row.moves:
        return ""
    lost = any(item.name in row.lost for item in VARIATIONS if item.group == name)
    return _number(row.moves[name]) + ("†" if lost else "")


def _lost(outcomes: Mapping[str, RunOutcomes]) -> list[str]:
    ends = {
        variation: [f"{name} {run['verdict'].partition(':')[0]}" for name, run in runs.items() if run["verdict"] != "ok"]
        for variation, runs in outcomes.items()
    }
    return [f"* {variation}: {', '.join(names)}" for variation, names in ends.items() if names]


def _target(row: BudgetRow) -> str:
    return f"{'≥' if row.figure.at_least else '≤'} {row.figure.target:g}"


def _number(value: float | None) -> str:
    return (
        "–" if value is None else f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2g}" if abs(value) < 1.0 else f"{value:.3g}"
    )


if __name__ == "__main__":
    main()
