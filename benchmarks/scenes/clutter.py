"""Objects on real stairs: rails, a person's legs, a mat, a bag, strips along the nosings, worn edges."""

import itertools
import math
from collections.abc import Callable

import numpy as np

from scenes.camera import Puddle
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, Shadow, beam, part_of, placed_in, upright
from treadline.vehicle.stair_solids import TREAD_THICKNESS_M
from treadline.vehicle.staircase import Staircase, Step

RAIL_INSET_M = 0.07
"""Distance from the side of the stair to the middle of a rail [m]."""
RAIL_M = 0.045
"""Thickness of a rail [m]."""
RAIL_HEIGHT_M = 0.9
"""Height of a rail above the treads [m]."""
POST_M = 0.025
"""Thickness of a post [m]."""
TROUSERS: tuple[Rgb, ...] = ((52.0, 60.0, 85.0), (70.0, 66.0, 60.0), (40.0, 40.0, 44.0))
BAGS: tuple[Rgb, ...] = ((150.0, 40.0, 38.0), (44.0, 74.0, 52.0), (60.0, 56.0, 52.0))
STEEL: Rgb = (150.0, 152.0, 156.0)
STRIP: Rgb = (214.0, 178.0, 50.0)
MAT: Rgb = (70.0, 84.0, 70.0)
OBSTACLES = ("leg", "bag")
"""Kinds of solids that block the chair."""
PIECE_M = 0.2
"""Length along a nosing of constant wear [m]."""
CHAMFER_M = 0.004
"""Thickness of the plate at a worn edge [m]; all but its face lies inside the step."""


def clutter_of(name: str, staircase: Staircase, step: int, rng: np.random.Generator) -> list[SceneBox]:
    """Return the solids of one kind of clutter; none for shadows and water.

    Args:
        step: Index of the step under the object, or near the middle of an object along the whole flight.
    """
    makers: dict[str, Callable[[], list[SceneBox]]] = {
        "rail_left": lambda: _rail(staircase, 1.0),
        "rail_right": lambda: _rail(staircase, -1.0),
        "legs": lambda: _legs(staircase, staircase.steps[step], rng),
        "mat": lambda: _mat(staircase, staircase.steps[step], rng),
        "bag": lambda: _bag(staircase, staircase.steps[step], rng),
        "strips": lambda: _strips(staircase),
    }
    return makers[name]() if name in makers else []


def cast_shadows(rng: np.random.Generator) -> list[Shadow]:
    """Return dark bands, oblique or nearly parallel to the steps, like shadows of a banister."""
    turns = rng.uniform(0.0, math.pi, size=int(rng.integers(2, 6)))
    return [
        Shadow(
            normal_W=(math.cos(turn) * 0.9, math.sin(turn) * 0.9, math.sqrt(0.19)),
            level_m=float(rng.uniform(-1.5, 4.5)),
            half_m=float(rng.uniform(0.02, 0.15)),
        )
        for turn in turns
    ]


def spilt(staircase: Staircase, steps: range, rng: np.random.Generator) -> list[Puddle]:
    """Return a puddle on most of the given treads."""
    return [
        Puddle(
            centre_W=(
                staircase.steps[i].x_m + float(rng.uniform(0.2, 0.8)) * staircase.steps[i].depth_m,
                float(rng.uniform(-0.35, 0.35)) * staircase.width_m,
                staircase.steps[i].z_m,
            ),
            half_m=(float(rng.uniform(0.06, 0.14)), float(rng.uniform(0.08, 0.35))),
        )
        for i in steps
        if rng.random() < 0.8
    ]


def _rail(staircase: Staircase, side: float) -> list[SceneBox]:
    first, last = staircase.steps[0], staircase.steps[-1]
    y = side * (0.5 * staircase.width_m - RAIL_INSET_M)
    start = np.array([first.x_m, y, first.z_m + RAIL_HEIGHT_M])
    end = np.array([last.x_m, y, last.z_m + RAIL_HEIGHT_M])
    posts = [
        beam(
            "rail",
            np.array([step.x_m + 0.5 * step.depth_m, y, step.z_m]),
            np.array([step.x_m + 0.5 * step.depth_m, y, step.z_m + RAIL_HEIGHT_M]),
            (POST_M, POST_M),
            colour=STEEL,
        )
        for step in staircase.steps[:: 3 if rail_is_sparse(staircase) else 1]
    ]
    return [beam("rail", start, end, (RAIL_M, RAIL_M), colour=STEEL), *posts]


def rail_is_sparse(staircase: Staircase) -> bool:
    """Return whether a rail has a post on every third step only: next to a wall a rail needs no bars."""
    return staircase.walls != "none"


def _legs(staircase: Staircase, step: Step, rng: np.random.Generator) -> list[SceneBox]:
    """Return the lower half of a person with the feet on two consecutive steps."""
    colour = TROUSERS[int(rng.integers(len(TROUSERS)))]
    y = float(rng.uniform(-0.5, 0.5)) * (staircase.width_m - 0.5)
    forward = 0.5 * step.depth_m
    hip = np.array([step.x_m + forward + 0.1, y, step.z_m + 0.95])
    solids = []
    for offset, rise, along in ((0.11, 0.0, forward), (-0.11, step.rise_m, forward + step.depth_m)):
        ankle = np.array([step.x_m + along, y + offset, step.z_m + rise + 0.08])
        solids.append(beam("leg", ankle, hip + np.array([0.0, offset, 0.0]), (0.13, 0.14), colour=colour))
        low = (step.x_m + along - 0.14, y + offset - 0.05, step.z_m + rise)
        high = (step.x_m + along + 0.12, y + offset + 0.05, step.z_m + rise + 0.1)
        solids.append(upright("leg", low, high, colour=(48.0, 38.0, 30.0), texture="dark"))
    return solids


def _mat(staircase: Staircase, step: Step, rng: np.random.Generator) -> list[SceneBox]:
    """Return a thin, slightly rotated mat."""
    y = float(rng.uniform(-0.2, 0.2))
    half = 0.35 * staircase.width_m
    low = (step.x_m + 0.03, y - half, step.z_m)
    high = (step.x_m + step.depth_m - 0.02, y + half, step.z_m + 0.012)
    return [upright("mat", low, high, colour=MAT, texture="carpet", yaw_rad=float(rng.uniform(-0.05, 0.05)))]


def _bag(staircase: Staircase, step: Step, rng: np.random.Generator) -> list[SceneBox]:
    """Return a bag leaning on the riser behind."""
    size = rng.uniform((0.16, 0.24, 0.22), (0.24, 0.4, 0.4))
    y = float(rng.uniform(-0.5, 0.5)) * (staircase.width_m - size[1])
    x = step.x_m + step.depth_m - 0.5 * size[0] - 0.03
    low = (x - 0.5 * size[0], y - 0.5 * size[1], step.z_m)
    high = (x + 0.5 * size[0], y + 0.5 * size[1], step.z_m + size[2])
    colour = BAGS[int(rng.integers(len(BAGS)))]
    return [upright("bag", low, high, colour=colour, texture="dark", yaw_rad=float(rng.uniform(-0.6, 0.6)))]


def _strips(staircase: Staircase) -> list[SceneBox]:
    """Return a coloured strip along each nosing, raised by one millimetre."""
    half = 0.5 * staircase.width_m
    strips = []
    for step in staircase.steps:
        if not step.missing:
            forward = np.array([math.cos(step.yaw_rad), math.sin(step.yaw_rad), 0.0])
            centre = np.array([step.x_m, 0.0, step.z_m]) + 0.03 * forward
            low, high = centre - np.array([0.025, half, 0.001]), centre + np.array([0.025, half, 0.001])
            strips.append(
                upright("strip", tuple(low), tuple(high), colour=STRIP, texture="dark", yaw_rad=step.yaw_rad, index=step.index)
            )
    return strips


def worn_step(solid: SceneBox, open_risers: bool, worn_m: float, rng: np.random.Generator) -> list[SceneBox]:
    """Return a step with a worn nosing: pieces along its length, each with a random chamfer."""
    limit = min(worn_m, 0.4 * TREAD_THICKNESS_M) if open_risers else worn_m
    half_depth, half_width, half_height = solid.half_m
    parts = [
        part_of(solid, (-half_depth, half_depth), (-half_width, half_width), (-half_height, half_height - limit)),
        part_of(solid, (limit - half_depth, half_depth), (-half_width, half_width), (half_height - limit, half_height)),
    ]
    cuts = np.linspace(-half_width, half_width, max(2, round(2.0 * half_width / PIECE_M)) + 1)
    for right, left in itertools.pairwise(cuts.tolist()):
        size = float(rng.uniform(0.15, 1.0)) * limit
        front, top = -half_depth, half_height
        parts.append(part_of(solid, (front, front + limit), (right, left), (top - limit, top - size)))
        parts.append(part_of(solid, (front + size, front + limit), (right, left), (top - size, top)))
        parts.append(_chamfer(solid, size, 0.5 * (right + left), 0.5 * (left - right)))
    return parts


def _chamfer(solid: SceneBox, size: float, y: float, half_width: float) -> SceneBox:
    """Return the plate whose upper face truncates the front edge at 45°."""
    half_depth, _, half_height = solid.half_m
    c = math.sqrt(0.5)
    face = np.array([0.5 * size - half_depth, y, half_height - 0.5 * size])
    normal = np.array([-c, 0.0, c])
    turn = np.column_stack([np.array([c, 0.0, c]), np.array([0.0, 1.0, 0.0]), normal])
    thickness = min(CHAMFER_M, c * size)
    return placed_in(solid, face - 0.5 * thickness * normal, np.array([c * size, half_width, 0.5 * thickness]), turn)
