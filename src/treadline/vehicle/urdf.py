"""Export of the chair as URDF: links, joints and camera frames, for robot_state_publisher, RViz and other URDF readers.

``ChairDescription, Chair -> URDF, STL files``: one binary STL file per drawn part. The root ``base_link`` is the frame B. A link
without mass is part of its parent. Numbers, elements and rotations are written as in SDF (``sdf``).
"""

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR
from treadline.scenario.chair import CameraMount, ChairDescription, Point
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import LINKAGE_BODIES, MeshPart, chair_parts, resting_lugs
from treadline.vehicle.bodies import Body, Hinge, Shape, vehicle


def text(*values: float) -> str:
    """Return numbers separated by blanks, with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def child(parent: Element, tag: str, content: str | None = None, **attributes: str) -> Element:
    """Append an element and return it."""
    element = SubElement(parent, tag, attributes)
    element.text = content
    return element


def document(root: Element) -> str:
    """Return a complete file."""
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def roll_pitch_yaw(R: Float[np.ndarray, "3 3"]) -> Point:
    """Return the angles about fixed x, y, z, in that order, of a rotation matrix."""
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    if abs(float(R[2, 0])) > 1.0 - 1e-12:
        return 0.0, pitch, math.atan2(-float(R[0, 1]), float(R[1, 1]))
    return math.atan2(float(R[2, 1]), float(R[2, 2])), pitch, math.atan2(float(R[1, 0]), float(R[0, 0]))


COLOURS = {"left": "0.15 0.15 0.15 1", "right": "0.15 0.15 0.15 1", None: "0.4 0.5 0.6 0.4"}


def urdf(chair: ChairDescription, loading: Chair, drawn: Sequence[MeshPart] = (), mesh_url: str = "") -> str:
    """Return a chair with its payload as URDF.

    Args:
        drawn: Parts to draw; without parts the collision shapes are drawn.
        mesh_url: Prefix of the parts' mesh files.
    """
    whole = vehicle(chair, loading)
    robot = Element("robot", name=whole.name)
    child(robot, "link", name="base_link")  # a root with inertia is refused by KDL
    _link(robot, whole.chassis, drawn, mesh_url)
    _joint(robot, "base_link", whole.chassis.name)
    for body in whole.bodies[1:]:
        _link(robot, body, drawn, mesh_url)
        if body.hinge is None:
            _joint(robot, whole.chassis.name, body.name, xyz=text(*body.origin_m))
        else:
            _turning(robot, body, body.hinge)
    for body in whole.bodies:
        for shape in body.shapes:
            if shape.kind == "cylinder":
                _pulley(robot, body, shape, hidden=bool(drawn))
    _camera(robot, whole.chassis.name, "camera", chair.camera)
    if chair.rear_camera is not None:
        _camera(robot, whole.chassis.name, "rear_camera", chair.rear_camera)
    return document(robot)


def drawn_urdf(chair: ChairDescription, loading: Chair, belts: Belts | None, mesh_url: str) -> tuple[str, dict[str, bytes]]:
    """Return a chair's URDF whose visuals are meshes, and the contents of its mesh files by name.

    Args:
        belts: Lug profile of the scenario; None: a smooth belt.
        mesh_url: Prefix of the file names in the URDF, for example ``chair_meshes/`` or ``package://my_chair/meshes/``.
    """
    parts = (*chair_parts(chair, loading, belts), *resting_lugs(chair, belts))
    shown = [part for part in parts if part.body not in LINKAGE_BODIES]
    return urdf(chair, loading, shown, mesh_url), {f"{part.name}.stl": _stl(part) for part in shown}


def _stl(part: MeshPart) -> bytes:
    """Return a part as a binary STL file."""
    corners = part.vertices_m[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles["corners"] = corners
    triangles["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    header = f"treadline {part.name}".encode().ljust(80)[:80]
    return header + np.uint32(len(corners)).tobytes() + triangles.tobytes()


def _link(robot: Element, body: Body, drawn: Sequence[MeshPart], mesh_url: str) -> None:
    """Write a body with its boxes and meshes; its pulleys are separate links."""
    link = child(robot, "link", name=body.name)
    inertial = child(link, "inertial")
    child(inertial, "origin", xyz=text(*body.com_m), rpy="0 0 0")
    child(inertial, "mass", value=text(body.mass_kg))
    ixx, iyy, izz = body.inertia
    child(inertial, "inertia", ixx=text(ixx), iyy=text(iyy), izz=text(izz), ixy="0", ixz="0", iyz="0")
    for shape in body.shapes:
        if shape.kind == "box":
            _shape(link, shape, hidden=bool(drawn))
    for part in drawn:
        if part.body == body.name:
            element = child(link, "visual", name=part.name)
            child(child(element, "geometry"), "mesh", filename=f"{mesh_url}{part.name}.stl")
            rgba = text(*(round(share, 4) for share in (*part.colour, part.opacity)))
            child(child(element, "material", name=part.name), "color", rgba=rgba)


def _shape(link: Element, shape: Shape, *, hidden: bool) -> None:
    for tag in ("collision",) if hidden else ("visual", "collision"):
        element = child(link, tag, name=shape.name)
        is_box = shape.kind == "box"
        # URDF's cylinder stands along z: a quarter turn about x lays it along y.
        turn = text(0.0, -shape.nose_up_rad, 0.0) if is_box else text(0.5 * math.pi, 0.0, 0.0)
        child(element, "origin", xyz=text(*shape.centre_m) if is_box else "0 0 0", rpy=turn)
        geometry = child(element, "geometry")
        if is_box:
            child(geometry, "box", size=text(*(2.0 * half for half in shape.half_m)))
        else:
            child(geometry, "cylinder", radius=text(shape.half_m[0]), length=text(2.0 * shape.half_m[1]))
        if tag == "visual":
            material = child(element, "material", name="drawn" if shape.belt is None else "belt")
            child(material, "color", rgba=COLOURS[shape.belt])


def _joint(robot: Element, parent: str, name: str, *, kind: str = "fixed", xyz: str = "0 0 0", rpy: str = "0 0 0") -> Element:
    joint = child(robot, "joint", name=f"{name}_joint", type=kind)
    child(joint, "parent", link=parent)
    child(joint, "child", link=name)
    child(joint, "origin", xyz=xyz, rpy=rpy)
    return joint


def _turning(robot: Element, body: Body, hinge: Hinge) -> None:
    joint = _joint(robot, body.parent or "base_link", body.name, kind="revolute", xyz=text(*body.origin_m))
    child(joint, "axis", xyz=text(*hinge.axis))
    low, high = hinge.range_rad
    effort = 1000.0 if hinge.torque_n_m is None else hinge.torque_n_m  # URDF requires a number
    child(joint, "limit", lower=text(low), upper=text(high), effort=text(effort), velocity=text(hinge.max_rate_rad_s))


def _pulley(robot: Element, body: Body, shape: Shape, *, hidden: bool) -> None:
    """Write a pulley as a massless link fixed to chassis or flipper; its mass is part of the body's."""
    name = f"{shape.name}_pulley"
    _shape(child(robot, "link", name=name), shape, hidden=hidden)
    _joint(robot, body.name, name, xyz=text(*shape.centre_m))


def _camera(robot: Element, parent: str, name: str, mount: CameraMount) -> None:
    """Write a camera's frames in ROS convention: ``_link`` looks along x, ``_optical_frame`` along z."""
    angles = (math.radians(angle) for angle in (mount.roll_deg, mount.pitch_deg, mount.yaw_deg))
    child(robot, "link", name=f"{name}_link")
    _joint(robot, parent, f"{name}_link", xyz=text(*mount.position_m), rpy=text(*angles))
    child(robot, "link", name=f"{name}_optical_frame")
    _joint(robot, f"{name}_link", f"{name}_optical_frame", rpy=text(*roll_pitch_yaw(CAMERA_AXES_IN_CHAIR)))
