"""Staircase as parts: treads, risers, landings, floor, walls and nosing strips in the world's frame."""

import numpy as np

from treadline.core.angles import rotation_z
from treadline.vehicle.appearance import palette
from treadline.vehicle.appearance.mesh import Mesh, Point3, box, cylinder
from treadline.vehicle.appearance.palette import Colour
from treadline.vehicle.appearance.parts import MeshPart, part
from treadline.vehicle.bodies import NosingGeometry, Solid, solids
from treadline.vehicle.staircase import Box, Staircase

TREAD_M = 0.02
"""Thickness of the layer of a step drawn in the tread's colour [m] (drawn only)."""
STRIP_M = (0.05, 0.0015)
"""Depth and height of the strip that marks a nosing [m]; contrasting nosings on stairs are about 55 mm deep (BS 8300)."""
WALL_OPACITY = 0.25
"""Opacity of the walls: the chair is visible through them (drawn only)."""


def stair_parts(staircase: Staircase) -> tuple[MeshPart, ...]:
    """Return a staircase, with floor and walls."""
    meshes: dict[str, list[Mesh]] = {}
    for solid in solids(staircase):
        for name, mesh in _meshes(solid):
            meshes.setdefault(name, []).append(mesh)
    return tuple(part(name, "world", found, *LOOKS[name]) for name, found in meshes.items())


LOOKS: dict[str, tuple[Colour, float]] = {
    "floor": (palette.FLOOR, 1.0),
    "treads": (palette.TREAD, 1.0),
    "risers": (palette.RISER, 1.0),
    "landings": (palette.LANDING, 1.0),
    "nosings": (palette.NOSING, 1.0),
    "walls": (palette.WALL, WALL_OPACITY),
}
"""Colour and opacity of each kind of part."""


def obstacle_part(centre_W: Point3, size_m: Point3, yaw_rad: float = 0.0, name: str = "obstacle") -> MeshPart:
    """Return a box that blocks the way, in the world's frame."""
    return part(name, "world", [box((0.0, 0.0, 0.0), size_m).moved(centre_W, rotation_z(yaw_rad))], palette.OBSTACLE)


def _meshes(solid: Solid) -> list[tuple[str, Mesh]]:
    shape = solid.box
    if shape.kind in ("floor", "wall"):
        return [(f"{shape.kind}{'s' if shape.kind == 'wall' else ''}", _slab(shape, -shape.half_m[2], shape.half_m[2]))]
    if shape.kind == "riser":
        return [("risers", _slab(shape, -shape.half_m[2], shape.half_m[2]))]
    top = shape.half_m[2]
    layer = min(TREAD_M, top)
    found = [
        ("landings" if shape.kind == "landing" else "treads", _slab(shape, top - layer, top)),
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
    """Return the round bar of a nosing and the strip on the tread behind it."""
    deep, high = STRIP_M
    a, b, c = shape.half_m
    deep = min(deep, 2.0 * a)
    strip = box((-a + 0.5 * deep, 0.0, c + 0.5 * high), (deep, 2.0 * b, high)).moved(shape.centre_W, shape.R_WK)
    return [strip, cylinder(np.array(nosing.right_W), np.array(nosing.left_W), nosing.radius_m, sides=12)]
