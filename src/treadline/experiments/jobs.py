"""One recorded run as a job for the pool: data in, a summary out, the rest in its run folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treadline.experiments.recorded import recorded_run
from treadline.models import ControllerDesign
from treadline.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunJob:
    """A scenario, a seed and a controller; ``labels`` travel to the result unchanged."""

    name: str
    scenario: Scenario
    seed: int
    controller: ControllerDesign | None
    folder: Path
    labels: dict[str, Any]
    log: bool
    """Keep an MCAP log; one run per figure does, the rest keep their series only."""
    image_every: int = 0
    """Keep every n-th frame in the log; 0 keeps none."""

    def run(self) -> dict[str, Any]:
        """Drive, and return the labels with the run's summary."""
        run = recorded_run(
            self.folder,
            self.scenario,
            controller=self.controller,
            seed=self.seed,
            log=self.log,
            image_every=self.image_every,
        )
        return {**self.labels, **run.summary(), "cpu_s": run.cpu_s, "run": self.folder.name}
