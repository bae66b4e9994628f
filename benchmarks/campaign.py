"""Resident memory of a sweep of stubs, at its largest: ``campaign.py pool|dask RUNS``; worker processes do not grow."""

import resource
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
    scores = np.random.default_rng(seed).random(40).tolist()
    pose = {
        "t_s": watched_s,
        "p_WB": [scenario.stair.rise_m, 0.0, 0.0],
        "quat_WB": [1.0, 0.0, 0.0, 0.0],
        "belt_travel_m": [0.0, 0.0],
    }
    verdict = {"verdict": "held" if scores[0] < 0.01 else "arrived", "cause": "stub", "min_stability_margin_deg": scores[1]}
    return (
        verdict | {"view": pose | {"seat_rad": 0.0, "flipper_rad": 0.0}} | {f"score_{k}": score for k, score in enumerate(scores)}
    )


if __name__ == "__main__":
    plan = SweepPlan(spec=read_spec("envelope"), runs=int(sys.argv[2]), sampling="sobol")
    executor = Pool(stub, 2) if sys.argv[1] == "pool" else Cluster(stub, "local", 2)
    with tempfile.TemporaryDirectory() as folder:
        run_sweep(plan, Path(folder), executor, resume=False, begin=lambda _left: None, done=lambda _row, _left: None)
    print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0:.0f} MB")
