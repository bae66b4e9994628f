"""One run of a campaign: a scenario and a seed in, a row of the results out, whatever happens on the way."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb
from typing import Any

from treadline.errors import SimulationDiverged
from treadline.io.plain import plain
from treadline.scenario import Scenario

Fly = Callable[[Scenario, int, float], Mapping[str, Any]]
"""Runs a scenario with a seed, watches a held chair for some seconds, and returns verdict and scores.

It must be importable by name: workers look it up.
"""
Row = dict[str, Any]
"""A run's results as JSON values: ``index``, ``seed``, ``verdict``, ``cause``, what was drawn, scores."""

WATCHED_S, WATCHED_LONG_S = 3.0, 60.0
"""Time for which a held chair is watched: what a hold ends in is part of the verdict. The longer one is that of pass rule H."""
LONG_EVERY = 10
"""One run in so many is watched for the longer time, by its index."""

TIMES = ("cpu_s", "real_time_factor")
"""What differs from run to run of the same thing, and so is kept apart from the results."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One run to be done."""

    index: int
    seed: int
    scenario: Scenario
    values: dict[str, Any]
    """What was drawn."""

    @property
    def watched_s(self) -> float:
        """Time for which the chair is watched if it holds."""
        return WATCHED_LONG_S if self.index % LONG_EVERY == 0 else WATCHED_S


def run_one(fly: Fly, flight: Flight) -> Row:
    """Return the row of a run; a run that fails in an unforeseen way is a row too, with the error as its cause.

    A thousand runs must not be lost to one: this is the one place where every exception is caught.
    """
    started = time.process_time()
    try:
        result = dict(fly(flight.scenario, flight.seed, flight.watched_s))
    except SimulationDiverged as error:
        result = {"verdict": "diverged", "cause": str(error)}
    except Exception as error:  # noqa: BLE001 - see above
        where = extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        result = {"verdict": "error", "cause": f"{type(error).__name__}: {error} ({place})"}
    result["cpu_s"] = time.process_time() - started
    return failed(flight, "error", "no verdict") | plain(result) | {"seed": flight.seed}


def failed(flight: Flight, verdict: str, cause: str) -> Row:
    """Return the row of a run that has no scores."""
    values: Row = plain(flight.values)
    return {"index": flight.index, "seed": flight.seed, "verdict": verdict, "cause": cause, **values}
