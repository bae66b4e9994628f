"""Further scenes without a stair to climb: walls and floors with relief, kerbs, terraces and street furniture."""

import math
from collections.abc import Callable

import numpy as np

from scenes.placing import BEECH, WHITE, incline, legged, oblique_wall, turned
from treadline.core.angles import DEG
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, beam, upright

ASPHALT: Rgb = (78.0, 78.0, 80.0)
"""Colours (red, green, blue)."""
GRANITE: Rgb = (146.0, 144.0, 140.0)
STEEL: Rgb = (130.0, 132.0, 136.0)


def corrugated(rng: np.random.Generator) -> list[SceneBox]:
    """Return a corrugated or boarded wall: horizontal or upright ribs at an even pitch."""
    x, yaw, pitch, deep = rng.uniform(1.0, 2.5), rng.uniform(-25.0, 25.0) * DEG, rng.uniform(0.08, 0.3), rng.uniform(0.01, 0.06)
    if rng.random() < 0.6:
        ribs = [upright("wall", (x, -3.0, z), (x + 0.1, 3.0, z + 0.5 * pitch), colour=WHITE) for z in np.arange(0.0, 2.5, pitch)]
    else:
        ribs = [upright("wall", (x, y, 0.0), (x + 0.1, y + 0.5 * pitch, 2.5), colour=WHITE) for y in np.arange(-3.0, 3.0, pitch)]
    return [turned(solid, yaw, (x, 0.0)) for solid in (*ribs, oblique_wall(x + deep, 0.0))]


def relief(rng: np.random.Generator) -> list[SceneBox]:
    """Return a tiled floor with relief: guidance strips or slabs a few millimetres to centimetres high."""
    yaw, pitch, high = rng.uniform(-30.0, 30.0) * DEG, rng.uniform(0.08, 0.4), rng.uniform(0.004, 0.03)
    strips = [upright("tile", (x, -1.5, 0.0), (x + 0.5 * pitch, 1.5, high), colour=GRANITE) for x in np.arange(0.3, 4.0, pitch)]
    return [turned(strip, yaw, (1.5, 0.0)) for strip in strips]


def kerb(rng: np.random.Generator) -> list[SceneBox]:
    """Return a pavement with a kerb, sometimes with a gutter before it and a wall behind."""
    x, high, yaw = rng.uniform(0.9, 2.0), rng.uniform(0.06, 0.2), rng.uniform(-35.0, 35.0) * DEG
    solids = [
        upright("kerb", (x, -4.0, 0.0), (x + 0.15, 4.0, high), colour=GRANITE),
        upright("floor", (x + 0.15, -4.0, 0.0), (x + 5.0, 4.0, high - 0.005), colour=ASPHALT),
    ]
    if rng.random() < 0.5:
        solids.append(upright("kerb", (x - rng.uniform(0.2, 0.4), -4.0, 0.0), (x, 4.0, rng.uniform(0.01, 0.04)), colour=GRANITE))
    if rng.random() < 0.5:
        solids.append(oblique_wall(x + rng.uniform(0.5, 2.0), 0.0))
    return [turned(solid, yaw, (x, 0.0)) for solid in solids]


def ramp_turn(rng: np.random.Generator) -> list[SceneBox]:
    """Return two ramps with a landing between them, or a ramp with cross battens."""
    slope, x, half = rng.uniform(4.0, 14.0) * DEG, rng.uniform(0.8, 1.4), rng.uniform(0.5, 0.9)
    length = rng.uniform(1.0, 1.8)
    first = incline(x, 0.0, slope, length, half, ASPHALT)
    end, top = x + length * math.cos(slope), length * math.sin(slope)
    if rng.random() < 0.5:
        flat = upright("ramp", (end, -half, top - 0.2), (end + 0.6, half, top), colour=ASPHALT)
        return [first, flat, incline(end + 0.6, top, slope, 2.0, half, ASPHALT)]
    along, up = np.array([math.cos(slope), 0.0, math.sin(slope)]), np.array([-math.sin(slope), 0.0, math.cos(slope)])
    foot, aside = np.array([x, 0.0, 0.0]), np.array([0.0, half, 0.0])
    battens = [
        beam("ramp", foot + at * along - aside + 0.008 * up, foot + at * along + aside + 0.008 * up, (0.04, 0.02), colour=BEECH)
        for at in np.arange(0.2, length, rng.uniform(0.2, 0.35))
    ]
    return [first, *battens]


def street(rng: np.random.Generator) -> list[SceneBox]:
    """Return street furniture on a pavement: a bench, bollards, a planter and a bicycle rack."""
    solids = legged(rng.uniform(1.4, 2.2), rng.uniform(-0.5, 0.5), (0.2, 0.8), 0.45, 0.03, BEECH)
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(1.2, 3.0), rng.uniform(-1.2, 1.2)
        solids.append(upright("street", (x, y, 0.0), (x + 0.12, y + 0.12, 0.9), colour=STEEL))
    x, y = rng.uniform(1.2, 2.5), rng.uniform(-1.2, 0.6)
    solids += [
        upright("street", (x, y, 0.0), (x + 0.6, y + 0.8, 0.45), colour=GRANITE),
        upright("street", (x + 0.08, y + 0.08, 0.4), (x + 0.52, y + 0.72, 0.6), colour=(60.0, 88.0, 52.0)),
    ]
    rack = rng.uniform(1.5, 2.5)
    for k in range(5):
        start = np.array([rack + 0.3 * k, 1.0, 0.0])
        solids += [
            beam("street", start, start + np.array([0.0, 0.0, 0.8]), (0.04, 0.04), colour=STEEL),
            beam("street", start + np.array([0.0, 0.0, 0.8]), start + np.array([0.0, 0.6, 0.8]), (0.04, 0.04), colour=STEEL),
        ]
    yaw = rng.uniform(-30.0, 30.0) * DEG
    return [turned(solid, yaw, (1.8, 0.0)) for solid in solids]


def terrace(rng: np.random.Generator) -> list[SceneBox]:
    """Return seats of a grandstand: even, but with rises of 0.38 m or more, beyond any chair."""
    x, rise, run, half = rng.uniform(0.9, 1.6), rng.uniform(0.38, 0.5), rng.uniform(0.6, 0.9), rng.uniform(0.8, 2.0)
    yaw = rng.uniform(-20.0, 20.0) * DEG
    seats = [
        upright("seat", (x + i * run, -half, i * rise), (x + (i + 1) * run + 0.05, half, (i + 1) * rise), colour=GRANITE)
        for i in range(4)
    ]
    return [turned(seat, yaw, (x, 0.0)) for seat in seats]


def podium(rng: np.random.Generator) -> list[SceneBox]:
    """Return a platform of 0.2 to 0.8 m, with a board along its rim."""
    x, high, yaw = rng.uniform(1.0, 1.8), rng.uniform(0.2, 0.8), rng.uniform(-25.0, 25.0) * DEG
    solids = [
        upright("furniture", (x, -2.0, 0.0), (x + 2.0, 2.0, high), colour=BEECH, texture="wood"),
        upright("furniture", (x - 0.02, -2.0, high - 0.1), (x, 2.0, high + 0.02), colour=WHITE),
    ]
    return [turned(solid, yaw, (x, 0.0)) for solid in solids]


def fence(rng: np.random.Generator) -> list[SceneBox]:
    """Return a fence with horizontal rails and nothing behind but a distant wall."""
    x, pitch, half, yaw = rng.uniform(1.0, 2.0), rng.uniform(0.12, 0.35), rng.uniform(0.8, 2.0), rng.uniform(-30.0, 30.0) * DEG
    rails = [
        upright("fence", (x, -half, z), (x + 0.03, half, z + rng.uniform(0.04, 0.1)), colour=BEECH)
        for z in np.arange(0.1, rng.uniform(1.0, 1.8), pitch)
    ]
    posts = [upright("fence", (x + 0.03, y, 0.0), (x + 0.1, y + 0.08, 1.8), colour=BEECH) for y in np.arange(-half, half, 0.9)]
    return [*(turned(solid, yaw, (x, 0.0)) for solid in (*rails, *posts)), oblique_wall(x + rng.uniform(1.5, 3.0), yaw)]


MAKERS: dict[str, Callable[[np.random.Generator], list[SceneBox]]] = {
    make.__name__: make for make in (corrugated, relief, kerb, ramp_turn, street, terrace, podium, fence)
}
"""Function of each scene."""
