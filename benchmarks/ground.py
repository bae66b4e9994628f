"""Free ground from depth frames against ground truth: edges of flights, docks and kerbs ahead, and floors without any.

The chair stands on level ground before an edge, at a heading of ±35° to it, with its front and its rear camera in turn. Distances
are those of the nearest point of the edge over the swept width, from mid-track. An end counts as right within 5 cm and 2 %.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scenes import STAIRLESS_SCENES, ViewRecipe, draw_view
from scenes.camera import SceneCamera
from scenes.placing import oblique_wall
from scenes.scores import percent
from scenes.views import DOWN_W, calibration_of, tilted

from treadline.core.angles import DEG
from treadline.core.camera_images import MOUNT_FIELDS, RgbdFrame
from treadline.core.rotations import Vector3, rotation_z
from treadline.core.signals import FreeGround
from treadline.perception.free_ground import SWEPT_HALF_M, ground_ahead
from treadline.plant.sensors.camera.solids import SceneBox, solids_of, upright
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import build_staircase

SENSORS = ("kinect1", "d435", "d455", "tof")
KINDS = ("flight", "dock", "kerb")
DISTANCES_M = (0.5, 1.0, 1.5, 2.0)
HEADING_DEG = 35.0
"""Largest angle between the way and the normal of the edge [deg]."""
RIGHT_M, RIGHT_SHARE = 0.05, 0.02
"""Largest error of an end that counts as right [m], and its part relative to the distance."""
GROUND_COLUMNS = (
    "| edge | sensor | distance | reported | right | bias | RMSE | in the 95 % interval | direction RMSE | without a lower pixel |"
)
FLOOR_COLUMNS = "| scenes without an edge | frames | drops reported | seen to 2.0 m |"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeView:
    """Frame before an edge."""

    frame: RgbdFrame
    gravity_C: Vector3
    heading_rad: float
    """Angle from the way to the edge's normal, the direction of ``FreeGround``."""
    shows_drop: bool
    """Whether any pixel with depth lies lower than the ground."""


def draw_edge(rng: np.random.Generator, kind: str, sensor: str, distance_m: float, *, rear: bool, missing: float = 0.0) -> EdgeView:
    """Return a frame before an edge at a distance, with gravity 0.5° off.

    Args:
        missing: Share of the pixels without depth, at random, in addition to those of the sensor.
    """
    chair = read_chair("wheelchair")
    heading_rad = rng.uniform(-HEADING_DEG, HEADING_DEG) * DEG
    solids, edge_x_m, level_m = _edge(kind, rng)
    before_m = distance_m * math.cos(heading_rad) + SWEPT_HALF_M * math.sin(abs(heading_rad))
    p_WB = np.array([edge_x_m + before_m, rng.uniform(-0.1, 0.1), level_m])
    camera = calibration_of(ViewRecipe(sensor=sensor), chair)
    if rear:
        camera = replace(camera, **{name: getattr(chair.camera_at(rear=True), name) for name in MOUNT_FIELDS})
    R_WB = rotation_z(heading_rad + (0.0 if rear else math.pi))
    R_WC = R_WB @ camera.R_BC
    scene = SceneCamera(solids, camera, kind=sensor, texture="wood", light=rng.uniform(0.35, 1.6), rng=rng)
    frame = scene.frame(0.0, R_WC, p_WB + R_WB @ np.array(camera.mount_m))
    frame.depth_m[rng.random(frame.depth_m.shape) < missing] = np.nan
    down_C = R_WC.T @ DOWN_W
    v, u = np.indices(frame.depth_m.shape)
    heights_m = camera.mount_m[2] - camera.pixel_to_point(u, v, frame.depth_m) @ down_C
    return EdgeView(
        frame=frame,
        gravity_C=tilted(down_C, 0.5 * DEG, rng),
        heading_rad=-heading_rad,
        shows_drop=bool(np.mean(heights_m < -0.05) > 0.002),
    )


def _edge(kind: str, rng: np.random.Generator) -> tuple[list[SceneBox], float, float]:
    """Return the solids of a scene with an edge along y, its place along x, beyond which it falls towards -x, and its level."""
    if kind == "flight":
        rise_m, slope_rad = rng.uniform(0.14, 0.19), rng.uniform(25.0, 35.0) * DEG
        walls = str(rng.choice(["none", "left", "right", "both"]))
        size = {"steps": int(rng.integers(8, 20)), "width_m": 3.6, "landing_m": 6.0, "walls": walls}
        staircase = build_staircase(Stair.model_validate({"rise_m": rise_m, "run_m": rise_m / math.tan(slope_rad)} | size), rng)
        opposite = oblique_wall(-rng.uniform(2.5, 5.5), math.pi)
        return [*solids_of(stair_boxes(staircase)), opposite], staircase.steps[-1].x_m, staircase.steps[-1].z_m
    drop_m = rng.uniform(0.5, 1.3) if kind == "dock" else rng.uniform(0.08, 0.18)
    low = upright("floor", (-20.0, -8.0, -drop_m - 0.2), (20.0, 8.0, -drop_m), texture="concrete")
    high = upright("floor", (0.0, -8.0, -drop_m - 0.1), (12.0, 8.0, 0.0), texture="concrete")
    wall = [oblique_wall(-rng.uniform(2.0, 6.0), rng.uniform(-0.4, 0.4), low_m=-drop_m)] if rng.random() < 0.5 else []
    return [low, high, *wall], 0.0, 0.0


def edge_rows(seeds: range, missing: float = 0.0) -> Iterator[str]:
    """Yield what is reported of edges, by kind, sensor and distance."""
    for kind, sensor, distance_m in product(KINDS, SENSORS, DISTANCES_M):
        views = [
            draw_edge(np.random.default_rng([seed, index]), kind, sensor, distance_m, rear=bool(seed % 2), missing=missing)
            for index, seed in enumerate(seeds)
        ]
        grounds = [ground_ahead(view.frame, view.gravity_C).free for view in views]
        yield f"| {kind} | {sensor} | {distance_m:.1f} m | {_row(views, grounds, distance_m)} |"


def _row(views: list[EdgeView], grounds: list[FreeGround], distance_m: float) -> str:
    """Return the figures of one row."""
    if all(distance_m < ground.blind_m for ground in grounds):
        near_m, far_m = min(ground.blind_m for ground in grounds), max(ground.blind_m for ground in grounds)
        return f"below the image, which begins at {near_m:.2f} to {far_m:.2f} m | | | | | |"
    ended = [(view, ground, ground.end_m, ground.end_sigma_m) for view, ground in zip(views, grounds, strict=True)]
    found = [(view, ground, end_m - distance_m, sigma_m) for view, ground, end_m, sigma_m in ended if end_m and sigma_m]
    errors = np.array([error_m for *_, error_m, _ in found])
    right = int((np.abs(errors) <= RIGHT_M + RIGHT_SHARE * distance_m).sum())
    inside = sum(abs(error_m) <= 1.96 * sigma_m for *_, error_m, sigma_m in found)
    turns = [ground.direction_rad - view.heading_rad for view, ground, *_ in found if ground.direction_rad is not None]
    unseen = sum(not view.shows_drop for view in views)
    return (
        f"{percent(len(found), len(views))} | {percent(right, len(views))} | {1e3 * errors.mean():+.0f} mm | "
        f"{1e3 * math.sqrt(np.mean(errors**2)):.0f} mm | {percent(inside, len(found))} | "
        f"{math.sqrt(np.mean(np.square(turns))) / DEG:.1f}° | {unseen} of {len(views)}"
    )


def floor_rows(seeds: range) -> Iterator[str]:
    """Yield how many frames of scenes without an edge show a drop, by sensor."""
    for sensor in SENSORS:
        drops, whole, count = 0, 0, 0
        for index, scene in enumerate((*STAIRLESS_SCENES, "foot")):
            recipe = ViewRecipe(scenes=(scene,), sensor=sensor, lateral_m=(-0.5, 0.5))
            for seed in seeds:
                view = draw_view(np.random.default_rng([seed, index]), recipe)
                ground = ground_ahead(view.frame, view.gravity_C).free
                drops, whole, count = drops + (ground.end_m is not None), whole + (ground.seen_m >= 2.0), count + 1
        share = f"{drops}, {percent(drops, count, 2)}"
        yield f"| {len(STAIRLESS_SCENES) + 1} kinds, {sensor} | {count} | {share} | {percent(whole, count)} |"
