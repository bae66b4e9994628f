"""Scenes without a stair to climb: floors, walls, furniture, ramps, ladders and single steps.

The chair stands on the horizontal floor at the origin; all objects are ahead, along +x.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from scenes import furniture, outdoors
from scenes.placing import BEECH, CARDBOARD, WALL_M, WHITE, incline, leaning_ladder, legged, oblique_wall, turned
from treadline.core.angles import DEG
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, upright

BOOKS: tuple[Rgb, ...] = ((120.0, 40.0, 40.0), (40.0, 70.0, 110.0), (60.0, 100.0, 60.0), (190.0, 180.0, 150.0))
"""Colours of books (red, green, blue)."""
FLOORS = ("wood", "concrete", "carpet", "terrazzo")
"""Textures of floors."""
HALL_M = 8.0
"""Half size of the floor [m]."""


def room(scene: str, rng: np.random.Generator) -> list[SceneBox]:
    """Return all solids of a scene, including the floor."""
    floor = upright("floor", (-HALL_M, -HALL_M, -0.2), (HALL_M, HALL_M, 0.0), texture=FLOORS[int(rng.integers(len(FLOORS)))])
    return [floor, *(plain(solid) for solid in MAKERS[scene](rng))]


def plain(solid: SceneBox) -> SceneBox:
    """Return a wall with a plaster texture; other solids unchanged."""
    return replace(solid, texture="dark") if solid.kind == "wall" else solid


def _floor(rng: np.random.Generator) -> list[SceneBox]:
    del rng
    return []


def _wall(rng: np.random.Generator) -> list[SceneBox]:
    return [oblique_wall(rng.uniform(1.2, 3.0), rng.uniform(-35.0, 35.0) * DEG)]


def _sides(half_width_m: float) -> list[SceneBox]:
    return [
        upright("wall", (-HALL_M, half_width_m, -0.2), (HALL_M, half_width_m + 0.1, WALL_M)),
        upright("wall", (-HALL_M, -half_width_m - 0.1, -0.2), (HALL_M, -half_width_m, WALL_M)),
    ]


def _corridor(rng: np.random.Generator) -> list[SceneBox]:
    sides = _sides(rng.uniform(0.6, 1.1))
    skirting = [
        upright(
            "wall", (-HALL_M, side.centre_W[1] - 0.065, 0.0), (HALL_M, side.centre_W[1] + 0.065, 0.1), colour=WHITE, texture="dark"
        )
        for side in sides
    ]
    doors = [oblique_wall(rng.uniform(2.0, 5.0), rng.uniform(-5.0, 5.0) * DEG)] if rng.random() < 0.5 else []
    return [*sides, *skirting, *doors]


def _corner(rng: np.random.Generator) -> list[SceneBox]:
    yaw, y = rng.uniform(-40.0, 40.0) * DEG, rng.uniform(0.7, 1.2) * rng.choice([-1.0, 1.0])
    return [oblique_wall(rng.uniform(1.5, 2.5), yaw), oblique_wall(1.0, yaw + math.copysign(90.0, y) * DEG, y_m=y)]


def _shelf(rng: np.random.Generator) -> list[SceneBox]:
    """Return horizontal boards one above the other, some with books: as many parallel edges as a stair."""
    x, depth, gap = rng.uniform(0.9, 1.8), rng.uniform(0.22, 0.4), rng.uniform(0.16, 0.36)
    half = rng.uniform(0.4, 0.9)
    yaw = rng.uniform(-25.0, 25.0) * DEG
    boards = []
    for level in np.arange(0.06, 1.9, gap):
        boards.append(upright("shelf", (x, -half, level), (x + depth, half, level + 0.02), colour=BEECH, texture="wood"))
        y = -half + 0.05
        while y < half - 0.1 and rng.random() < 0.9:
            thick, tall = rng.uniform(0.02, 0.06), rng.uniform(0.5, 0.9) * gap
            colour = BOOKS[int(rng.integers(len(BOOKS)))]
            low = (x + rng.uniform(0.01, 0.06), y, level + 0.02)
            boards.append(upright("book", low, (x + depth - 0.02, y + thick, level + 0.02 + tall), colour=colour))
            y += thick + 0.004
    frame = [
        upright("shelf", (x, side - 0.01, 0.0), (x + depth, side + 0.01, 1.95), colour=BEECH, texture="wood")
        for side in (-half, half)
    ]
    back = upright("shelf", (x + depth, -half, 0.0), (x + depth + 0.01, half, 1.95), colour=BEECH, texture="wood")
    return [turned(solid, yaw, (x, 0.0)) for solid in (*boards, *frame, back)]


def _table(rng: np.random.Generator) -> list[SceneBox]:
    x, y, yaw = rng.uniform(1.6, 2.6), rng.uniform(-0.4, 0.4), rng.uniform(-40.0, 40.0) * DEG
    solids = legged(x, y, (0.45, 0.8), 0.74, 0.025, BEECH)
    for side in (-0.35, 0.35):
        cx, cy = x - 0.55, y + side
        solids += legged(cx, cy, (0.22, 0.2), 0.45, 0.018, WHITE)
        solids.append(upright("furniture", (cx - 0.24, cy - 0.2, 0.55), (cx - 0.22, cy + 0.2, 0.9), colour=WHITE, texture="dark"))
    wall = [oblique_wall(x + rng.uniform(0.8, 2.0), yaw)] if rng.random() < 0.5 else []
    return [*(turned(solid, yaw, (x, y)) for solid in solids), *wall]


def _boxes(rng: np.random.Generator) -> list[SceneBox]:
    """Return a heap of cartons with random orientations, some on top of others."""
    solids = []
    for _ in range(int(rng.integers(5, 11))):
        size = rng.uniform(0.15, 0.6, size=3)
        x, y = rng.uniform(1.0, 2.6), rng.uniform(-0.9, 0.9)
        z = 0.0 if rng.random() < 0.6 else rng.uniform(0.15, 0.5)
        low = (x - 0.5 * size[0], y - 0.5 * size[1], z)
        high = (x + 0.5 * size[0], y + 0.5 * size[1], z + size[2])
        solids.append(upright("carton", low, high, colour=CARDBOARD, texture="dark", yaw_rad=rng.uniform(-1.5, 1.5)))
    return solids


def _ramp(rng: np.random.Generator) -> list[SceneBox]:
    slope, start, length = rng.uniform(5.0, 30.0) * DEG, rng.uniform(0.8, 1.6), rng.uniform(2.0, 6.0)
    return [
        incline(start, 0.0, slope, length, rng.uniform(0.6, 1.2)),
        *(_sides(rng.uniform(0.7, 1.3)) if rng.random() < 0.5 else []),
    ]


def _landing(rng: np.random.Generator) -> list[SceneBox]:
    """Return an oblique wall and possibly side walls: the view after a climb."""
    yaw = rng.uniform(-20.0, 20.0) * DEG
    return [oblique_wall(rng.uniform(1.0, 2.5), yaw), *_sides(rng.uniform(0.6, 1.2))[: int(rng.integers(3))]]


def _steep(rng: np.random.Generator) -> list[SceneBox]:
    """Return a stair too steep to climb: 50° to 62°, with rises beyond the limits of any chair."""
    slope, run, half = rng.uniform(50.0, 62.0) * DEG, rng.uniform(0.14, 0.2), rng.uniform(0.35, 0.6)
    start, rise = rng.uniform(0.9, 1.8), run * math.tan(slope)
    return [upright("step", (start + i * run, -half, i * rise), (start + (i + 2) * run, half, (i + 1) * rise)) for i in range(9)]


def _ladder(rng: np.random.Generator) -> list[SceneBox]:
    """Return a ladder leaning on a wall."""
    lean, gap, half = rng.uniform(62.0, 78.0) * DEG, rng.uniform(0.25, 0.32), rng.uniform(0.2, 0.3)
    foot = np.array([rng.uniform(0.8, 1.6), 0.0, 0.0])
    ladder = leaning_ladder(foot, lean, half, 3.0, np.arange(gap, 2.9, gap), (0.03, 0.07), (0.03, 0.08), BEECH)
    return [*ladder, oblique_wall(foot[0] + 3.0 * math.cos(lean), 0.0)]


def _threshold(rng: np.random.Generator) -> list[SceneBox]:
    """Return a door frame with a single step: an edge, but no stair."""
    x, rise, half = rng.uniform(1.0, 1.8), rng.uniform(0.03, 0.19), rng.uniform(0.4, 0.55)
    inside = upright("floor", (x, -HALL_M, -0.1), (HALL_M, HALL_M, rise))
    jambs = [
        upright("wall", (x + 0.02, min(side, 4.0 * side), 0.0), (x + 0.14, max(side, 4.0 * side), WALL_M)) for side in (-half, half)
    ]
    return [inside, *jambs]


def _stripes(rng: np.random.Generator) -> list[SceneBox]:
    """Return painted lines across a floor: edges in colour, none in depth."""
    yaw, gap, wide = rng.uniform(-25.0, 25.0) * DEG, rng.uniform(0.25, 0.4), rng.uniform(0.03, 0.15)
    lines = [
        upright("strip", (x, -1.5, 0.0), (x + wide, 1.5, 0.0005), colour=WHITE, texture="dark") for x in np.arange(0.5, 5.0, gap)
    ]
    return [turned(line, yaw, (1.5, 0.0)) for line in lines]


def _bench(rng: np.random.Generator) -> list[SceneBox]:
    """Return a bench, plinth or sill before a wall: two vertical faces separated by the run of a step."""
    x, deep, high = rng.uniform(1.1, 2.0), rng.uniform(0.2, 0.45), rng.uniform(0.1, 0.6)
    yaw = rng.uniform(-20.0, 20.0) * DEG
    seat = upright("furniture", (x, -1.2, 0.0), (x + deep + 0.1, 1.2, high), colour=BEECH, texture="wood")
    return [turned(seat, yaw, (x, 0.0)), turned(oblique_wall(x + deep, 0.0), yaw, (x, 0.0))]


def _pallets(rng: np.random.Generator) -> list[SceneBox]:
    """Return a stack of pallets: horizontal boards with gaps, one above the other and none behind another."""
    x, yaw = rng.uniform(1.0, 1.8), rng.uniform(-30.0, 30.0) * DEG
    boards = []
    for floor in range(int(rng.integers(1, 5))):
        for low, high in ((0.0, 0.02), (0.09, 0.12), (0.12, 0.144)):
            for i in range(5 if high != 0.12 else 3):
                y = -0.4 + i * (0.17 if high != 0.12 else 0.34)
                box = ((x, y, floor * 0.144 + low), (x + 1.2, y + 0.1, floor * 0.144 + high))
                boards.append(upright("pallet", *box, colour=BEECH, texture="wood"))
    return [turned(board, yaw, (x, 0.0)) for board in boards]


PLACES = (_floor, _wall, _corridor, _corner, _ramp, _landing, _steep, _threshold, _stripes)
THINGS = (_shelf, _table, _boxes, _ladder, _bench, _pallets)
MAKERS: dict[str, Callable[[np.random.Generator], list[SceneBox]]] = {
    **{make.__name__.removeprefix("_"): make for make in (*PLACES, *THINGS)},
    **furniture.MAKERS,
    **outdoors.MAKERS,
}
"""Function of each scene."""
