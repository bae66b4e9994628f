"""Export of the chair as URDF: links, joints and camera frames, for robot_state_publisher, RViz and other URDF readers.

``ChairDescription, Chair -> URDF, STL files``: one binary STL file per drawn part. The root ``base_link`` is the frame B. A link
without mass is part of its parent. Numbers, elements and rotations are written as in SDF (``sdf``).
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any
from xml.etree.ElementTree import fromstring, indent, tostring

import numpy as np
from jinja2 import Environment, PackageLoader, Template

from treadline.core.angles import DEG
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR
from treadline.core.rotations import Rotation
from treadline.scenario.chair import CameraMount, ChairDescription, Point
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import LINKAGE_BODIES, MeshPart, chair_parts, resting_lugs
from treadline.vehicle.bodies import vehicle


def text(*values: float) -> str:
    """Return numbers separated by blanks, with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def document(template: str, /, **values: Any) -> str:
    """Return a complete file from its template."""
    root = fromstring(_template(template).render(**values))  # noqa: S314 - our own text, and elements of the caller
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


@cache
def _template(name: str) -> Template:
    engine = Environment(loader=PackageLoader("treadline", "vehicle"), autoescape=True)
    return engine.get_template(
        name, globals={"row": lambda *values: text(*np.hstack(values)), "half_pi": 0.5 * math.pi, "radians": DEG}
    )


def roll_pitch_yaw(R: Rotation) -> Point:
    """Return the angles about fixed x, y, z, in that order, of a rotation matrix."""
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    if abs(float(R[2, 0])) > 1.0 - 1e-12:
        return 0.0, pitch, math.atan2(-float(R[0, 1]), float(R[1, 1]))
    return math.atan2(float(R[2, 1]), float(R[2, 2])), pitch, math.atan2(float(R[1, 0]), float(R[0, 0]))


def urdf(chair: ChairDescription, loading: Chair, drawn: Sequence[MeshPart] = (), mesh_url: str = "") -> str:
    """Return a chair with its payload as URDF.

    Args:
        drawn: Parts to draw; without parts the collision shapes are drawn.
        mesh_url: Prefix of the parts' mesh files.
    """
    mounts = {"camera": chair.camera, "rear_camera": chair.rear_camera}
    return document(
        "chair.urdf.j2",
        whole=vehicle(chair, loading),
        drawn=drawn,
        mesh_url=mesh_url,
        rgba=lambda part: text(*(round(share, 4) for share in (*part.colour, part.opacity))),
        cameras=[(name, mount, _angles(mount)) for name, mount in mounts.items() if mount is not None],
        optical_rad=roll_pitch_yaw(CAMERA_AXES_IN_CHAIR),
    )


def _angles(mount: CameraMount) -> list[float]:
    """Return roll, pitch and yaw of a camera [rad]."""
    return [math.radians(angle) for angle in (mount.roll_deg, mount.pitch_deg, mount.yaw_deg)]


def drawn_urdf(chair: ChairDescription, loading: Chair, belts: Belts | None, mesh_url: str) -> tuple[str, dict[str, bytes]]:
    """Return a chair's URDF whose visuals are meshes, and the contents of its mesh files by name.

    Args:
        belts: Lug profile of the scenario; None: a smooth belt.
        mesh_url: Prefix of the file names in the URDF, for example ``chair_meshes/`` or ``package://my_chair/meshes/``.
    """
    shown = drawn_parts(chair, loading, belts)
    return urdf(chair, loading, shown, mesh_url), mesh_files(shown)


def drawn_parts(chair: ChairDescription, loading: Chair, belts: Belts | None) -> tuple[MeshPart, ...]:
    """Return the parts of a chair whose bodies are links, with resting belts."""
    parts = (*chair_parts(chair, loading, belts), *resting_lugs(chair, belts))
    return tuple(part for part in parts if part.body not in LINKAGE_BODIES)


def mesh_files(parts: Sequence[MeshPart]) -> dict[str, bytes]:
    """Return the STL files of parts by name."""
    return {f"{part.name}.stl": _stl(part) for part in parts}


def _stl(part: MeshPart) -> bytes:
    """Return a part as a binary STL file."""
    corners = part.vertices_m[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles["corners"] = corners
    triangles["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    header = f"treadline {part.name}".encode().ljust(80)[:80]
    return header + np.uint32(len(corners)).tobytes() + triangles.tobytes()
