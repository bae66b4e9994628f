"""Resident memory of a sweep by its number of runs, on the pool and on a local Dask cluster: ``campaign.py [RUNS]``.

Each run is a stub with 40 scores. Memory is that of the sweep's own process, at its largest; the worker processes do not grow.
"""

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from treadline.campaign.spec import read_spec
from treadline.campaign.sweep import Cluster, Pool, SweepPlan, run_sweep


def stub(scenario: Any, seed: int, watched_s: float) -> Mapping[str, Any]:
    """Return a row of the size of a simulated run's."""
    scores = np.random.default_rng(seed).random(40)
    verdict = "held" if scores[0] < 0.01 else "arrived"
    pose = {
        "t_s": watched_s,
        "p_WB": [scenario.stair.rise_m, 0.0, 0.0],
        "quat_WB": [1.0, 0.0, 0.0, 0.0],
        "belt_travel_m": [0.0, 0.0],
    }
    pose |= {"seat_rad": 0.0, "flipper_rad": 0.0}
    return {"verdict": verdict, "cause": "stub", "view": pose, "min_stability_margin_deg": scores[1]} | {
        f"score_{k}": float(score) for k, score in enumerate(scores)
    }


def largest_mb(executor: str, runs: int) -> float:
    """Return the largest resident memory of a sweep [MB]."""
    executors = {"pool": Pool(stub, 2), "dask": Cluster(stub, "local", 2)}
    with tempfile.TemporaryDirectory() as folder:
        plan = SweepPlan(spec=read_spec("envelope"), runs=runs, sampling="sobol")
        run_sweep(plan, Path(folder), executors[executor], resume=False, begin=lambda _left: None, done=lambda _row, _left: None)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main(runs: int = 100_000) -> None:
    """Print the memory of two sweeps per executor, and its extrapolation to ten times as many runs."""
    for executor in ("pool", "dask"):
        less, more = (
            float(subprocess.check_output([sys.executable, __file__, executor, str(count)], text=True))
            for count in (runs // 10, runs)
        )
        slope = (more - less) / (0.9 * runs)
        print(json.dumps({executor: {runs // 10: less, runs: more, 10 * runs: more + 9 * runs * slope}}))


if __name__ == "__main__":
    match sys.argv[1:]:
        case [executor, count]:
            print(largest_mb(executor, int(count)))
        case [count]:
            main(int(count))
        case _:
            main()
