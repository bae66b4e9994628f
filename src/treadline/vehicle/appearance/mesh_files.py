"""Mesh files of a chair for its URDF: ``chair, loading -> URDF, STL files``; one binary STL file per part."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance.belts import resting_lugs
from treadline.vehicle.appearance.chair_parts import chair_parts
from treadline.vehicle.appearance.parts import MeshPart
from treadline.vehicle.formats import urdf
from treadline.vehicle.formats.urdf import MeshVisual

LINKAGE_BODIES = ("bar", "slider")
"""Bodies without a link in the URDF: their motion follows from the seat's, and a URDF has no joint for such a mechanism."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnUrdf:
    """URDF of a chair with the mesh files that it refers to."""

    text: str
    files: Mapping[str, bytes]
    """Contents of the mesh files by name."""


def drawn_urdf(chair: ChairDescription, loading: Chair, belts: Belts | None, mesh_url: str) -> DrawnUrdf:
    """Return a chair's URDF whose visuals are meshes.

    Args:
        belts: Lug profile of the scenario; None: a smooth belt.
        mesh_url: Prefix of the file names in the URDF, for example ``chair_meshes/`` or ``package://my_chair/meshes/``.
    """
    parts = (*chair_parts(chair, loading, belts), *resting_lugs(chair, belts))
    shown = [part for part in parts if part.body not in LINKAGE_BODIES]
    visuals = [
        MeshVisual(name=part.name, link=part.body, url=f"{mesh_url}{part.name}.stl", rgba=(*part.colour, part.opacity))
        for part in shown
    ]
    return DrawnUrdf(text=urdf(chair, loading, visuals), files={f"{part.name}.stl": stl(part) for part in shown})


def stl(part: MeshPart) -> bytes:
    """Return a part as a binary STL file."""
    corners = part.vertices_m[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), _TRIANGLE)
    triangles["corners"] = corners
    triangles["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    header = f"treadline {part.name}".encode().ljust(80)[:80]
    return header + np.uint32(len(corners)).tobytes() + triangles.tobytes()
