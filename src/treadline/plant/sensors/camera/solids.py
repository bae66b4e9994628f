"""Visible objects of a scene: boxes with orientation and colour."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from treadline.core.rotations import Rotation, Vector3, rotation_z
from treadline.vehicle.stair_solids import Box

Rgb = tuple[float, float, float]
"""Colour (red, green, blue), 0 to 255."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shadow:
    """Dark band across the scene, the shadow of a beam or banister: all points near a plane."""

    normal_W: tuple[float, float, float]
    level_m: float
    """Distance of the band's middle along the normal [m]."""
    half_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneBox:
    """Box in the world with frame K."""

    kind: str
    """Kind: ``floor``, ``step``, ``riser``, ``landing``, ``wall`` as in a staircase, or another object."""
    centre_W: Vector3
    half_m: Vector3
    R_WK: Rotation
    colour: Rgb | None = None
    """Colour; None: the default of the kind."""
    texture: str | None = None
    """Texture; None: the default of the scene."""
    index: int = -1
    """Index of the step; -1 for other objects."""


def solids_of(boxes: Iterable[Box]) -> tuple[SceneBox, ...]:
    """Return the boxes of a staircase in their order."""
    return tuple(
        SceneBox(
            kind=box.kind,
            centre_W=np.array(box.centre_W),
            half_m=np.array(box.half_m),
            R_WK=box.R_WK,
            index=box.index,
        )
        for box in boxes
    )


def upright(
    kind: str,
    low_W: tuple[float, float, float],
    high_W: tuple[float, float, float],
    *,
    colour: Rgb | None = None,
    texture: str | None = None,
    yaw_rad: float = 0.0,
    index: int = -1,
) -> SceneBox:
    """Return a box between two corners, turned about its own middle."""
    low, high = np.array(low_W), np.array(high_W)
    return SceneBox(
        kind=kind,
        centre_W=0.5 * (low + high),
        half_m=0.5 * (high - low),
        R_WK=rotation_z(yaw_rad),
        colour=colour,
        texture=texture,
        index=index,
    )


def part_of(solid: SceneBox, x_m: tuple[float, float], y_m: tuple[float, float], z_m: tuple[float, float]) -> SceneBox:
    """Return a part of a solid, between coordinates of its own frame."""
    low, high = np.array([x_m[0], y_m[0], z_m[0]]), np.array([x_m[1], y_m[1], z_m[1]])
    return placed_in(solid, 0.5 * (low + high), 0.5 * (high - low), np.eye(3))


def placed_in(solid: SceneBox, centre_K: Vector3, half_m: Vector3, turn: Rotation) -> SceneBox:
    """Return a box of the same kind, placed in the frame of a solid."""
    return replace(solid, centre_W=solid.centre_W + solid.R_WK @ centre_K, half_m=half_m, R_WK=solid.R_WK @ turn)


def beam(kind: str, start_W: Vector3, end_W: Vector3, across_m: tuple[float, float], *, colour: Rgb | None = None) -> SceneBox:
    """Return a bar from one point to another.

    Args:
        across_m: Its width (horizontal, as far as it goes) and its height.
    """
    along = end_W - start_W
    length = float(np.linalg.norm(along))
    x = along / length
    side = np.cross(np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.99 else np.array([1.0, 0.0, 0.0]), x)
    y = side / np.linalg.norm(side)
    return SceneBox(
        kind=kind,
        centre_W=0.5 * (start_W + end_W),
        half_m=np.array([0.5 * length, 0.5 * across_m[0], 0.5 * across_m[1]]),
        R_WK=np.column_stack([x, y, np.cross(x, y)]),
        colour=colour,
        texture="dark",
    )
