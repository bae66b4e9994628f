"""Staircase as parts: treads, risers, landings, floor, walls and nosing strips in the world's frame."""

import numpy as np

from treadline.vehicle.appearance._mesh import Mesh, MeshPart, box, cylinder, part
from treadline.vehicle.stair_solids import Box, NosingGeometry, Solid, stair_solids
from treadline.vehicle.staircase import Staircase

COLOUR_OF = {"treads": "tread", "risers": "riser", "landings": "landing", "nosings": "nosing", "floor": "floor", "walls": "wall"}
"""Colour of each kind of part."""


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
    """Return the round bar of a nosing and the strip on the tread behind it, 50 mm deep: about 55 mm on real stairs (BS 8300)."""
    a, b, c = shape.half_m
    deep, high = min(0.05, 2.0 * a), 0.0015
    strip = box((-a + 0.5 * deep, 0.0, c + 0.5 * high), (deep, 2.0 * b, high)).moved(shape.centre_W, shape.R_WK)
    return [strip, cylinder(np.array(nosing.right_W), np.array(nosing.left_W), nosing.radius_m, sides=12)]
