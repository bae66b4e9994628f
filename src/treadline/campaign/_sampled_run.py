"""Execution of one run: a scenario and a seed in, a row of results out, also for a failed run."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb
from typing import Any

from treadline.core.errors import SimulationDiverged
from treadline.core.printing import plain
from treadline.scenario.scenario import Scenario

EpisodeRunner = Callable[[Scenario, int, float], Mapping[str, Any]]
"""Function that runs a scenario with a seed, observes a held chair for some seconds, and returns verdict and scores.

The function must be importable by name, because worker processes import it.
"""
Row = dict[str, Any]
"""Results of a run as JSON values: ``index``, ``seed``, ``verdict``, ``cause``, drawn values, scores."""

VIEW = "view"
"""Key of the pose from which the page draws a run; no column of the tables."""
TIMES = ("cpu_s", "real_time_factor")
"""Columns that vary between repetitions of a run and are stored separately from the results."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One run to be executed."""

    index: int
    seed: int
    scenario: Scenario
    values: dict[str, Any]
    """Drawn values by key."""

    @property
    def watched_s(self) -> float:
        """Time for which a held chair is observed [s], because the outcome of a hold is part of the verdict.

        Every tenth run is observed for a minute, for pass rule H.
        """
        return 60.0 if self.index % 10 == 0 else 3.0


def run_one(run_episode: EpisodeRunner, episode: Episode) -> Row:
    """Return the row of a run; an unexpected error gives a row with the error as cause.

    One failing run must not end a campaign of a thousand, so every exception is caught here and nowhere else.
    """
    started = time.process_time()
    try:
        result = dict(run_episode(episode.scenario, episode.seed, episode.watched_s))
    except SimulationDiverged as error:
        result = {"verdict": "diverged", "cause": str(error)}
    except Exception as error:  # noqa: BLE001 - see above
        where = extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        result = {"verdict": "error", "cause": f"{type(error).__name__}: {error} ({place})"}
    result["cpu_s"] = time.process_time() - started
    return failed(episode, "error", "no verdict") | plain(result) | {"seed": episode.seed}


def failed(episode: Episode, verdict: str, cause: str) -> Row:
    """Return the row of a run without scores."""
    values: Row = plain(episode.values)
    return {"index": episode.index, "seed": episode.seed, "verdict": verdict, "cause": cause, **values}
