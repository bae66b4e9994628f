"""Random profiles: what ``check`` says of kerbs, sills, garden stairs and uneven flights, and what the drive then does.

Run: ``python benchmarks/profiles.py [--draws N] [--seed N] [--refused N] [--workers N]`` (five seconds of CPU for each draw that
may be driven). A scenario is drawn, checked, and driven with the statistical camera if ``check`` says go. A go is wrong if the
drive tips, is held, refused or rough, or turns faster than a quiet drive does. Of the refused draws so many are driven too, with
``drive.check = false`` and an errorless camera: a refusal is wrong if that drive arrives quietly.
"""

import argparse
import math
import secrets
import sys
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from tables import markdown

from treadline.campaign._results import clopper_pearson
from treadline.core.processes import default_workers
from treadline.run.episode import Traverse, traverse
from treadline.run.resolve import checked
from treadline.run.run_scores import MARGIN_TICKS
from treadline.scenario.scenario import scenario_of

KINDS = ("kerb", "sill", "garden", "flight", "flight", "flight")
"""Kinds of ground, each as likely: half of the draws are flights."""
QUIET_DEG_S = 15.0
"""Pitch rate above which a drive is not quiet [°/s]."""
UNEVEN_M = 0.012
"""Largest deviation of a rise or a run [m]."""
TIPPED_DEG_S, ROCKS_DEG = 25.0, 2.0
"""Pitch rate above which a chair has tipped [°/s]; angle below which a chair beyond its margin has only rocked from one nosing onto
the next [°], which is listed apart."""

Tables = Mapping[str, Any]


def draw(number: int, seed: int) -> tuple[str, Tables]:
    """Return kind and tables of one random scenario."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[int(rng.integers(len(KINDS)))]
    slope = math.radians(rng.uniform(18.0, 34.0))
    rise, run, steps = {
        "kerb": (rng.uniform(0.06, 0.20), 0.30, 1),
        "sill": (rng.uniform(0.01, 0.04), 0.30, 1),
        "garden": (rng.uniform(0.06, 0.20), rng.uniform(0.50, 1.00), int(rng.integers(2, 5))),
        "flight": ((rise := rng.uniform(0.10, 0.20)), float(np.clip(rise / math.tan(slope), 0.20, 0.60)), int(rng.integers(3, 11))),
    }[kind]
    uneven = rng.uniform(-UNEVEN_M, UNEVEN_M, (steps, 2))
    each = [{"index": i, "rise_m": max(rise + float(up), 0.01)} for i, (up, _) in enumerate(uneven)]
    for one, (_, along) in zip(each[:-1], uneven, strict=False):
        one["run_m"] = run + float(along)
    along_friction = rng.uniform(0.45, 0.90)
    down = bool(rng.integers(2))
    return f"{kind} {'down' if down else 'up'}", {
        "stair": {"rise_m": float(rise), "run_m": float(run), "steps": steps, "landing_m": 3.0}
        | {"friction": [float(along_friction), float(0.8 * along_friction)]},
        "step": each if steps > 1 else [],
        "start": {"place": "landing" if down else "floor"},
        "drive": {"direction": "down" if down else "up"},
        "chair": {"payload_kg": float(rng.uniform(15.0, 110.0)), "payload_offset_m": [float(rng.uniform(-0.1, 0.1)), 0.0, 0.0]},
    }


def judged(number: int, seed: int, drive_refused: bool) -> dict[str, Any]:
    """Return what ``check`` says of a draw, and what its drive does."""
    kind, tables = draw(number, seed)
    scenario = scenario_of({**tables, "sensors": {"camera": "statistical"}}, Path(), where=f"draw {number}")
    report = checked(scenario)
    row = {"number": number, "kind": kind, "check": report.verdict, "reason": "; ".join(report.reasons)}
    if report.verdict != "go":
        if not drive_refused:
            return row
        forced = {**tables, "sensors": {"model": "ideal"}, "drive": {**tables["drive"], "check": False}}
        scenario = scenario_of(forced, Path(), where=f"draw {number}")
    run = traverse(scenario, seed=number)
    scores = run.scores
    return row | {
        "verdict": run.verdict,
        "cause": run.cause,
        "rate_deg_s": 0.0 if scores is None else scores.max_pitch_rate_deg_s,
        "passenger_m_s2": 0.0 if scores is None else scores.passenger_max_m_s2,
        "margin_deg": 90.0 if scores is None else scores.min_stability_margin_deg,
        "beyond_deg": beyond_deg(run),
    }


def beyond_deg(run: Traverse) -> float:
    """Return the largest angle by which the chair turned while it was beyond its margin, and for 0.1 s after it [°]."""
    changes = np.flatnonzero(np.diff(np.concatenate([[0], run.trace["stability_margin_rad"] < 0.0, [0]])))
    lasting = [(start, end + MARGIN_TICKS) for start, end in changes.reshape(-1, 2) if end - start >= MARGIN_TICKS]
    return math.degrees(max((float(np.ptp(run.trace["pitch_rad"][start:end])) for start, end in lasting), default=0.0))


def _tipped(row: Mapping[str, Any]) -> bool:
    """Return whether a chair turned over a part of its support: it fell, turned too fast, or turned while beyond its margin."""
    return row["verdict"] in ("fell", "diverged") or row["rate_deg_s"] > TIPPED_DEG_S or row["beyond_deg"] > ROCKS_DEG


def share(count: int, total: int) -> str:
    """Return a share with its 95 % interval."""
    if not total:
        return "none of none"
    low, high = clopper_pearson(count, total)
    return f"{count} of {total}: {100.0 * count / total:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f} %)"


def main() -> int:
    """Draw, check, drive, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--refused", type=int, default=100, help="number of refused draws to drive")
    parser.add_argument("--seed", type=int, default=None, help="first seed; a fresh one when left out")
    parser.add_argument("--workers", type=int, default=default_workers())
    options = parser.parse_args()
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"{options.draws} draws, seed {seed}")
    with ProcessPoolExecutor(options.workers) as pool:
        rows = []
        for row in pool.map(judged, range(options.draws), [seed] * options.draws, [False] * options.draws):
            rows.append(row)
            print(f"\r{len(rows)} of {options.draws}", end="", file=sys.stderr, flush=True)
        refused = [row["number"] for row in rows if row["check"] == "refuse"][: options.refused]
        tried = list(pool.map(judged, refused, [seed] * len(refused), [True] * len(refused)))
    went = [row for row in rows if row["check"] == "go"]
    tips = [row for row in went if _tipped(row)]
    rocks = [row for row in went if row not in tips and row["margin_deg"] < 0.0]
    ends = [row for row in went if row not in (*tips, *rocks) and row["verdict"] != "arrived"]
    fast = [row for row in went if row not in (*tips, *rocks, *ends) and row["rate_deg_s"] > QUIET_DEG_S]
    quiet = [row for row in tried if row["verdict"] == "arrived" and row["rate_deg_s"] < QUIET_DEG_S and row["margin_deg"] > 0.0]
    counts = Counter((row["kind"], row["check"]) for row in rows)
    lines = [f"| {kind} | {counts[kind, 'go']} | {counts[kind, 'refuse']} |" for kind in sorted({row["kind"] for row in rows})]
    markdown("| ground | go | refused |", lines)
    markdown(
        "| figure | share |",
        [
            f"| go, and the drive tips | {share(len(tips), len(went))} |",
            f"| go, and the chair rocks by at most {ROCKS_DEG:g}° | {share(len(rocks), len(went))} |",
            f"| go, and the drive is held, refused, rough or out of time | {share(len(ends), len(went))} |",
            f"| go, and the drive turns faster than {QUIET_DEG_S:g}°/s | {share(len(fast), len(went))} |",
            f"| refused, and the drive arrives quietly | {share(len(quiet), len(tried))} |",
        ],
    )
    markdown(
        "| draw | ground | verdict | °/s | m/s² | margin ° | cause or reason |",
        [
            f"| {row['number']} | {row['kind']} | {row['verdict']} | {row['rate_deg_s']:.1f} | {row['passenger_m_s2']:.1f} "
            f"| {row['margin_deg']:.1f} | {row['cause'] or row['reason']} |"
            for row in (*tips, *rocks, *ends, *fast, *quiet)
        ],
        title="Wrong answers",
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
