"""Parts of a drawn scene: a mesh with its colour in the frame of a body."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float32, Int32

from treadline.vehicle.appearance.mesh import Mesh, merged
from treadline.vehicle.appearance.palette import Colour

BodyName = Literal["chair", "seat", "flipper", "bar", "slider", "world"]
"""Body of a part: the bodies of ``mechanics.bodies.vehicle``, bar and slider of the seat linkage, or the world."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshPart:
    """Closed triangle mesh of one colour, rigidly attached to a body."""

    name: str
    body: BodyName
    """Body whose frame holds the vertices."""
    vertices_m: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    """Indices of the corners of each triangle, anticlockwise as seen from outside."""
    colour: Colour
    opacity: float = 1.0
    """Opacity from 0 (invisible) to 1."""


def part(name: str, body: BodyName, meshes: Iterable[Mesh], colour: Colour, opacity: float = 1.0) -> MeshPart:
    """Return meshes as one part."""
    whole = merged(meshes)
    vertices, faces = whole.vertices.astype(np.float32), whole.faces.astype(np.int32)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return MeshPart(name=name, body=body, vertices_m=vertices, faces=faces, colour=colour, opacity=opacity)
