"""Silhouettes of mesh parts for line drawings and side views: ``MeshPart -> closed lines in the plane of the drawing``.

Drawings use the meshes of ``vehicle.appearance``, as the viewer and the URDF do. The silhouette of a solid is the boundary of the
faces that point towards the viewer: one closed line for a convex solid, one for each border of a ring.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from treadline.vehicle.appearance import BodyName, Colour, MeshPart

Loop = Float[np.ndarray, "_ 2"]
"""Closed line: right and up in the plane of the drawing [m]."""

SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""View of the chair's right side: rows are the directions right, up and towards the viewer in B."""
EDGE_ON = 1e-3
"""Cosine of the angle between normal and view below which a face is seen edge-on: coordinates have single precision."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Silhouette:
    """Silhouette of one connected solid of a part."""

    part: str
    body: BodyName
    colour: Colour
    depth_m: float
    """Mean distance of the solid's vertices from the origin towards the viewer [m]."""
    loops: tuple[Loop, ...]

    @property
    def area_m2(self) -> float:
        """Area within the longest line [m²]."""
        return max(_area(loop) for loop in self.loops)


def silhouettes(
    parts: Sequence[MeshPart],
    view: Float[np.ndarray, "3 3"] = SIDE,
    poses: Mapping[BodyName, Float[np.ndarray, "4 4"]] | None = None,
) -> list[Silhouette]:
    """Return the silhouettes of all solids, the farthest first.

    Args:
        view: Directions right, up and towards the viewer, as rows.
        poses: Pose of each body; None: each part in the frame of its body.
    """
    found: list[Silhouette] = []
    for part in parts:
        vertices = part.vertices_m.astype(float)
        if poses is not None:
            X = poses[part.body]
            vertices = vertices @ X[:3, :3].T + X[:3, 3]
        seen = vertices @ view.T
        for faces in _solids(len(seen), part.faces):
            loops = tuple(_boundary(seen, faces))
            if loops:
                depth_m = float(seen[np.unique(faces), 2].mean())
                found.append(Silhouette(part=part.name, body=part.body, colour=part.colour, depth_m=depth_m, loops=loops))
    return sorted(found, key=lambda silhouette: silhouette.depth_m)


def _solids(count: int, faces: Int[np.ndarray, "f 3"]) -> Iterator[Int[np.ndarray, "_ 3"]]:
    """Yield the faces of each connected solid of a mesh with ``count`` vertices."""
    label = np.arange(count)
    while True:
        lowest = label[faces].min(axis=1)
        before = label.copy()
        for corner in range(3):
            np.minimum.at(label, faces[:, corner], lowest)
        if np.array_equal(before, label):
            break
    of_face = label[faces[:, 0]]
    for name in np.unique(of_face):
        yield faces[of_face == name]


def _boundary(seen: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Iterator[Loop]:
    """Yield the closed lines around the faces that point towards the viewer."""
    a, b, c = (seen[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    front = faces[normals[:, 2] > EDGE_ON * np.linalg.norm(normals, axis=1)]
    edges = {(int(face[k]), int(face[(k + 1) % 3])) for face in front for k in range(3)}
    after: dict[int, list[int]] = {}
    for start, end in sorted(edges):
        if (end, start) not in edges:
            after.setdefault(start, []).append(end)
    while after:
        first = next(iter(after))
        line, at = [first], _next(after, first)
        while at != first:
            line.append(at)
            at = _next(after, at)
        yield seen[line, :2]


def _next(after: dict[int, list[int]], at: int) -> int:
    """Return and remove one successor of a vertex."""
    ends = after[at]
    end = ends.pop()
    if not ends:
        del after[at]
    return end


def _area(loop: Loop) -> float:
    x, y = loop.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
