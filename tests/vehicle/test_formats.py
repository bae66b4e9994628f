"""One description, three files: masses, inertias and geometry are equal when read by independent parsers."""

# ruff: noqa: S314 - the files are ours
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import mujoco
import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.rotations import rotation_x, rotation_y, rotation_z
from treadline.plant.mujoco._mjcf_scene import model_xml
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Scenario, Stair, Start
from treadline.vehicle.bodies import centre_of_mass, vehicle
from treadline.vehicle.sdf import divided, sdf_model, sdf_world
from treadline.vehicle.stair_solids import stair_boxes, stair_solids
from treadline.vehicle.staircase import Staircase, as_designed, build_staircase
from treadline.vehicle.start_pose import standing
from treadline.vehicle.urdf import roll_pitch_yaw, urdf

CHAIRS = ("wheelchair", "wheelchair-fixed", "rescue")
LOADING = Chair(payload_kg=4.0, payload_offset_m=(0.01, 0.02, 0.03), seat_shift_m=0.05)
FRICTION = (0.62, 0.5)
Array = np.ndarray


@dataclass
class Extent:
    """Box around a shape, along B's axes."""

    centre: Array
    half: Array


@dataclass
class ReadBack:
    """Content of a file: total mass, centre and inertia about B's origin, extents of what touches."""

    mass_kg: float
    com_B: Array
    inertia_B: Array
    extents: dict[str, Extent]


def summed(parts: list[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass, centre and the inertia tensor about the origin."""
    mass = sum(part[0] for part in parts)
    com = sum((part[0] * part[1] for part in parts), np.zeros(3)) / mass
    inertia = sum((I + m * (c @ c * np.eye(3) - np.outer(c, c)) for m, c, I in parts), np.zeros((3, 3)))
    return mass, com, inertia


def extent(kind: str, centre: Array, R: Float[np.ndarray, "3 3"], sizes: Array) -> Extent:
    """Return the box around a box (half sizes) or a cylinder about z (radius, half length)."""
    if kind == "box":
        return Extent(centre, np.abs(R) @ sizes)
    axis = R[:, 2]
    return Extent(centre, sizes[1] * np.abs(axis) + sizes[0] * np.sqrt(np.maximum(0.0, 1.0 - axis**2)))


def words(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def numbers(element: Element | None, default: str) -> Array:
    return words(default if element is None else element.text or default)


def turned(rpy: Array) -> Float[np.ndarray, "3 3"]:
    return rotation_z(float(rpy[2])) @ rotation_y(float(rpy[1])) @ rotation_x(float(rpy[0]))


def loaded(xml: str) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of a file, at its initial pose."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mjcf_extent(model: Any, data: Any, geom: int) -> Extent:
    kind = "box" if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX else "cylinder"
    return extent(kind, data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom])


def read_by_mujoco(xml: str) -> ReadBack:
    model, data = loaded(xml)
    axes = data.ximat.reshape(-1, 3, 3)
    parts = [
        (float(model.body_mass[i]), data.xipos[i].copy(), axes[i] @ np.diag(model.body_inertia[i]) @ axes[i].T)
        for i in range(1, model.nbody)
    ]
    drawn = [i for i in range(model.ngeom) if model.geom_contype[i] and "_wheel_" not in model.geom(i).name]
    extents = {model.geom(i).name: mjcf_extent(model, data, i) for i in drawn}
    return ReadBack(*summed(parts), extents)


def read_mjcf(chair: ChairDescription) -> ReadBack:
    return read_by_mujoco(model_xml(None, chair, LOADING, friction=FRICTION))


def read_urdf(chair: ChairDescription) -> ReadBack:
    # As it stands: MuJoCo would take the chassis for a part of the world, and guess a mass for each pulley.
    ending = '<mujoco><compiler fusestatic="false" inertiafromgeom="false" discardvisual="true"/></mujoco></robot>'
    return read_by_mujoco(urdf(chair, LOADING).replace("</robot>", ending))


def sdf_extent(collision: Element, p: Array, R: Array) -> Extent:
    pose, shape = numbers(collision.find("pose"), "0 0 0 0 0 0"), collision.find("geometry")[0]
    box = shape.tag == "box"
    sizes = 0.5 * words(shape.findtext("size")) if box else [float(shape.findtext("radius")), 0.5 * float(shape.findtext("length"))]
    return extent(shape.tag, p + R @ pose[:3], R @ turned(pose[3:]), np.array(sizes))


def read_sdf(chair: ChairDescription) -> ReadBack:
    model = fromstring(sdf_model(chair, LOADING, friction=FRICTION)).find("model")
    parts, extents = [], {}
    for link in model.findall("link"):
        pose = numbers(link.find("pose"), "0 0 0 0 0 0")
        p, R = pose[:3], turned(pose[3:])
        inertial = link.find("inertial")
        assert inertial is not None, f"{link.get('name')}: Gazebo would give it 1 kg"
        com = numbers(inertial.find("pose"), "0 0 0 0 0 0")[:3]
        moments = np.diag([float(inertial.find("inertia").find(key).text) for key in ("ixx", "iyy", "izz")])
        parts.append((float(inertial.find("mass").text), p + R @ com, R @ moments @ R.T))
        extents |= {collision.get("name"): sdf_extent(collision, p, R) for collision in link.findall("collision")}
    return ReadBack(*summed(parts), extents)


READERS: dict[str, Callable[[ChairDescription], ReadBack]] = {"mjcf": read_mjcf, "urdf": read_urdf, "sdf": read_sdf}


@pytest.mark.parametrize("name", CHAIRS)
@pytest.mark.parametrize("other", ["urdf", "sdf"])
def test_masses_inertias_and_geometry_are_equal(name: str, other: str) -> None:
    chair = read_chair(name)
    ours, theirs = READERS["mjcf"](chair), READERS[other](chair)
    # Numbers are written with all their digits; MuJoCo turns inertias into principal axes: rounding is all that may be left.
    assert theirs.mass_kg == pytest.approx(ours.mass_kg, rel=1e-12)
    np.testing.assert_allclose(theirs.com_B, ours.com_B, atol=1e-12)
    np.testing.assert_allclose(theirs.inertia_B, ours.inertia_B, atol=1e-10)
    assert set(theirs.extents) == set(ours.extents)
    assert len(ours.extents) == 12  # five shapes of two belts, hull and payload
    for shape, one in ours.extents.items():
        np.testing.assert_allclose(theirs.extents[shape].centre, one.centre, atol=1e-12, err_msg=shape)
        np.testing.assert_allclose(theirs.extents[shape].half, one.half, atol=1e-7, err_msg=shape)  # 1 - cos² near an axis


@pytest.mark.parametrize("name", CHAIRS)
def test_the_description_weighs_what_the_stability_check_weighs(name: str) -> None:
    chair = read_chair(name)
    flat = 0.0 if chair.flipper is not None else None
    np.testing.assert_allclose(read_mjcf(chair).com_B, centre_of_mass(chair, LOADING, 0.0, flat), atol=1e-12)


@pytest.mark.parametrize("name", CHAIRS)
def test_urdf_is_a_tree_with_limits(name: str) -> None:
    chair = read_chair(name)
    robot = fromstring(urdf(chair, LOADING))
    links = [link.get("name") for link in robot.findall("link")]
    children = [joint.find("child").get("link") for joint in robot.findall("joint")]
    assert len(set(links)) == len(links)
    assert sorted(children) == sorted(set(links) - {"base_link"})  # one parent each, but for the root
    turning = {joint.find("child").get("link"): joint for joint in robot.findall("joint") if joint.get("type") == "revolute"}
    assert set(turning) == ({"seat"} if chair.flipper is None else {"seat", "flipper"})
    for joint in turning.values():
        limit = joint.find("limit")
        assert float(limit.get("lower")) < 0.0 < float(limit.get("upper"))
        assert float(limit.get("effort")) > 0.0
        assert float(limit.get("velocity")) > 0.0
    if chair.flipper is not None:
        assert float(turning["flipper"].find("limit").get("lower")) == pytest.approx(math.radians(chair.flipper.range_deg[0]))
        assert turning["flipper"].find("axis").get("xyz") == "0.0 -1.0 0.0"  # positive raises it


def test_urdf_has_the_cameras_frames_where_perception_has_them() -> None:
    chair = read_chair("wheelchair")
    robot = fromstring(urdf(chair, LOADING))
    R = np.eye(3)
    for name in ("rear_camera_link", "rear_camera_optical_frame"):
        joint = next(joint for joint in robot.findall("joint") if joint.find("child").get("link") == name)
        R = R @ turned(words(joint.find("origin").get("rpy")))
    np.testing.assert_allclose(R, chair.camera_at(240, rear=True).R_BC, atol=1e-12)


@pytest.mark.parametrize("name", CHAIRS)
def test_sdf_gives_each_belt_a_link_for_the_plugin(name: str) -> None:
    chair = read_chair(name)
    root = fromstring(sdf_model(chair, LOADING, friction=FRICTION))
    model = root.find("model")
    links = {link.get("name"): link for link in model.findall("link")}
    words = ("track",) if chair.flipper is None else ("track", "flipper")
    assert {f"{side}_{word}" for side in ("left", "right") for word in words} <= set(links)
    for side in ("left", "right"):
        for collision in links[f"{side}_track"].findall("collision"):
            ode = collision.find("surface/friction/ode")
            assert (float(ode.find("mu").text), float(ode.find("mu2").text)) == FRICTION
    (hull,) = links["chair"].findall("collision")  # what moves is on links of its own
    assert hull.get("name") == "hull"
    names = [element.get("name") for element in model.iter() if element.tag in ("link", "joint", "collision", "visual")]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", CHAIRS)
def test_a_divided_mass_is_one_that_can_be(name: str) -> None:
    chair = read_chair(name)
    for body in vehicle(chair, Chair(model=name, payload_kg=0.0)).bodies:
        for part in divided(body, chair.tracks, "track") if body.name != "seat" else ():
            low, middle, high = sorted(part.inertia)
            assert part.mass_kg > 0.0
            assert low > 0.0
            # No body has one moment larger than the two others together; the flipper is thin, and has it equal.
            assert low + middle >= high * (1.0 - 1e-9)


JITTER = Stair(steps=5, rise_jitter_m=0.002, nosing_yaw_jitter_deg=2.0, walls="both")
ODD = Scenario.model_validate(
    {
        "stair": {"steps": 4, "flights": 2, "turn": "left"},
        "step": ({"index": 1, "tread_slope_deg": 3.0, "yaw_deg": 5.0}, {"index": 2, "overhang_m": 0.03}),
    }
)


@pytest.mark.parametrize(
    "stair", [build_staircase(JITTER, np.random.default_rng(3)), as_designed(ODD.stair, ODD.step)], ids=["jitter", "odd steps"]
)
def test_stair_and_chair_stand_at_the_same_place_in_mjcf_and_sdf(stair: Staircase) -> None:
    chair = read_chair("rescue")
    here = standing(stair, chair.tracks, Start(place="flight", step=3, heading_deg=20.0, lateral_m=0.1))
    model, data = loaded(model_xml(stair, chair, LOADING, friction=FRICTION, start=here))
    world = fromstring(sdf_world(stair, chair, LOADING, start=here)).find("world")
    link = world.find("model[@name='stair']/link")
    theirs = {collision.get("name"): sdf_extent(collision, np.zeros(3), np.eye(3)) for collision in link.findall("collision")}
    ours = {model.geom(i).name: mjcf_extent(model, data, i) for i in range(model.ngeom) if model.geom_bodyid[i] == 0}
    assert len(theirs) == len(stair_boxes(stair)) + sum(solid.nosing is not None for solid in stair_solids(stair))
    for name, found in theirs.items():
        kind, number, _ = name.split("_")
        # A landing is two boxes in MJCF, one on the other: the upper one is ground for the road wheels.
        names = [f"{part}_{number}" for part in (("nosing",) if kind == "nosing" else ("ground", "stair"))]
        layers = [ours.pop(name) for name in names if name in ours]
        low, high = (sign * np.max([sign * layer.centre + layer.half for layer in layers], axis=0) for sign in (-1.0, 1.0))
        np.testing.assert_allclose(found.centre, 0.5 * (low + high), atol=1e-7)
        np.testing.assert_allclose(found.half, 0.5 * (high - low), atol=1e-7)
    assert not ours
    pose = numbers(world.find("model[@name='rescue']/pose"), "")
    np.testing.assert_allclose(pose[:3], data.body("chair").xpos, atol=1e-12)
    np.testing.assert_allclose(turned(pose[3:]), data.body("chair").xmat.reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize(("axis", "coefficient"), [(0, FRICTION[0]), (1, FRICTION[1])])
def test_an_exported_scene_has_its_friction_along_and_across_the_belts(axis: int, coefficient: float) -> None:
    stair, chair = as_designed(Stair(width_m=4.0)), read_chair("rescue")
    here = standing(stair, chair.tracks, Start(place="floor"))
    model, data = loaded(model_xml(stair, chair, LOADING, friction=FRICTION, start=here))
    mujoco.mj_step(model, data, 200)
    data.qvel[axis] = -1.0
    mujoco.mj_step(model, data, 50)
    forces_n = np.zeros((data.ncon, 6))
    for number, force_n in enumerate(forces_n):
        mujoco.mj_contactForce(model, data, number, force_n)
    sliding_n = np.hypot(forces_n[:, 1], forces_n[:, 2]).sum()
    assert sliding_n == pytest.approx(coefficient * forces_n[:, 0].sum(), rel=0.02)


def test_angles_turn_back_into_the_rotation_they_came_from() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        rpy = rng.uniform(-math.pi, math.pi, 3)
        np.testing.assert_allclose(turned(np.array(roll_pitch_yaw(turned(rpy)))), turned(rpy), atol=1e-9)
    straight_down = rotation_y(0.5 * math.pi) @ rotation_x(0.3)
    np.testing.assert_allclose(turned(np.array(roll_pitch_yaw(straight_down))), straight_down, atol=1e-6)
