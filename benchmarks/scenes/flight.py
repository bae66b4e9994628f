"""Random flight of a recipe, and the pose of the chair on or before the flight."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from scenes.clutter import RAIL_INSET_M, RAIL_M
from scenes.recipe import PLACES_M, ViewRecipe, drawn
from treadline.core.angles import DEG
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z
from treadline.plant.sensors.camera.solids import SceneBox, solids_of
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase, Step, build_staircase

Direction = Literal["up", "down"]
"""Direction of the flight ahead."""
DIRECTIONS: dict[str, Direction] = {
    "up": "up",
    "top": "up",
    "foot": "up",
    "down": "down",
    "edge": "down",
    "bottom": "down",
}
"""Direction of each scene."""
LEVEL = ("foot", "edge")
"""Scenes with the chair on horizontal ground."""
STAIR_WIDTH_M = 0.8
"""Least width of a flight in a scenario [m]; views also show narrower flights, which a chair must refuse."""
CLEAR_M = 0.12
"""Least distance between the camera and a wall or rail [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """Pose of the chair."""

    R_WB: Rotation
    p_WB: Vector3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TiltedFlight:
    """Staircase with tilted steps and bowed nosings."""

    staircase: Staircase
    tilts_rad: Float[np.ndarray, "n 2"]
    """Tilt of each step [rad]: down to the front, then up to the left."""
    bow_m: float = 0.0
    """Sagitta of the nosings over the width [m]; positive if the middle protrudes towards the foot."""

    def turn(self, index: int) -> Rotation:
        """Return the rotation of a step about the middle of its nosing."""
        pitch, roll = self.tilts_rad[index]
        return rotation_y(-float(pitch)) @ rotation_x(float(roll))

    def along(self, step: Step) -> Vector3:
        """Return the direction of a step's nosing, to the left."""
        return self.turn(step.index) @ np.array([-math.sin(step.yaw_rad), math.cos(step.yaw_rad), 0.0])

    def nosing(self, step: Step, y_m: float) -> tuple[Vector3, Vector3]:
        """Return the point of a step's nosing at a distance left of its middle, and the tangent there."""
        middle, along = step.nosing_F, self.along(step)
        if self.bow_m == 0.0:
            return middle, along
        half = 0.5 * self.staircase.width_m
        aside = min(max(y_m, -half), half)
        forward = np.cross(along, np.array([0.0, 0.0, 1.0]))
        point = middle + aside * along + self.bow_m * (aside / half) ** 2 * forward
        return point, along + 2.0 * self.bow_m * aside / half**2 * forward

    def solids(self) -> tuple[SceneBox, ...]:
        """Return the solids of the staircase, with tilted steps."""
        return tuple(self._tilted(solid) for solid in solids_of(stair_boxes(self.staircase)))

    def _tilted(self, solid: SceneBox) -> SceneBox:
        if solid.kind != "step":
            return solid
        step, turn = self.staircase.steps[solid.index], self.turn(solid.index)
        nosing = np.array([step.x_m, 0.0, step.z_m])
        return replace(solid, centre_W=nosing + turn @ (solid.centre_W - nosing), R_WK=turn @ solid.R_WK)


def draw_flight(recipe: ViewRecipe, rng: np.random.Generator) -> TiltedFlight:
    """Return a random flight of a recipe."""
    staircase = _staircase(recipe, rng)
    return TiltedFlight(
        staircase=staircase,
        tilts_rad=recipe.tread_tilt_deg * DEG * rng.standard_normal((len(staircase.steps), 2)),
        bow_m=drawn(recipe.bow_m, rng) if any(recipe.bow_m) else 0.0,
    )


def _staircase(recipe: ViewRecipe, rng: np.random.Generator) -> Staircase:
    rise, slope = drawn(recipe.rise_m, rng), drawn(recipe.slope_deg, rng) * DEG
    run = rise / math.tan(slope) if recipe.run_m is None else drawn(recipe.run_m, rng)
    stair = Stair(
        rise_m=rise,
        run_m=run,
        steps=int(rng.integers(recipe.steps[0], recipe.steps[1], endpoint=True)),
        width_m=max(width_m := drawn(recipe.width_m, rng), STAIR_WIDTH_M),
        landing_m=drawn(recipe.landing_m, rng),
        open_risers=recipe.open_risers,
        rise_jitter_m=recipe.rise_jitter_m,
        nosing_yaw_jitter_deg=recipe.nosing_yaw_jitter_deg,
        walls=recipe.walls[int(rng.integers(len(recipe.walls)))],
    )
    staircase = build_staircase(stair, rng)
    x = run * np.arange(stair.steps) + recipe.run_jitter_m * rng.standard_normal(stair.steps)
    depth = np.append(np.diff(x), run)
    steps = tuple(
        replace(step, x_m=float(front), depth_m=float(deep)) for step, front, deep in zip(staircase.steps, x, depth, strict=True)
    )
    plans = tuple(replace(plan, right_m=-0.5 * width_m, left_m=0.5 * width_m) for plan in staircase.plans)
    return replace(staircase, steps=steps, width_m=width_m, plans=plans)


def draw_pose(
    scene: str, staircase: Staircase, p_BC: Vector3, recipe: ViewRecipe, heading_rad: float, rng: np.random.Generator
) -> Pose:
    """Return a random pose on the nosings, the floor or the landing, with the camera clear of the walls."""
    pose = _pose(scene, staircase, recipe, heading_rad, rng)
    railed = "rail_left" in recipe.clutter or "rail_right" in recipe.clutter
    limit = max(0.5 * staircase.width_m - CLEAR_M - (RAIL_INSET_M + RAIL_M if railed else 0.0), 0.0)
    y = float((pose.p_WB + pose.R_WB @ p_BC)[1])
    return replace(pose, p_WB=pose.p_WB + np.array([0.0, min(max(y, -limit), limit) - y, 0.0]))


def _pose(scene: str, staircase: Staircase, recipe: ViewRecipe, heading_rad: float, rng: np.random.Generator) -> Pose:
    first, last = staircase.steps[0], staircase.steps[-1]
    length = math.hypot(last.x_m - first.x_m, last.z_m - first.z_m)
    place = drawn(recipe.place_m or PLACES_M[scene], rng)
    lateral = drawn(recipe.lateral_m, rng)
    yaw = rotation_z(heading_rad + (0.0 if DIRECTIONS[scene] == "up" else math.pi))
    rock = rocked(recipe, rng)
    if scene in LEVEL:
        x, z = (first.x_m - place, 0.0) if scene == "foot" else (last.x_m + place, last.z_m)
        return Pose(R_WB=yaw @ rock, p_WB=np.array([x, lateral, z]))
    along = {"up": place, "top": length - place, "down": length - place, "bottom": place}[scene]
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([along, lateral, 0.0])
    return Pose(R_WB=staircase.R_WS @ yaw @ rock, p_WB=p_WB)


def rocked(recipe: ViewRecipe, rng: np.random.Generator) -> Rotation:
    """Return a random rotation of the chair relative to its support."""
    pitch, roll = recipe.rock_deg * DEG * rng.standard_normal(2)
    return rotation_y(float(pitch)) @ rotation_x(float(roll))
