"""One recorded run as a job for the process pool: settings in, summary out, everything else in its run folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treadline.core.models import ControllerDesign
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import Opener, PlantName, resolve
from treadline.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunJob:
    """A scenario, a seed and a controller; ``labels`` are returned unchanged with the result."""

    name: str
    scenario: Scenario
    seed: int
    controller: ControllerDesign | None
    """Controller design; None for the one shipped for the vehicle."""
    folder: Path
    labels: dict[str, Any]
    image_every: int = 0
    """Keep every n-th frame in the log; 0 keeps none."""
    open_plant: Opener | PlantName = "mujoco"
    """Simulator: its name, or a module-level function, because the job may run in another process."""

    def run(self) -> dict[str, Any]:
        """Run the scenario and return the labels with the run's summary."""
        setup = resolve(self.scenario, self.controller, self.seed, open_plant=self.open_plant)
        run = recorded_run(self.folder, setup, image_every=self.image_every)
        return {**self.labels, **run.summary(), "cpu_s": run.cpu_s, "run": self.folder.name}
