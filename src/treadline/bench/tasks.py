"""Tasks of StairBench: distributions of scenarios, and what each counts as arrival."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from treadline.campaign.spec import Spec, read_spec
from treadline.core.errors import SettingsError, closest
from treadline.core.files import DATA
from treadline.core.printing import plain
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import SHIPPED, Scenario

See = Literal["oracle", "tracker"]
"""Source of a policy's observation: ground truth, or the estimates of the chair from the readings of its sensors."""
SENSORS: Mapping[See, Mapping[str, object]] = {
    "oracle": {"control.vision": "truth"},
    "tracker": {"sensors.model": "statistical"},
}
"""Values of the scenarios for each source: neither renders images."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task of the bench."""

    file: Path
    """Sweep file that the scenarios are drawn from."""
    fixed: Mapping[str, object]
    """Values in place of the file's, by dotted key."""
    on_flight: bool = False
    """Whether the chair arrives square at the flight's last nosing, in place of level beyond it."""


UP: Mapping[str, object] = {}
DOWN: Mapping[str, object] = {"drive.direction": "down", "start.place": "landing"}
FILES = DATA / "bench"
TASKS: Mapping[str, Task] = {
    "StairUp": Task(file=FILES / "stair.toml", fixed=UP),
    "StairDown": Task(file=FILES / "stair.toml", fixed=DOWN),
    "Straighten": Task(file=FILES / "straighten.toml", fixed=UP, on_flight=True),
    "Kerb": Task(file=FILES / "kerb.toml", fixed=UP),
    "Buildings": Task(file=SHIPPED / "buildings.toml", fixed=UP),
    "FtrUp": Task(file=FILES / "ftr.toml", fixed=UP),
    "FtrDown": Task(file=FILES / "ftr.toml", fixed=DOWN),
}
"""Tasks by name; ``treadline bench`` runs the first five unless it is given others."""


def draw(name: str, seed: int, *, see: See, vehicle: str, changes: Mapping[str, object] | None = None) -> Scenario:
    """Return the scenario of an episode.

    A vehicle with a rating carries at most its rated payload.

    Args:
        name: Task.
        seed: Seed of the draw.
        vehicle: Shipped chair, or path of a chair's file.
        changes: Values in place of the drawn ones, by dotted key.

    Raises:
        SettingsError: If there is no such task, or a value is not allowed.
    """
    task = task_named(name)
    fixed = {**task.fixed, **SENSORS[see], "chair.model": vehicle, **(changes or {})}
    spec = _spec(task.file, json.dumps(plain(fixed)))
    drawn = spec.at(np.random.default_rng(seed).random(spec.dimension).tolist(), f"{name}, seed {seed}").scenario
    rating, chair = read_chair(vehicle).rating, drawn.chair
    if rating is None or chair.payload_kg <= rating.payload_kg:
        return drawn
    return drawn.changed(chair={"payload_kg": rating.payload_kg, "entered_payload_kg": None})


def task_named(name: str) -> Task:
    """Return a task.

    Raises:
        SettingsError: If there is none of that name.
    """
    if name in TASKS:
        return TASKS[name]
    close = closest(name, list(TASKS))
    meant = "" if close is None else f"; did you mean '{close}'?"
    raise SettingsError(f"no task '{name}' in the bench; tasks: {', '.join(TASKS)}{meant}")


@cache
def _spec(file: Path, fixed: str) -> Spec:
    return read_spec(file, json.loads(fixed))
