"""Solids, shadows and puddles of a view of a stair."""

import math
from dataclasses import dataclass, field

import numpy as np

from scenes.camera import Puddle
from scenes.clutter import cast_shadows, clutter_of, spilt, worn_step
from scenes.flight import DIRECTIONS, Pose, TiltedFlight
from scenes.placing import oblique_wall
from scenes.recipe import ViewRecipe, drawn
from scenes.rooms import plain
from scenes.step_shapes import shaped
from treadline.core.angles import DEG
from treadline.plant.sensors.camera.ray_camera import VIEW_M
from treadline.plant.sensors.camera.solids import SceneBox, Shadow, upright
from treadline.vehicle.stair_solids import FLOOR_LENGTH_M

BEHIND_M = 0.6
"""Least distance from the chair's middle to the wall behind it [m]: half of its length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Solids, shadows and puddles of a scene."""

    solids: list[SceneBox]
    shadows: list[Shadow] = field(default_factory=list)
    puddles: list[Puddle] = field(default_factory=list)
    filled: list[SceneBox] = field(default_factory=list)
    """The same solids with solid treads; empty if the treads are solid."""


def stair_setting(flight: TiltedFlight, scene: str, pose: Pose, recipe: ViewRecipe, rng: np.random.Generator) -> Setting:
    """Return the stair and its clutter, one to five steps ahead of the chair's front."""
    staircase = flight.staircase
    clutter, shadows, puddles = [], [], []
    x = np.array([step.x_m for step in staircase.steps])
    ahead = (pose.p_WB + pose.R_WB @ np.array([1.2, 0.0, 0.0]))[0]
    nearest = int(np.argmin(np.abs(x - ahead)))
    direction = 1 if DIRECTIONS[scene] == "up" else -1
    for name in recipe.clutter:
        there = rng.random() < recipe.clutter_chance
        step = min(max(nearest + direction * int(rng.integers(4)), 0), len(x) - 3)
        if there and name == "shadow":
            shadows = cast_shadows(rng)
        elif there and name == "wet":
            puddles = spilt(staircase, range(max(nearest - 6, 0), min(nearest + 7, len(x) - 1)), rng)
        elif there:
            clutter += clutter_of(name, staircase, step, rng)
    around = _surroundings(flight, pose, recipe, rng)
    solids = [plain(solid) for solid in (*around, *_stair_solids(flight, recipe, rng), *clutter)]
    filled = [plain(solid) for solid in (*around, *flight.solids(), *clutter)] if recipe.treads != "solid" else []
    return Setting(solids=solids, shadows=shadows, puddles=puddles, filled=filled)


def _surroundings(flight: TiltedFlight, pose: Pose, recipe: ViewRecipe, rng: np.random.Generator) -> list[SceneBox]:
    """Return the floor, a wall behind the landing and one before the stair."""
    staircase, last = flight.staircase, flight.staircase.steps[-1]
    end_x = max(step.x_m for step in staircase.steps) + max(staircase.landing_m, last.depth_m)
    floor = upright("floor", (-FLOOR_LENGTH_M, -VIEW_M, -0.2), (end_x + VIEW_M, VIEW_M, 0.0), texture="concrete")
    yaw = drawn(recipe.back_wall_deg, rng) * DEG
    # However yaw, it meets both side walls.
    behind = oblique_wall(end_x - 0.5 * staircase.width_m * math.tan(abs(yaw)), yaw, low_m=last.z_m)
    # A chair far before the flight stands before that wall as well.
    before_x = min(-float(rng.uniform(2.5, 5.5)), float(pose.p_WB[0]) - BEHIND_M)
    before = oblique_wall(before_x, math.pi + float(rng.uniform(-20.0, 20.0)) * DEG)
    return [floor, behind, before]


def _stair_solids(flight: TiltedFlight, recipe: ViewRecipe, rng: np.random.Generator) -> list[SceneBox]:
    """Return steps, landing and walls."""
    solids: list[SceneBox] = []
    for solid in flight.solids():
        if solid.kind == "step" and recipe.worn_m > 0.0:
            solids += worn_step(solid, recipe.open_risers, recipe.worn_m, rng)
        elif solid.kind in ("step", "landing"):
            solids += shaped(solid, recipe, flight.bow_m)
        elif solid.kind != "floor":
            solids.append(solid)
    return solids
