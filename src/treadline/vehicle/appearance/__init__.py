"""Appearance of chair, passenger and stair: triangle meshes generated from their descriptions, for viewers, URDF and drawings.

Origins of the lengths: places and sizes of hull, belts, pulleys, flipper, seat linkage, payload and cameras are those of the
chair's file, and steps those of the staircase. A person's segment lengths are fractions of the stature (Drillis and Contini, 1966),
and the camera housing has the size of a data sheet. Every other length and fraction in this package is *drawn only*: chosen for the
look, without an origin. No block, simulator or check reads a mesh (an import contract in ``pyproject.toml``), so no result depends
on it.
"""

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import rotation_y
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance._belts import BeltPath, lug_part, lug_poses, resting_lugs, track_parts
from treadline.vehicle.appearance._chassis import chassis_parts
from treadline.vehicle.appearance._mesh import BodyName, Colour, Mesh, MeshPart, box, colour, cylinder, part
from treadline.vehicle.appearance._seat import linkage_poses, seat_parts
from treadline.vehicle.bodies import flipper_turns, vehicle
from treadline.vehicle.stair_solids import Box, NosingGeometry, Solid, stair_solids
from treadline.vehicle.staircase import Staircase

__all__ = [
    "LINKAGE_BODIES", "BeltPath", "BodyName", "Colour", "MeshPart", "body_poses", "chair_parts", "colour",
    "lug_part", "lug_poses", "resting_lugs", "stair_parts",
]  # fmt: skip

LINKAGE_BODIES = ("bar", "slider")
"""Bodies without a link in the URDF: their motion follows from the seat's, and a URDF has no joint for such a mechanism."""
COLOUR_OF = {"treads": "tread", "risers": "riser", "landings": "landing", "nosings": "nosing", "floor": "floor", "walls": "wall"}
"""Colour of each kind of part."""


def chair_parts(chair: ChairDescription, loading: Chair, belts: Belts | None = None) -> tuple[MeshPart, ...]:
    """Return a chair with its payload; the lugs are drawn by ``lug_part`` at ``lug_poses``.

    Args:
        belts: Lug profile of the scenario; None: a smooth belt, drawn with low lugs.
    """
    return (*chassis_parts(chair), *track_parts(chair, belts), *seat_parts(chair, loading))


def body_poses(
    chair: ChairDescription, loading: Chair, seat_rad: float = 0.0, flipper_rad: float | None = None
) -> dict[BodyName, Float[np.ndarray, "4 4"]]:
    """Return the pose in B of each body that carries parts.

    Args:
        seat_rad: Forward angle of the seat relative to the chassis; a seat is level if it equals the chassis' pitch.
        flipper_rad: Angle of the flipper above the flat run; None: its rest angle.
    """
    whole = vehicle(chair, loading)
    poses: dict[BodyName, Float[np.ndarray, "4 4"]] = {"chair": np.eye(4)}
    if chair.seat is not None:
        poses["seat"] = _turned(whole.seat.origin_m, seat_rad)
        poses |= linkage_poses(chair, loading, seat_rad)
    turns = flipper_turns(chair, flipper_rad)
    return poses | {body.name: _turned(body.origin_m, turns[body.name]) for body in whole.flippers}


def _turned(origin: tuple[float, float, float], angle_rad: float) -> Float[np.ndarray, "4 4"]:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rotation_y(angle_rad), origin
    return X


def stair_parts(staircase: Staircase) -> tuple[MeshPart, ...]:
    """Return a staircase, with floor and walls; the chair is visible through the walls."""
    meshes: dict[str, list[Mesh]] = {}
    for solid in stair_solids(staircase):
        for name, mesh in _meshes(solid):
            meshes.setdefault(name, []).append(mesh)
    return tuple(part(name, "world", found, COLOUR_OF[name], 0.25 if name == "walls" else 1.0) for name, found in meshes.items())


def _meshes(solid: Solid) -> list[tuple[str, Mesh]]:
    shape, top = solid.box, solid.box.half_m[2]
    whole = {"floor": "floor", "wall": "walls", "riser": "risers"}
    if shape.kind in whole:
        return [(whole[shape.kind], _slab(shape, -top, top))]
    layer = min(0.02, top)  # the upper layer of a step has the tread's colour
    found = [
        ("landings" if shape.kind in ("landing", "sill") else "treads", _slab(shape, top - layer, top)),
        ("risers", _slab(shape, -top, top - layer)),
    ]
    if solid.nosing is not None:
        found += [("nosings", mesh) for mesh in _nosing(shape, solid.nosing)]
    return found


def _slab(shape: Box, low: float, high: float) -> Mesh:
    """Return the layer of a box between two heights in its own frame."""
    a, b, _ = shape.half_m
    return box((0.0, 0.0, 0.5 * (low + high)), (2.0 * a, 2.0 * b, high - low)).moved(shape.centre_W, shape.R_WK)


def _nosing(shape: Box, nosing: NosingGeometry) -> list[Mesh]:
    """Return the round bar of a nosing and the strip on the tread behind it, 50 mm deep: about 55 mm on real stairs (BS 8300)."""
    a, b, c = shape.half_m
    deep, high = min(0.05, 2.0 * a), 0.0015
    strip = box((-a + 0.5 * deep, 0.0, c + 0.5 * high), (deep, 2.0 * b, high)).moved(shape.centre_W, shape.R_WK)
    return [strip, cylinder(np.array(nosing.right_W), np.array(nosing.left_W), nosing.radius_m, sides=12)]
