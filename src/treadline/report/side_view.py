"""Side views of a recorded run as SVG: the chair's parts as filled outlines on the stair, at chosen times.

A part is drawn as the silhouettes of its solids, projected onto the vertical plane along the flight under the chair. The
silhouettes of each body are defined once per page; a view places them with the body's pose.

Silhouettes of mesh parts: ``MeshPart -> closed lines in the plane of the drawing``. Drawings use the meshes of
``vehicle.appearance``, as the viewer and the URDF do. The silhouette of a solid is the boundary of the faces that point towards
the viewer: one closed line for a convex solid, one for each border of a ring.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float, Int

from treadline.core.rotations import Rotation, Vector3, rotation_of
from treadline.playback import Recording
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import BodyName, Colour, MeshPart, body_poses, chair_parts, colour, lug_part, lug_poses
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase

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


def silhouettes(
    parts: Sequence[MeshPart], view: Rotation = SIDE, poses: Mapping[BodyName, Float[np.ndarray, "4 4"]] | None = None
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
    from scipy.sparse import coo_array  # a fifth of a second to import
    from scipy.sparse.csgraph import connected_components

    starts, ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2).T
    _, label = connected_components(coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count)), directed=False)
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


def area_m2(loop: Loop) -> float:
    """Return the area within a closed line [m²]."""
    x, y = loop.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


VIEW_M = (2.6, 1.95)
"""Width and height of a view [m]: the chair with its passenger, and four steps."""
LEAST_M2 = 2e-4
"""Smallest projected area of a solid that is drawn: 1.4 cm square, half a pixel of a view 200 px wide."""
MIDDLE_M = 0.17
"""Lateral distance from the middle within which solids count as neither near nor far [m]."""


class SideViews:
    """Side views of one recording; ``definitions`` must be on the page before the first view.

    Args:
        recording: Recording with poses.
        prefix: Prefix of the ids, unique on the page.
    """

    def __init__(self, recording: Recording, prefix: str = "chair") -> None:
        self._recording, self._prefix = recording, prefix
        scenario = recording.scenario
        self._loading: Chair = Chair() if scenario is None else scenario.chair
        self._belts: Belts | None = None if scenario is None else scenario.belts
        self._staircase = recording.staircase
        self._groups = _groups(chair_parts(recording.chair, self._loading, self._belts))

    @property
    def definitions(self) -> str:
        """SVG that defines the outlines of all bodies, not shown by itself."""
        groups = ""
        for (depth, body), shapes in self._groups.items():
            drawn = "".join(_path(shape.loops, shape.colour) for shape in shapes)
            groups += f'<g id="{self._prefix}-{depth}-{body}">{drawn}</g>'
        hidden = 'width="0" height="0" style="position:absolute" aria-hidden="true"'
        return f'<svg class="side-shapes" {hidden}><defs>{groups}</defs></svg>'

    def view(self, t_s: float, words: str) -> str:
        """Return the view at a time.

        Args:
            words: Text alternative.
        """
        k = self._recording.index_at(t_s)
        R_WB, p_WB = rotation_of(self._recording.quat_WB[k]), self._recording.p_WB[k]
        stair = self._staircase
        R_WF = R_WB if stair is None else stair.flight_frame(stair.flight_at(p_WB, R_WB))[0]
        along_rad = math.atan2(R_WF[1, 0], R_WF[0, 0])
        across = np.array([[math.cos(along_rad), math.sin(along_rad), 0.0], [0.0, 0.0, 1.0]])
        (width, height), centre = VIEW_M, across @ p_WB + np.array([0.15, 0.62])
        left, top = centre[0] - 0.5 * width, centre[1] + 0.5 * height
        poses = body_poses(
            self._recording.chair, self._loading, float(self._recording.seat_rad[k]), float(self._recording.flipper_rad[k])
        )
        drawn = [_stair(stair, across, p_WB, (left, left + width))] if stair is not None else []
        for depth in ("far", "middle", "near"):
            if depth == "near":
                drawn.append(self._lugs(k, across, R_WB, p_WB))
            for body in (body for at, body in self._groups if at == depth):
                X, name = poses[body], f"{self._prefix}-{depth}-{body}"
                drawn.append(_use(name, across @ R_WB @ X[:3, :3], across @ (R_WB @ X[:3, 3] + p_WB)))
        return (
            f'<svg class="side" viewBox="{left:.3f} {-top:.3f} {width} {height}" role="img" aria-label="{escape(words)}">'
            f'<g transform="scale(1 -1)">{"".join(drawn)}</g></svg>'
        )

    def _lugs(self, k: int, across: Float[np.ndarray, "2 3"], R_WB: Rotation, p_WB: Vector3) -> str:
        """Return the lugs of the near belt as one path."""
        recording = self._recording
        travel_m = float(recording.belt_travel_m[k, 1])
        poses = lug_poses(recording.chair, "right", travel_m, float(recording.flipper_rad[k]), self._belts)
        poses[:, 1, 3] = 0.0  # bodies are drawn in the chair's middle plane, also when the chair is turned
        (lug,) = silhouettes([lug_part(recording.chair, self._belts)])
        (outline,) = lug.loops
        corners = np.column_stack([outline[:, 0], np.zeros(len(outline)), outline[:, 1], np.ones(len(outline))])
        places = np.einsum("nij,cj->nci", poses[:, :3], corners) @ R_WB.T + p_WB
        return _path([place @ across.T for place in places], colour("belt"))


def _stair(staircase: Staircase, across: Float[np.ndarray, "2 3"], p_WB: Vector3, reach: tuple[float, float]) -> str:
    """Return the boxes of the stair next to the chair, without walls."""
    sideways = np.array([-across[0, 1], across[0, 0], 0.0])
    drawn = []
    for box in stair_boxes(staircase):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * box.half_m
        places = corners @ box.R_WK.T + box.centre_W
        lateral = (places - p_WB) @ sideways
        outline = _hull((places @ across.T).round(6))
        if box.kind == "wall" or lateral.min() > 0.3 or lateral.max() < -0.3:
            continue
        if outline[:, 0].max() < reach[0] or outline[:, 0].min() > reach[1]:
            continue
        # Far ends of a floor or a landing are beyond the view; a clipped outline keeps the numbers short.
        outline[:, 0] = np.clip(outline[:, 0], reach[0] - 0.1, reach[1] + 0.1)
        corners_text = " ".join(f"{x:.3f},{y:.3f}" for x, y in outline)
        drawn.append(f'<polygon points="{corners_text}"/>')
    return f'<g class="stone">{"".join(drawn)}</g>'


def _groups(parts: Sequence[MeshPart]) -> dict[tuple[str, BodyName], list[Silhouette]]:
    """Return the silhouettes by depth (far is the left side, middle, near) and body, the farthest first in each list."""
    found: dict[tuple[str, BodyName], list[Silhouette]] = {}
    for shape in silhouettes(parts):
        depth = "near" if shape.depth_m > MIDDLE_M else "far" if shape.depth_m < -MIDDLE_M else "middle"
        if max(map(area_m2, shape.loops)) >= LEAST_M2:
            found.setdefault((depth, shape.body), []).append(shape)
    return found


def _hull(points: Float[np.ndarray, "n 2"]) -> Loop:
    """Return the convex outline of points, anticlockwise from the one farthest to the left."""
    from scipy.spatial import ConvexHull  # a quarter of a second to import

    around = points[ConvexHull(points).vertices]
    return np.roll(around, -np.lexsort(around.T[::-1])[0], axis=0)


def _use(name: str, turn: Float[np.ndarray, "2 3"], place: Float[np.ndarray, " 2"]) -> str:
    """Return a placed body: the outlines lie in the plane of the body's x and z axes."""
    a, c = turn[0, 0], turn[0, 2]
    b, d = turn[1, 0], turn[1, 2]
    return f'<use href="#{name}" transform="matrix({a:.4f} {b:.4f} {c:.4f} {d:.4f} {place[0]:.4f} {place[1]:.4f})"/>'


def _path(loops: Sequence[Loop], fill: Colour) -> str:
    """Return closed lines as one path; a line within another cuts a hole."""
    lines = "".join("M" + "L".join(f"{x:.3f} {z:.3f}" for x, z in loop) + "Z" for loop in loops)
    painted = "".join(f"{round(255 * value):02x}" for value in fill)
    return f'<path d="{lines}" fill="#{painted}" fill-rule="evenodd"/>'
