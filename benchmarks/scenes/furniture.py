"""Further scenes without a stair to climb: furniture, goods, building parts and street furniture with repeated edges.

Objects are ahead of the chair, along +x, as in ``rooms``. Some are stairs by shape (stepped cartons and pallets, drawers, the foot
of an escalator), but narrower than a chair or not to be climbed.
"""

import math
from collections.abc import Callable

import numpy as np

from scenes.placing import BEECH, CARDBOARD, WHITE, leaning_ladder, legged, oblique_wall, turned
from treadline.core.angles import DEG
from treadline.core.rotations import rotation_y
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, upright

GALVANISED: Rgb = (150.0, 154.0, 158.0)
"""Colours (red, green, blue)."""
FABRIC: Rgb = (92.0, 84.0, 100.0)
BRICK: Rgb = (150.0, 88.0, 70.0)
CRATE_BLUE: Rgb = (52.0, 84.0, 140.0)


def carton_steps(rng: np.random.Generator) -> list[SceneBox]:
    """Return cartons stacked like a stair, 0.3 to 0.6 m wide."""
    count, half = int(rng.integers(3, 6)), rng.uniform(0.15, 0.3)
    high, deep, x = rng.uniform(0.12, 0.25), rng.uniform(0.25, 0.4), rng.uniform(0.9, 1.5)
    cartons = [
        upright("carton", (x + i * deep, -half, k * high), (x + (i + 1) * deep, half, (k + 1) * high), colour=CARDBOARD)
        for i in range(count)
        for k in range(i + 1)
    ]
    return _yawed(cartons, x, rng)


def pallet_steps(rng: np.random.Generator) -> list[SceneBox]:
    """Return stacks of pallets of growing height, one behind another, 0.8 m wide."""
    x, run = rng.uniform(0.9, 1.5), rng.uniform(0.25, 0.45)
    stacks = [
        upright("pallet", (x + i * run, -0.4, k * 0.144 + low), (x + (i + 1) * run + 0.1, 0.4, k * 0.144 + high), colour=BEECH)
        for i in range(int(rng.integers(3, 6)))
        for k in range(i + 1)
        for low, high in ((0.0, 0.022), (0.1, 0.144))
    ]
    return _yawed(stacks, x, rng)


def drawers(rng: np.random.Generator) -> list[SceneBox]:
    """Return a chest whose drawers are pulled out further the lower they are."""
    x, half, high = rng.uniform(1.2, 1.8), rng.uniform(0.2, 0.45), rng.uniform(0.14, 0.25)
    count, pull = int(rng.integers(3, 6)), rng.uniform(0.1, 0.25)
    solids = [upright("furniture", (x, -half - 0.02, 0.0), (x + 0.5, half + 0.02, count * high + 0.03), colour=WHITE)]
    for k in range(count):
        front = x - pull * (count - k)
        solids.append(
            upright("furniture", (front, -half, k * high + 0.01), (front + 0.02, half, (k + 1) * high - 0.01), colour=BEECH)
        )
        # What lies in the drawer ends a few centimetres below its rim.
        solids.append(upright("furniture", (front, -half, k * high + 0.01), (x, half, (k + 0.7) * high), colour=WHITE))
    return _yawed([*solids, oblique_wall(x + 0.55, 0.0)], x, rng)


def escalator(rng: np.random.Generator) -> list[SceneBox]:
    """Return the foot of an escalator: level steps that rise by more and more, between balustrades."""
    x, half, run = rng.uniform(0.7, 1.3), rng.uniform(0.3, 0.5), 0.4
    rises = np.clip(np.arange(7) - 1.5, 0.0, 3.0) / 3.0 * 0.21
    tops = np.cumsum(rises)
    steps = [
        upright("step", (x + i * run, -half, top - rise - 0.05), (x + (i + 1) * run + 0.05, half, top), colour=GALVANISED, index=i)
        for i, (top, rise) in enumerate(zip(tops.tolist(), rises.tolist(), strict=True))
    ]
    sides = [
        upright("furniture", (x - 0.4, side - 0.06, 0.0), (x + 7.0 * run, side + 0.06, 0.95), colour=GALVANISED, texture="dark")
        for side in (-half - 0.07, half + 0.07)
    ]
    return [*steps, *sides]


def blinds(rng: np.random.Generator) -> list[SceneBox]:
    """Return a venetian blind or louvre before a window: slats one above the other, each tilted."""
    x, half, wide = rng.uniform(0.9, 1.8), rng.uniform(0.4, 0.9), rng.uniform(0.05, 0.25)
    # From open (level) to nearly closed; slats of a closed blind touch each other.
    pitch, turn = rng.uniform(0.6, 1.1) * wide, rotation_y(rng.uniform(-75.0, 75.0) * DEG)
    low = rng.uniform(0.0, 0.8)
    slats = [
        SceneBox(kind="blind", centre_W=np.array([x, 0.0, z]), half_m=np.array([0.5 * wide, half, 0.0015]), R_WK=turn, colour=WHITE)
        for z in np.arange(low, 2.1, pitch)
    ]
    return _yawed([*slats, oblique_wall(x + rng.uniform(0.06, 0.2), 0.0)], x, rng)


def radiator(rng: np.random.Generator) -> list[SceneBox]:
    """Return a radiator with horizontal tubes, or with vertical ribs, before a wall."""
    x, half, low = rng.uniform(0.9, 1.8), rng.uniform(0.3, 0.8), rng.uniform(0.1, 0.2)
    if rng.random() < 0.5:
        pitch = rng.uniform(0.04, 0.12)
        parts = [
            upright("furniture", (x, -half, z), (x + 0.05, half, z + 0.6 * pitch), colour=WHITE)
            for z in np.arange(low, low + rng.uniform(0.6, 1.6), pitch)
        ]
    else:
        parts = [
            upright("furniture", (x, y, low), (x + 0.12, y + 0.03, low + 0.6), colour=WHITE) for y in np.arange(-half, half, 0.06)
        ]
    return _yawed([*parts, oblique_wall(x + 0.16, 0.0)], x, rng)


def chairs(rng: np.random.Generator) -> list[SceneBox]:
    """Return stacked chairs, each further forward and higher than the one below."""
    x, y, lift, lean = rng.uniform(1.1, 1.8), rng.uniform(-0.3, 0.3), rng.uniform(0.07, 0.15), rng.uniform(0.0, 0.05)
    solids: list[SceneBox] = []
    for k in range(int(rng.integers(3, 8))):
        cx, z = x - k * lean, k * lift
        seat, *legs = legged(cx, y, (0.21, 0.21), 0.45 + z, 0.015, GALVANISED)
        solids += [seat, *(legs if k == 0 else [])]
        solids.append(upright("furniture", (cx + 0.19, y - 0.2, 0.55 + z), (cx + 0.21, y + 0.2, 0.8 + z), colour=FABRIC))
    return _yawed(solids, x, rng)


def sofa(rng: np.random.Generator) -> list[SceneBox]:
    """Return a sofa with a footstool before it: stool, seat and back are three levels."""
    x, half, seat = rng.uniform(1.1, 1.8), rng.uniform(0.5, 1.0), rng.uniform(0.35, 0.45)
    solids = [
        upright("furniture", (x, -half, 0.0), (x + 0.6, half, seat), colour=FABRIC, texture="carpet"),
        upright(
            "furniture", (x + 0.6, -half, 0.0), (x + 0.85, half, seat + rng.uniform(0.3, 0.45)), colour=FABRIC, texture="carpet"
        ),
    ]
    if rng.random() < 0.6:
        front = x - rng.uniform(0.3, 0.6)
        solids.append(upright("furniture", (front, -0.3, 0.0), (x - 0.02, 0.3, rng.uniform(0.15, 0.3)), colour=FABRIC))
    armrests = [
        upright("furniture", (x, side - 0.09, 0.0), (x + 0.85, side + 0.09, seat + 0.2), colour=FABRIC) for side in (-half, half)
    ]
    return _yawed([*solids, *armrests], x, rng)


def cable_ladder(rng: np.random.Generator) -> list[SceneBox]:
    """Return a cable ladder that leans, lies on the floor or hangs on a wall: rungs at an even pitch."""
    lean, pitch, half = rng.choice([0.0, 30.0, 60.0, 90.0]) * DEG, rng.uniform(0.15, 0.3), rng.uniform(0.1, 0.3)
    foot = np.array([rng.uniform(0.9, 1.5), 0.0, 0.03])
    ladder = leaning_ladder(foot, lean, half, 2.5, np.arange(pitch, 2.4, pitch), (0.01, 0.06), (0.03, 0.02), GALVANISED)
    return [*ladder, oblique_wall(foot[0] + 2.6 * math.cos(lean) + 0.06, 0.0)]


def crates(rng: np.random.Generator) -> list[SceneBox]:
    """Return rows of stacked bottle crates of uneven heights, aligned with each other."""
    x, half_width, high = rng.uniform(0.9, 1.6), 0.2, rng.uniform(0.24, 0.3)
    stacks = [
        upright(
            "crate", (x + i * 0.3, y - half_width, k * high), (x + (i + 1) * 0.3 - 0.005, y + half_width - 0.005, (k + 1) * high)
        )
        for i in range(3)
        for y in (-0.4, 0.0, 0.4)
        for k in range(int(rng.integers(0, 4)))
    ]
    coloured = [SceneBox(kind="crate", centre_W=s.centre_W, half_m=s.half_m, R_WK=s.R_WK, colour=CRATE_BLUE) for s in stacks]
    return _yawed([*coloured, oblique_wall(x + 1.0, 0.0)], x, rng)


def rubble(rng: np.random.Generator) -> list[SceneBox]:
    """Return a heap of bricks and slabs at any angle, higher towards its middle."""
    solids = []
    for _ in range(60):
        x, y = rng.normal(1.9, 0.4), rng.normal(0.0, 0.5)
        z = max(0.5 - 0.6 * math.hypot(x - 1.9, y), 0.0) * rng.uniform(0.3, 1.0)
        axis = rng.standard_normal(3)
        turn = np.linalg.qr(np.column_stack([axis, rng.standard_normal((3, 2))]))[0]
        half = rng.uniform((0.05, 0.03, 0.02), (0.25, 0.12, 0.06))
        solids.append(
            SceneBox(
                kind="rubble", centre_W=np.array([x, y, z]), half_m=half, R_WK=turn * np.sign(np.linalg.det(turn)), colour=BRICK
            )
        )
    return solids


def _yawed(solids: list[SceneBox], x_m: float, rng: np.random.Generator) -> list[SceneBox]:
    """Return the solids turned about their front by up to 25°."""
    yaw = rng.uniform(-25.0, 25.0) * DEG
    return [turned(solid, yaw, (x_m, 0.0)) for solid in solids]


MAKERS: dict[str, Callable[[np.random.Generator], list[SceneBox]]] = {
    make.__name__: make
    for make in (carton_steps, pallet_steps, drawers, escalator, blinds, radiator, chairs, sofa, cable_ladder, crates, rubble)
}
"""Function of each scene."""
