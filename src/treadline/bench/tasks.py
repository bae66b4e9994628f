"""Tasks of StairBench, distributions of scenarios, and the setup of an episode."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from treadline.campaign.spec import Spec, read_spec
from treadline.core.errors import SettingsError, did_you_mean
from treadline.core.files import DATA
from treadline.core.printing import plain
from treadline.plant.mujoco import FAST, NOMINAL, MujocoPlant, Physics, open_plant
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import SHIPPED, Scenario

See = Literal["oracle", "tracker"]
"""Source of a policy's observation: ground truth, or the estimates of the chair from the readings of its sensors."""
SENSORS: Mapping[See, Mapping[str, object]] = {
    "oracle": {"control.vision": "truth"},
    "tracker": {"sensors.model": "statistical"},
}
"""Values of the scenarios for each source: neither renders images."""
PHYSICS: Mapping[str, Physics] = {"nominal": NOMINAL, "fast": FAST}
"""Numerical settings by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task of the bench."""

    file: Path
    """Sweep file that the scenarios are drawn from."""
    fixed: Mapping[str, object] = field(default_factory=dict)
    """Values in place of the file's, by dotted key."""


DOWN: Mapping[str, object] = {"drive.direction": "down", "start.place": "landing"}
FILES = DATA / "bench"
TASKS: Mapping[str, Task] = {
    "StairUp": Task(file=FILES / "stair.toml"),
    "StairDown": Task(file=FILES / "stair.toml", fixed=DOWN),
    "Straighten": Task(file=FILES / "straighten.toml"),
    "Kerb": Task(file=FILES / "kerb.toml"),
    "Buildings": Task(file=SHIPPED / "buildings.toml"),
    "FtrUp": Task(file=FILES / "ftr.toml"),
    "FtrDown": Task(file=FILES / "ftr.toml", fixed=DOWN),
}
"""Tasks by name; ``treadline bench`` runs the first five unless it is given others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSetup:
    """Task, source of the observation, vehicle and physics: what environments and scores have in common.

    Raises:
        SettingsError: If a value is not allowed, or the vehicle lacks the camera of the task.
    """

    task: str = "StairUp"
    """Name of the task."""
    see: See = "oracle"
    vehicle: str = "wheelchair"
    """Shipped chair, or path of a chair's file."""
    physics: str = "fast"
    """Numerical settings: ``fast`` to learn, ``nominal`` for scores."""
    friction: float | None = None
    """Belt friction coefficient in place of the scenario's, also beyond its range; FTR-Bench has 10."""
    changes: Mapping[str, object] | None = None
    """Values in place of the drawn ones, by dotted key of a scenario."""

    def __post_init__(self) -> None:
        for name, given, allowed in (("task", self.task, TASKS), ("see", self.see, SENSORS), ("physics", self.physics, PHYSICS)):
            if given not in allowed:
                raise SettingsError(f"{name} is '{given}'; allowed: {', '.join(allowed)}{did_you_mean(given, allowed)}")
        if self.friction is not None and not 0.0 < self.friction < np.inf:
            raise SettingsError(f"friction is {self.friction:g}; it must be above 0 and finite")
        if self.see == "tracker":
            read_chair(self.vehicle).mount_of(rear="down" in TASKS[self.task].fixed.values())

    def scenario(self, seed: int) -> Scenario:
        """Return the scenario that a seed draws. A vehicle with a rating carries at most its rated payload."""
        task = TASKS[self.task]
        fixed = {**task.fixed, **SENSORS[self.see], "chair.model": self.vehicle, **(self.changes or {})}
        spec = _spec(task.file, json.dumps(plain(fixed)))
        drawn = spec.at(np.random.default_rng(seed).random(spec.dimension).tolist(), f"{self.task}, seed {seed}").scenario
        rating = read_chair(self.vehicle).rating
        if rating is None or drawn.chair.payload_kg <= rating.payload_kg:
            return drawn
        return drawn.changed(chair={"payload_kg": rating.payload_kg, "entered_payload_kg": None})

    def open_plant(self, scenario: Scenario, seed: int) -> MujocoPlant:
        """Return the simulator of a scenario."""
        plant = open_plant(scenario, seed, physics=PHYSICS[self.physics])
        if self.friction is not None:
            plant.set_friction(self.friction)
        return plant


@cache
def _spec(file: Path, fixed: str) -> Spec:
    return read_spec(file, json.loads(fixed))
