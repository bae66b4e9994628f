"""Export of a chair, and of the stair around it, as SDF 1.6 for Gazebo 11.

Each belt is a separate link, as required by Gazebo's tracked-vehicle plugins (Pecka et al., IROS 2017): ``left_track`` and
``right_track`` on the chassis, ``left_flipper`` and ``right_flipper`` on the flipper. The plugin for moving contact surfaces is
passed in ``plugins``; without a plugin the belts are at rest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element, fromstring

import numpy as np

from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Point, Tracks
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import HULL_FRICTION, Body, Hinge, Shape, Vehicle, sides, vehicle
from treadline.vehicle.stair_solids import NosingGeometry, Solid, stair_solids
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import Standing
from treadline.vehicle.urdf import child, document, roll_pitch_yaw, text

VERSION = "1.6"
LIGHT = """<light name="sun" type="directional"><pose>0 0 10 0 0 0</pose><diffuse>0.8 0.8 0.8 1</diffuse>
<specular>0.1 0.1 0.1 1</specular><direction>0.4 0.2 -0.9</direction><cast_shadows>false</cast_shadows></light>"""
"""Light of the world as SDF."""


def sdf_model(chair: ChairDescription, loading: Chair, *, friction: tuple[float, float]) -> str:
    """Return a chair without a world as SDF.

    Args:
        friction: Coefficients along and across the belts.
    """
    root = Element("sdf", version=VERSION)
    _model(root, chair, vehicle(chair, loading), friction)
    return document(root)


def sdf_world(
    staircase: Staircase,
    chair: ChairDescription,
    loading: Chair,
    *,
    start: Standing | None = None,
    plugins: Sequence[str] = (),
    belts_on_bodies: bool = False,
) -> str:
    """Return a world with the stair and, with ``start``, the chair; light and floor are included, nothing is downloaded.

    Args:
        start: Start pose of the chair.
        plugins: ``<plugin>`` elements, as text, appended to the model.
        belts_on_bodies: Keep the belts on chassis and flipper instead of on separate links.
    """
    root = Element("sdf", version=VERSION)
    world = child(root, "world", name="treadline")
    physics = child(world, "physics", name="ode", type="ode")
    child(physics, "max_step_size", text(0.001))  # Gazebo's default; contacts of belts on nosings are stiff
    child(physics, "real_time_update_rate", "0")  # as fast as it goes
    solver = child(child(physics, "ode"), "solver")
    child(solver, "type", "quick")
    # With the default of 50 iterations a chair turns right three times as fast as left, with 400 half as fast from a heading of
    # 30° (docs/gazebo.md).
    child(solver, "iters", "1000")
    child(world, "gravity", f"0 0 {-GRAVITY_M_S2:g}")
    world.append(fromstring(LIGHT))  # noqa: S314 - a constant of ours
    _stair(world, stair_solids(staircase))
    _model(world, chair, vehicle(chair, loading), staircase.friction, start, plugins, belts_on_bodies=belts_on_bodies)
    return document(root)


def _model(
    parent: Element,
    chair: ChairDescription,
    whole: Vehicle,
    friction: tuple[float, float],
    start: Standing | None = None,
    plugins: Sequence[str] = (),
    *,
    belts_on_bodies: bool = False,
) -> None:
    model = child(parent, "model", name=whole.name)
    if start is not None:
        child(model, "pose", text(*start.p_WB, *roll_pitch_yaw(start.R_WB)))
    child(model, "allow_auto_disable", "0")  # a chair that rests would sleep through its belts' start
    words = {} if belts_on_bodies else {"chair": "track", "flipper": "flipper"}
    for body in whole.bodies:
        if body.mass_kg == 0.0:
            continue  # a robot without payload; SDF has no link without mass
        if body.name in words:
            _three_links(model, body, chair.tracks, words[body.name], friction)
        else:
            # Our plugin takes each collision of a whole body for a belt's: there hull and payload are only drawn.
            _link(model, body, friction, hull_collides=not belts_on_bodies)
        if body.hinge is not None:
            _hinge(model, body, body.hinge)
        elif body.parent is not None:
            _joint(model, body.name, body.parent)
    # Here the surfaces are brought to move: the plugin sets the contacts' motion on left_track, right_track and the flippers.
    for plugin in plugins:
        model.append(fromstring(plugin))  # noqa: S314 - the caller's own element


def _three_links(model: Element, body: Body, tracks: Tracks, word: str, friction: tuple[float, float]) -> None:
    """Write a body with both belts: the body itself, and one link per belt."""
    middle, *belts = divided(body, tracks, word)
    _link(model, middle, friction)
    for belt in belts:
        _link(model, belt, friction)
        _joint(model, belt.name, body.name)


def divided(body: Body, tracks: Tracks, word: str) -> tuple[Body, Body, Body]:
    """Return a body as three: the middle, and its left and right belt, named by side and ``word``.

    The two sides are level with the centre of mass, half a gauge to either side: sum, centre and moments are those of the body.
    """
    (x, y, z), (ixx, iyy, izz), aside_m = body.com_m, body.inertia, 0.5 * tracks.gauge_m
    side_kg = 0.02 * body.mass_kg  # simulators need a mass in each link, with an unchanged sum
    own = side_kg * 0.05**2 / 12.0  # a thin horizontal plate, small enough for a thin flipper
    apart = side_kg * aside_m**2
    middle = replace(
        body,
        mass_kg=body.mass_kg - 2.0 * side_kg,
        inertia=(ixx - 2.0 * (apart + own), iyy - 2.0 * own, izz - 2.0 * (apart + 2.0 * own)),
        shapes=tuple(shape for shape in body.shapes if shape.belt is None),
    )
    left, right = (
        replace(
            body,
            name=f"{side}_{word}",
            mass_kg=side_kg,
            com_m=(x, y + sign * aside_m, z),
            inertia=(own, own, 2.0 * own),
            shapes=tuple(shape for shape in body.shapes if shape.belt == side),
        )
        for (side, _), sign in zip(sides(tracks), (1.0, -1.0), strict=True)
    )
    return middle, left, right


def _link(model: Element, body: Body, friction: tuple[float, float], *, hull_collides: bool = True) -> None:
    link = child(model, "link", name=body.name)
    child(link, "pose", text(*body.origin_m, 0.0, 0.0, 0.0))
    inertial = child(link, "inertial")
    child(inertial, "pose", text(*body.com_m, 0.0, 0.0, 0.0))
    child(inertial, "mass", text(body.mass_kg))
    inertia = child(inertial, "inertia")
    for tag, value in zip(("ixx", "iyy", "izz"), body.inertia, strict=True):
        child(inertia, tag, text(value))
    for tag in ("ixy", "ixz", "iyz"):
        child(inertia, tag, "0")
    for shape in body.shapes:
        _geometry(child(link, "visual", name=f"{shape.name}_visual"), shape)
        if shape.belt is not None or hull_collides:
            collision = child(link, "collision", name=shape.name)
            _geometry(collision, shape)
            _surface(collision, (HULL_FRICTION, HULL_FRICTION) if shape.belt is None else friction)


def _geometry(element: Element, shape: Shape) -> None:
    is_box = shape.kind == "box"
    # SDF's cylinder stands along z: a quarter turn about x lays it along y.
    turn = (0.0, -shape.nose_up_rad, 0.0) if is_box else (0.5 * math.pi, 0.0, 0.0)
    child(element, "pose", text(*shape.centre_m, *turn))
    geometry = child(element, "geometry")
    if is_box:
        _box(geometry, shape.half_m)
    else:
        _cylinder(geometry, shape.half_m[0], 2.0 * shape.half_m[1])


def _box(geometry: Element, half_m: Point) -> None:
    child(child(geometry, "box"), "size", text(*(2.0 * half for half in half_m)))


def _cylinder(geometry: Element, radius_m: float, length_m: float) -> None:
    cylinder = child(geometry, "cylinder")
    child(cylinder, "radius", text(radius_m))
    child(cylinder, "length", text(length_m))


def _surface(collision: Element, friction: tuple[float, float]) -> None:
    """Write the friction of a belt; the plugin sets the first direction for each contact."""
    ode = child(child(child(collision, "surface"), "friction"), "ode")
    child(ode, "mu", text(friction[0]))
    child(ode, "mu2", text(friction[1]))


def _joint(model: Element, name: str, parent: str | None, kind: str = "fixed") -> Element:
    joint = child(model, "joint", name=f"{name}_joint", type=kind)
    child(joint, "parent", parent)
    child(joint, "child", name)
    return joint


def _hinge(model: Element, body: Body, hinge: Hinge) -> None:
    joint = _joint(model, body.name, body.parent, "revolute")
    axis = child(joint, "axis")
    child(axis, "xyz", text(*hinge.axis))
    limit = child(axis, "limit")
    low, high = hinge.range_rad
    child(limit, "lower", text(low))
    child(limit, "upper", text(high))
    if hinge.torque_n_m is not None:
        child(limit, "effort", text(hinge.torque_n_m))
    child(limit, "velocity", text(hinge.max_rate_rad_s))


def _stair(world: Element, stair: Sequence[Solid]) -> None:
    model = child(world, "model", name="stair")
    child(model, "static", "1")
    link = child(model, "link", name="stair")
    for number, solid in enumerate(stair):
        name = f"{solid.box.kind}_{number}"
        for tag in ("collision", "visual"):
            box = child(link, tag, name=f"{name}_{tag}")
            child(box, "pose", text(*solid.box.centre_W, 0.0, -solid.box.pitch_rad, solid.box.yaw_rad))
            _box(child(box, "geometry"), solid.box.half_m)
            if solid.nosing is not None:
                _nosing(child(link, tag, name=f"nosing_{number}_{tag}"), solid.nosing)


def _nosing(element: Element, nosing: NosingGeometry) -> None:
    """Write the bar between a nosing's ends; SDF 1.6 has no capsule, so its ends are flat."""
    left, right = np.array(nosing.left_W), np.array(nosing.right_W)
    across = left - right
    child(element, "pose", text(*(0.5 * (left + right)), -0.5 * math.pi, 0.0, math.atan2(-across[0], across[1])))
    _cylinder(child(element, "geometry"), nosing.radius_m, float(np.linalg.norm(across)))
