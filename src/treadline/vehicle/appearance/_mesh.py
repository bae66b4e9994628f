"""Triangle meshes of simple solids, all closed with outward faces, and the coloured parts of a drawn scene made of them."""

import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from treadline.core.files import DATA
from treadline.core.rotations import Rotation, Vector3

Outline = Float[np.ndarray, "n 2"]
"""Closed polygon (x, z), anticlockwise with x to the right and z up."""
Point3 = Sequence[float] | Vector3
Colour = tuple[float, float, float]
"""Red, green and blue, each 0 to 1."""
BodyName = str
"""Body of a part: the bodies of ``vehicle.bodies.vehicle``, bar and slider of the seat linkage, or the world."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Closed triangle mesh; the corners of each face run anticlockwise as seen from outside."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]

    def moved(self, p: Point3, R: Rotation | None = None) -> "Mesh":
        """Return the mesh rotated by R and then shifted by p."""
        turned = self.vertices if R is None else self.vertices @ R.T
        return Mesh(vertices=turned + np.asarray(p, dtype=float), faces=self.faces)


def merged(meshes: Iterable[Mesh]) -> Mesh:
    """Return several meshes as one; their vertices stay separate."""
    every = list(meshes)
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in every[:-1])])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in every]),
        faces=np.concatenate([mesh.faces + int(start) for mesh, start in zip(every, starts, strict=True)]),
    )


def box(centre: Point3, size: Point3) -> Mesh:
    """Return a box along the axes."""
    a, b, c = (0.5 * float(edge) for edge in size)
    outline = np.array([(-a, -c), (a, -c), (a, c), (-a, c)])
    return extrusion(outline, -b, b).moved(centre)


def rounded_box(centre: Point3, size: Point3, radius_m: float, *, along: int = 1) -> Mesh:
    """Return a box whose four edges parallel to one axis are rounded.

    Args:
        along: Axis of the rounded edges: 0, 1 or 2 for x, y or z.
    """
    edges = [float(edge) for edge in size]
    # A cyclic permutation of the axes keeps the orientation.
    first, last = (along + 2) % 3, (along + 1) % 3
    a, b, c = 0.5 * edges[first], 0.5 * edges[along], 0.5 * edges[last]
    r = min(radius_m, 0.98 * a, 0.98 * c)
    outline = np.array(
        [
            (sx * (a - r) + r * math.cos(angle), sz * (c - r) + r * math.sin(angle))
            for quarter, (sx, sz) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)))
            for angle in (0.5 * math.pi * (quarter + k / 3) for k in range(4))
        ]
    )
    mesh = extrusion(outline, -b, b)
    columns = [0, 0, 0]
    columns[first], columns[along], columns[last] = 0, 1, 2
    return Mesh(vertices=mesh.vertices[:, columns], faces=mesh.faces).moved(centre)


def extrusion(outline: Outline, low: float, high: float) -> Mesh:
    """Return the solid of a convex outline (x, z) between two values of y."""
    n = len(outline)
    fan = [(0, i, i + 1) for i in range(1, n - 1)]
    faces = [*fan, *((n + c, n + b, n + a) for a, b, c in fan)]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, n + i, j), (j, n + i, n + j)]
    return Mesh(vertices=_between(outline, low, high), faces=np.array(faces))


def band(outer: Outline, inner: Outline, low: float, high: float, *, closed: bool) -> Mesh:
    """Return the solid between two lines (x, z) with as many points, between two values of y.

    Args:
        outer: Outer line, anticlockwise.
        inner: Inner line, to the left of the outer line.
        closed: Whether the lines return to their first point; otherwise both ends are capped.
    """
    n = len(outer)
    o0, i0, o1, i1 = 0, n, 2 * n, 3 * n  # outer and inner line at the low side, then at the high side
    faces: list[tuple[int, int, int]] = []
    for a in range(n if closed else n - 1):
        b = (a + 1) % n
        faces += _quad(o0 + a, o1 + a, o1 + b, o0 + b)
        faces += _quad(i0 + a, i0 + b, i1 + b, i1 + a)
        faces += _quad(o0 + a, o0 + b, i0 + b, i0 + a)
        faces += _quad(o1 + a, i1 + a, i1 + b, o1 + b)
    if not closed:
        last = n - 1
        faces += _quad(o0, i0, i1, o1)
        faces += _quad(o0 + last, o1 + last, i1 + last, i0 + last)
    lines = np.concatenate([outer, inner])
    return Mesh(vertices=_between(lines, low, high), faces=np.array(faces))


def lathe(start: Point3, end: Point3, stations: Sequence[tuple[float, float]], sides: int = 12) -> Mesh:
    """Return the solid whose sections across an axis are circles.

    Args:
        start: Origin of the axis.
        end: Point that gives the direction of the axis.
        stations: Distance along the axis and radius of each section.
    """
    axis = np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
    axis /= np.linalg.norm(axis)
    lateral = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = lateral - (lateral @ axis) * axis
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angles = 2.0 * math.pi * np.arange(sides) / sides
    rings = [along * axis + r * np.outer(np.cos(angles), u) + r * np.outer(np.sin(angles), v) for along, r in stations]
    ends = np.array([stations[0][0] * axis, stations[-1][0] * axis])
    first, last = len(stations) * sides, (len(stations) - 1) * sides
    faces: list[tuple[int, int, int]] = []
    for i in range(sides):
        j = (i + 1) % sides
        for ring in range(0, last, sides):
            faces += _quad(ring + i, ring + j, ring + sides + j, ring + sides + i)
        faces += [(first, j, i), (first + 1, last + i, last + j)]
    return Mesh(vertices=np.concatenate([*rings, ends]) + np.asarray(start, dtype=float), faces=np.array(faces))


def cylinder(start: Point3, end: Point3, radius_m: float, sides: int = 12) -> Mesh:
    """Return a cylinder between two points."""
    length = float(np.linalg.norm(np.asarray(end, dtype=float) - np.asarray(start, dtype=float)))
    return lathe(start, end, [(0.0, radius_m), (length, radius_m)], sides)


def capsule(start: Point3, end: Point3, radius_m: float, end_radius_m: float | None = None, sides: int = 10) -> Mesh:
    """Return a rod with hemispherical ends around two points, tapered if the radii differ."""
    r, s = radius_m, radius_m if end_radius_m is None else end_radius_m
    length = float(np.linalg.norm(np.asarray(end, dtype=float) - np.asarray(start, dtype=float)))
    quarter = [0.5 * math.pi * k / 3 for k in range(3)]
    head = [(-r * math.cos(angle + 0.2), r * math.sin(angle + 0.2)) for angle in quarter]
    tail = [(length + s * math.cos(angle + 0.2), s * math.sin(angle + 0.2)) for angle in reversed(quarter)]
    return lathe(start, end, [*head, (0.0, r), (length, s), *tail], sides)


def tube(points: Sequence[Point3], radius_m: float) -> Mesh:
    """Return a round tube along a line of points."""
    return merged(capsule(a, b, radius_m, sides=8) for a, b in pairwise(points))


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


@cache
def colour(name: str) -> Colour:
    """Return a colour of ``data/palette.toml``."""
    palette = tomllib.loads((DATA / "palette.toml").read_text(encoding="utf-8"))
    code = int(palette[name][1:], 16)
    return (code >> 16) / 255.0, (code >> 8 & 0xFF) / 255.0, (code & 0xFF) / 255.0


def part(name: str, body: BodyName, meshes: Iterable[Mesh], painted: str, opacity: float = 1.0) -> MeshPart:
    """Return meshes as one part, painted with a colour of the palette."""
    whole = merged(meshes)
    vertices, faces = whole.vertices.astype(np.float32), whole.faces.astype(np.int32)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return MeshPart(name=name, body=body, vertices_m=vertices, faces=faces, colour=colour(painted), opacity=opacity)


def _between(line: Outline, low: float, high: float) -> Float[np.ndarray, "m 3"]:
    """Return the points of a line (x, z) at two values of y."""
    sides = [np.column_stack([line[:, 0], np.full(len(line), y), line[:, 1]]) for y in (low, high)]
    return np.concatenate(sides)


def _quad(a: int, b: int, c: int, d: int) -> list[tuple[int, int, int]]:
    """Return the two triangles of a quadrilateral."""
    return [(a, b, c), (a, c, d)]
