"""Episode functions without a simulator, for tests of executors and journals. Worker processes import them by name."""

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.errors import SimulationDiverged
from treadline.scenario.scenario import Scenario

BAD_KG, DEADLY_KG = 80.0, 92.0


def quick(scenario: Scenario, seed: int, watched_s: float) -> Mapping[str, Any]:
    """Return a smooth margin with a known minimum, noise from the seed, and a consistent verdict."""
    chance = np.random.default_rng(seed)
    margin = 12.0 - 0.05 * scenario.chair.payload_kg - 0.2 * abs(scenario.start.heading_deg) + 0.01 * chance.normal()
    return {
        "verdict": "arrived" if margin > 4.0 else "held",
        "cause": None if margin > 4.0 else f"margin of {margin:.1f}°",
        "seed": seed,
        "min_stability_margin_deg": margin,
        "max_pitch_rate_deg_s": 10.0 + chance.random(),
        "rms_heading_deg": abs(scenario.start.heading_deg) / 10.0,
        "settle_s": None if margin < 5.0 else 3.0,
        "phases": ((0.0, "align"), (1.0, "climb")),
        "events": [{"t_s": 1.0, "name": "note", "cause": "none"}],
        "watched_s": watched_s,
        "real_time_factor": time.perf_counter(),
    }


def slow(scenario: Scenario, seed: int, watched_s: float) -> Mapping[str, Any]:
    """Return the same as ``quick`` after a delay."""
    time.sleep(0.05)
    return quick(scenario, seed, watched_s)


def unlucky(scenario: Scenario, seed: int, watched_s: float) -> Mapping[str, Any]:
    """Raise in some runs; one kind of run kills its process each time, another only the first time."""
    if scenario.chair.payload_kg > DEADLY_KG:
        os.kill(os.getpid(), signal.SIGKILL)
    if scenario.chair.payload_kg > BAD_KG:
        raise SimulationDiverged("time went back")
    if scenario.stair.texture == "dark":
        raise ValueError("no light")
    once = Path(os.environ["DIES_ONCE"])
    if scenario.stair.texture == "carpet" and not once.exists():
        once.touch()
        os._exit(3)
    return quick(scenario, seed, watched_s)


def killed_once(scenario: Scenario, seed: int, watched_s: float) -> Mapping[str, Any]:
    """Return the same as ``quick``, but for the first run on a dark stair, which kills its process."""
    once = Path(os.environ["DIES_ONCE"])
    if scenario.stair.texture == "dark" and not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(scenario, seed, watched_s)
