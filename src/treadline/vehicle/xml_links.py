"""Links of a robot description in URDF or SDF.

``file -> name, links``. Elements that only simulators read are passed over, and so are meshes: a belt whose radius a mesh hides is
asked for. Inertias are copied, so that no compiler's default (a root welded to the world, masses guessed from shapes) changes them.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.files import text_of
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z
from treadline.vehicle.description_links import CollisionSolid, DescribedJoint, DescribedLink, check_tree, numbers_of

Placed = tuple[Vector3, Rotation]
"""Origin [m] and axes of a frame in the frame of the description."""
ORIGIN: Placed = np.zeros(3), np.eye(3)
"""Frame of the description."""
KINDS: dict[str, Literal["fixed", "hinge", "other"]] = {
    "fixed": "fixed",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "other",
    "floating": "other",
    "planar": "other",
    "ball": "other",
    "universal": "other",
}
"""Kinds of joints by the words of URDF and SDF."""
ENDLESS_RAD = 1e3
"""Angle from which on a limit stands for none [rad]: SDF writes 1e16."""


def description_root(path: Path) -> Element:
    """Return the root element of a robot description.

    Raises:
        SettingsError: If the file cannot be read, is no XML, or needs xacro.
    """
    text = text_of(path, "a robot description")
    if path.suffix == ".xacro" or re.search(r"<xacro:|xmlns:xacro", text):
        raise SettingsError(f"{path}: is xacro; run xacro first: xacro {path.name} > {path.name.split('.')[0]}.urdf")
    try:
        return fromstring(text)  # noqa: S314 - expat bounds the expansion of entities, and none is fetched
    except ParseError as error:
        raise SettingsError(f"{path}: not XML: {error}; give a robot description: URDF, SDF or MJCF") from None


def xml_links(path: Path, root: Element) -> tuple[str, list[DescribedLink]]:
    """Return name and links of a robot in URDF or SDF.

    Raises:
        SettingsError: If the file has no robot, or one with unknown parts.
    """
    model = _model(path, root) if root.tag == "sdf" else root
    links = {str(link.get("name")): link for link in model.findall("link")}
    if not links:
        raise SettingsError(f"{path}: has no link; give a robot description: URDF, SDF or MJCF")
    joints = {str(joint.get("name")): joint for joint in model.findall("joint") if joint.find("child") is not None}
    ends = [(name, _end(joint, "parent"), _end(joint, "child")) for name, joint in joints.items()]
    ends = [end for end in ends if end[1] != "world" or "world" in links]
    check_tree(str(path), ends, list(links))
    held = {child: (joints[name], parent) for name, parent, child in ends}

    def place(name: str) -> Placed:
        if root.tag == "sdf":
            return _pose(path, links[name])
        return _on(place(held[name][1]), _pose(path, held[name][0])) if name in held else ORIGIN

    return str(model.get("name")), [_link(path, element, held.get(name), place(name)) for name, element in links.items()]


def _model(path: Path, root: Element) -> Element:
    """Return the robot's model in an SDF file: the first that is not static."""
    models = [
        model for model in (*root.findall("model"), *root.findall("world/model")) if model.findtext("static") not in ("1", "true")
    ]
    if not models:
        raise SettingsError(f"{path}: has no model that moves; give the file of the robot")
    model = models[0]
    inner = next((element for tag in ("include", "model", "frame") for element in model.findall(tag)), None)
    if inner is not None:
        called = inner.get("name") or inner.findtext("uri")
        raise SettingsError(f"{path}: {inner.tag} '{called}' is not resolved; flatten it first: gz sdf -p {path.name} > flat.sdf")
    based = next((pose.get("relative_to") for pose in model.iter("pose") if pose.get("relative_to")), None)
    if based is not None:
        raise SettingsError(f"{path}: a pose is relative to '{based}'; flatten it first: gz sdf -p {path.name} > flat.sdf")
    return model


def _end(joint: Element, tag: str) -> str:
    """Return the link at an end of a joint."""
    element = joint.find(tag)
    return "" if element is None else (element.get("link") or element.text or "").strip()


def _text(element: Element | None, key: str) -> str | None:
    """Return a value at a path below an element: an attribute as in URDF, or the text of an element as in SDF."""
    if element is None:
        return None
    if (found := element.find(key)) is not None:
        return found.get("value") or found.text
    holder, _, name = key.rpartition("/")
    inner = element.find(holder) if holder else element
    return None if inner is None else inner.get(name)


def _number(element: Element | None, key: str, where: str) -> float | None:
    """Return a number at a path below an element, or None."""
    text = _text(element, key)
    return None if text is None else float(numbers_of(text, "0", f"{where}: {key}")[0])


def _pose(path: Path, element: Element | None) -> Placed:
    """Return the pose that an element has in URDF or in SDF."""
    if element is None:
        return ORIGIN
    where = f"{path}: {element.tag} '{element.get('name') or ''}'"
    if (origin := element.find("origin")) is not None:
        p, angles = (numbers_of(origin.get(key), "0 0 0", where) for key in ("xyz", "rpy"))
    else:
        p, angles = np.split(numbers_of(element.findtext("pose"), "0 0 0 0 0 0", where), 2)
    roll, pitch, yaw = angles.tolist()
    return p, rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def _on(frame: Placed, pose: Placed) -> Placed:
    """Return a pose in a frame as one in the frame of the description."""
    return frame[0] + frame[1] @ pose[0], frame[1] @ pose[1]


def _link(path: Path, element: Element, held: tuple[Element, str] | None, frame: Placed) -> DescribedLink:
    """Return a link that stands in a frame."""
    where, inertial = f"{path}: link '{element.get('name')}'", element.find("inertial")
    com_m, R = _on(frame, _pose(path, inertial))
    moments = (_number(inertial, f"inertia/{key}", where) or 0.0 for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    xx, yy, zz, xy, xz, yz = moments
    joint, axes = (None, frame) if held is None else (held[0], _on(frame, _pose(path, None if _is_urdf(held[0]) else held[0])))
    return DescribedLink(
        name=str(element.get("name")),
        parent=None if held is None else held[1],
        joint=None if joint is None else _joint(path, joint, axes[1]),
        origin_m=axes[0],
        mass_kg=_number(inertial, "mass", where) or 0.0,
        com_m=com_m,
        inertia=R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T,
        solids=tuple(solid for shape in element.findall("collision") for solid in _solid(path, shape, frame)),
    )


def _is_urdf(joint: Element) -> bool:
    """Whether the pose of a joint is that of its child in the parent, and not its own in the child."""
    return joint.find("parent[@link]") is not None


def _joint(path: Path, joint: Element, R: Rotation) -> DescribedJoint:
    """Return a joint whose axis is given in axes."""
    where, kind = f"{path}: joint '{joint.get('name')}'", str(joint.get("type"))
    if kind not in KINDS:
        raise SettingsError(f"{where} is of type '{kind}', which is unknown; known: {', '.join(KINDS)}")
    limit = joint.find("limit") if _is_urdf(joint) else joint.find("axis/limit")
    low, high, effort, rate = (_number(limit, key, where) for key in ("lower", "upper", "effort", "velocity"))
    endless = kind == "continuous" or low is None or high is None or max(-low, high) > ENDLESS_RAD
    in_model = joint.findtext("axis/use_parent_model_frame") in ("1", "true")
    axis = numbers_of(_text(joint, "axis/xyz"), "1 0 0", where)
    return DescribedJoint(
        name=str(joint.get("name")),
        kind=KINDS[kind],
        axis=axis if in_model else R @ axis,
        range_rad=None if endless or low is None or high is None else (low, high),
        torque_n_m=effort if effort and effort > 0.0 else None,
        rate_rad_s=rate if rate and rate > 0.0 else None,
    )


def _solid(path: Path, shape: Element, frame: Placed) -> Iterator[CollisionSolid]:
    """Yield the solid of a collision shape; a mesh or a plane has none."""
    name, where = shape.get("name") or "", f"{path}: collision '{shape.get('name') or ''}'"
    centre_m, R = _on(frame, _pose(path, shape))
    if (box := shape.find("geometry/box")) is not None:
        half_m = 0.5 * numbers_of(_text(box, "size"), "0 0 0", where)
        yield CollisionSolid(name=name, is_round=False, centre_m=centre_m, R=R, half_m=half_m)
    for kind in ("cylinder", "capsule"):
        if (found := shape.find(f"geometry/{kind}")) is not None:
            radius_m, length_m = (_number(found, key, where) or 0.0 for key in ("radius", "length"))
            yield CollisionSolid(
                name=name, is_round=True, centre_m=centre_m, R=R, half_m=np.array([radius_m, radius_m, 0.5 * length_m])
            )
