"""Stairs and conditions of real buildings: each row is one scenario with one deviation, run with the statistical camera.

Run: ``python benchmarks/building_stairs.py [--seeds N] [--only WORDS] [--workers N]`` (about ten minutes of CPU). Every run is a
whole traversal of a 28° flight with a payload of 50 kg and friction 0.62/0.5, unless the row says otherwise. The table gives
verdicts, the largest pitch rate, the largest passenger acceleration (mean over 50 ms), the smallest tip-over margin and the most
frequent cause.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

from treadline.core.processes import default_workers
from treadline.run.episode import traverse
from treadline.scenario.scenario import scenario_of
from treadline.scenario.shipped_files import shipped_controller

RISE_M = 0.1595128
"""Rise of the nominal step [m]: 28° with a run of 0.30 m."""
STAIR = {"slope_deg": 28.0, "steps": 8, "landing_m": 3.0}
DOWN: dict[str, Any] = {"start": {"place": "landing"}, "drive": {"direction": "down"}}
WOUND = [{"index": -3, "yaw_deg": 4.0}, {"index": -2, "yaw_deg": 8.0}, {"index": -1, "yaw_deg": 12.0}]
WET = [{"index": index, "friction": [0.36, 0.3]} for index in (4, 5, 6)]
SPLIT = {"steps": 9, "friction": [0.8, 0.65], "friction_right": [0.48, 0.39]}
RAMP = {"kind": "gyro_ramp", "value": 0.6, "at_s": 10.0, "for_s": 30.0}
HELD_S = 5.0
"""Time for which a held chair is watched [s]."""

Tables = Mapping[str, Any]


def case(stair: Tables | None = None, step: list[dict[str, Any]] | None = None, **tables: Any) -> Tables:
    """Return the tables of a scenario: the nominal flight with one deviation."""
    return {"stair": STAIR | dict(stair or {}), "step": step or [], "sensors": {"camera": "statistical"}, **tables}


def rise(index: int, more_mm: float) -> dict[str, Any]:
    """Return the table of one step that is higher than the nominal step."""
    return {"index": index, "rise_m": round(RISE_M + more_mm / 1000.0, 7)}


def stamped(message: int) -> dict[str, Any]:
    """Return the fault that stamps one kind of message 1e6 s ahead."""
    return {"kind": "wrong_stamp", "value": message, "at_s": 15.0, "for_s": 0.05}


CASES: dict[str, Tables] = {
    "no deviation, up": case(),
    "no deviation, down": case(**DOWN),
    "last riser +30 mm, up": case(step=[rise(-1, 30.0)]),
    "last riser +50 mm, up": case(step=[rise(-1, 50.0)]),
    "last riser +30 mm, down": case(step=[rise(-1, 30.0)], **DOWN),
    "last riser +50 mm, down": case(step=[rise(-1, 50.0)], **DOWN),
    "last riser -50 mm, up": case(step=[rise(-1, -50.0)]),
    "first riser +50 mm, up": case(step=[rise(0, 50.0)]),
    "first riser -50 mm, up": case(step=[rise(0, -50.0)]),
    "one step 10 mm high, up": case({"steps": 9}, [rise(4, 10.0), rise(5, -10.0)]),
    "one step 10 mm high, down": case({"steps": 9}, [rise(4, 10.0), rise(5, -10.0)], **DOWN),
    "runs uneven, s.d. 12 mm, up": case({"steps": 9, "run_jitter_m": 0.012}),
    "runs uneven, s.d. 20 mm, up": case({"steps": 9, "run_jitter_m": 0.020}),
    "last nosings turned by 4, 8, 12 degrees, up": case({"steps": 9, "walls": "none"}, WOUND),
    "three winders (quarter turn), check off, up": case({"steps": 11, "winders": 3}, drive={"check": False}),
    "right belt on 0.6 of friction 0.8, down": case(SPLIT, **DOWN),
    "three wet steps (0.36 of 0.8), up": case({"steps": 10, "friction": [0.8, 0.65]}, WET),
    "three wet steps (0.36 of 0.8), down": case({"steps": 10, "friction": [0.8, 0.65]}, WET, **DOWN),
    "stop button at 0.2 m/s": case({"steps": 10}, operator=[{"kind": "stop", "at_s": 7.0}], start={"place": "flight", "step": 4}),
    "held for 60 s, then re-armed": case(
        {"steps": 10},
        operator=[{"kind": "stop", "at_s": 2.0}, {"kind": "rearm", "at_s": 62.0}],
        start={"place": "flight", "step": 4},
        drive={"duration_s": 120.0},
    ),
    "map stamped 1e6 s": case(fault=[stamped(0)]),
    "plan stamped 1e6 s": case(fault=[stamped(1)]),
    "health stamped 1e6 s": case(fault=[stamped(2)]),
    "gyro ramp to 0.6 deg/s, up": case(fault=[RAMP]),
    "gyro ramp to 0.6 deg/s, down": case(fault=[RAMP], **DOWN),
    "landing 0.9 m deep, start 0.3 m off centre, down": case(
        {"landing_m": 0.9, "width_m": 1.6}, start={"place": "landing", "lateral_m": 0.3}, drive={"direction": "down"}
    ),
}


def run(name: str, seed: int) -> dict[str, Any]:
    """Return verdict and scores of one run."""
    scenario = scenario_of(CASES[name], Path("building_stairs.toml"), where=name)
    result = traverse(scenario, controller=shipped_controller("wheelchair"), seed=seed, after_hold_s=HELD_S)
    scores = result.scores
    return {
        "verdict": result.verdict,
        "cause": result.cause,
        "pitch_rate_deg_s": scores.max_pitch_rate_deg_s,
        "passenger_m_s2": scores.passenger_max_m_s2,
        "margin_deg": scores.min_stability_margin_deg,
    }


def table(runs: Mapping[str, list[dict[str, Any]]]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| condition | verdicts | pitch rate °/s | passenger m/s² | margin ° | cause |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, rows in runs.items():
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in Counter(row["verdict"] for row in rows).most_common())
        spans = [_span([row[key] for row in rows]) for key in ("pitch_rate_deg_s", "passenger_m_s2", "margin_deg")]
        cause = Counter(row["cause"] for row in rows if row["cause"]).most_common(1)
        yield f"| {name} | {verdicts} | {' | '.join(spans)} | {cause[0][0] if cause else ''} |"


def _span(values: list[float]) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return low if low == high else f"{low} to {high}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each condition, seeds from 0")
    parser.add_argument("--only", nargs="*", default=[""], help="conditions whose name contains one of these words")
    parser.add_argument("--workers", type=int, default=default_workers(), help="processes")
    arguments = parser.parse_args()
    names = [name for name in CASES if any(word in name for word in arguments.only)]
    jobs = list(product(names, range(arguments.seeds)))
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    with ProcessPoolExecutor(arguments.workers) as pool:
        for done, ((name, _), row) in enumerate(zip(jobs, pool.map(run, *zip(*jobs, strict=True)), strict=True), start=1):
            runs[name].append(row)
            sys.stderr.write(f"{done}/{len(jobs)} {name}: {row['verdict']}\n")
    for line in table(runs):
        sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main()
