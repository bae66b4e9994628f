"""One recorded run as a job for the pool: data in, a summary out, the rest in its run folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treadline.experiments.recorded import recorded_run
from treadline.experiments.traverse import Opener
from treadline.models import ControllerDesign
from treadline.scenario import Scenario
from treadline.sim import open_plant as open_mujoco


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
    open_plant: Opener = open_mujoco
    """Which simulator; a function of a module, for the job may be done by another process."""

    def run(self) -> dict[str, Any]:
        """Drive, and return the labels with the run's summary."""
        run = recorded_run(
            self.folder,
            self.scenario,
            controller=self.controller,
            seed=self.seed,
            log=self.log,
            image_every=self.image_every,
            open_plant=self.open_plant,
        )
        return {**self.labels, **run.summary(), "cpu_s": run.cpu_s, "run": self.folder.name}
