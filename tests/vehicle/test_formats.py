"""One description, three files: masses, inertias and geometry are equal when read by independent parsers."""

# ruff: noqa: S314 - the files are ours
import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import Element, fromstring

import mujoco
import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import rotation_x, rotation_y, rotation_z
from treadline.plant.mujoco import open_plant
from treadline.plant.mujoco._mjcf_scene import model_xml, scene_xml
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Scenario, Stair, Start
from treadline.vehicle.bodies import vehicle
from treadline.vehicle.sdf import divided, sdf_model, sdf_world
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase, as_designed, build_staircase
from treadline.vehicle.start_pose import Standing, standing
from treadline.vehicle.static_stability import centre_of_mass
from treadline.vehicle.urdf import urdf
from treadline.vehicle.xml_elements import roll_pitch_yaw

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


def box_around(R: Float[np.ndarray, "3 3"], half: Array) -> Array:
    return np.abs(R) @ half


def cylinder_around(axis: Array, radius: float, half_length: float) -> Array:
    return half_length * np.abs(axis) + radius * np.sqrt(np.maximum(0.0, 1.0 - axis**2))


def numbers(element: Element | None, default: str) -> Array:
    return np.array([float(word) for word in (default if element is None else element.text or default).split()])


def turned(rpy: Array) -> Float[np.ndarray, "3 3"]:
    return rotation_z(float(rpy[2])) @ rotation_y(float(rpy[1])) @ rotation_x(float(rpy[0]))


def read_mjcf(chair: ChairDescription) -> ReadBack:
    model = mujoco.MjModel.from_xml_string(model_xml(None, chair, LOADING, friction=0.62))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    parts = [
        (
            float(model.body_mass[i]),
            data.xipos[i].copy(),
            data.ximat[i].reshape(3, 3) @ np.diag(model.body_inertia[i]) @ data.ximat[i].reshape(3, 3).T,
        )
        for i in range(1, model.nbody)
    ]
    extents = {}
    for i in range(model.ngeom):
        R, size = data.geom_xmat[i].reshape(3, 3), model.geom_size[i]
        is_box = model.geom_type[i] == mujoco.mjtGeom.mjGEOM_BOX
        half = box_around(R, size) if is_box else cylinder_around(R[:, 2], size[0], size[1])
        if model.geom_contype[i]:
            extents[model.geom(i).name] = Extent(data.geom_xpos[i].copy(), half)
    return ReadBack(*summed(parts), extents)


def read_urdf(chair: ChairDescription) -> ReadBack:
    robot = fromstring(urdf(chair, LOADING))
    frames = {"base_link": (np.zeros(3), np.eye(3))}
    for joint in robot.findall("joint"):  # parents stand before their children
        p, R = frames[joint.find("parent").get("link")]
        origin = joint.find("origin")
        xyz, rpy = (np.array([float(word) for word in origin.get(key).split()]) for key in ("xyz", "rpy"))
        frames[joint.find("child").get("link")] = (p + R @ xyz, R @ turned(rpy))
    parts, extents = [], {}
    for link in robot.findall("link"):
        p, R = frames[link.get("name")]
        inertial = link.find("inertial")
        if inertial is not None:
            com = np.array([float(word) for word in inertial.find("origin").get("xyz").split()])
            moments = np.diag([float(inertial.find("inertia").get(key)) for key in ("ixx", "iyy", "izz")])
            parts.append((float(inertial.find("mass").get("value")), p + R @ com, R @ moments @ R.T))
        for collision in link.findall("collision"):
            origin = collision.find("origin")
            xyz, rpy = (np.array([float(word) for word in origin.get(key).split()]) for key in ("xyz", "rpy"))
            shape, R_shape = collision.find("geometry")[0], R @ turned(rpy)
            if shape.tag == "box":
                half = box_around(R_shape, 0.5 * np.array([float(word) for word in shape.get("size").split()]))
            else:
                half = cylinder_around(R_shape[:, 2], float(shape.get("radius")), 0.5 * float(shape.get("length")))
            extents[collision.get("name")] = Extent(p + R @ xyz, half)
    return ReadBack(*summed(parts), extents)


def sdf_extent(collision: Element, p: Array, R: Array) -> Extent:
    pose = numbers(collision.find("pose"), "0 0 0 0 0 0")
    shape, R_shape = collision.find("geometry")[0], R @ turned(pose[3:])
    if shape.tag == "box":
        half = box_around(R_shape, 0.5 * numbers(shape.find("size"), ""))
    else:
        half = cylinder_around(R_shape[:, 2], float(shape.find("radius").text), 0.5 * float(shape.find("length").text))
    return Extent(p + R @ pose[:3], half)


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
    for shape, extent in ours.extents.items():
        np.testing.assert_allclose(theirs.extents[shape].centre, extent.centre, atol=1e-12, err_msg=shape)
        np.testing.assert_allclose(theirs.extents[shape].half, extent.half, atol=1e-7, err_msg=shape)  # 1 - cos² near an axis


def test_a_sloping_winding_overhanging_stair_is_the_same_in_mjcf_and_sdf() -> None:
    steps = ({"index": 1, "tread_slope_deg": 3.0, "yaw_deg": 5.0}, {"index": 2, "overhang_m": 0.03})
    scenario = Scenario.model_validate({"stair": {"steps": 4, "flights": 2, "turn": "left"}, "step": steps})
    staircase, chair = as_designed(scenario.stair, scenario.step), read_chair("wheelchair")
    model = mujoco.MjModel.from_xml_string(scene_xml(staircase, chair, LOADING))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    link = fromstring(sdf_world(staircase, chair, LOADING)).find("world/model[@name='stair']/link")
    boxes = [element for element in link.findall("collision") if element.find("geometry/box") is not None]
    assert len(boxes) == len(stair_boxes(staircase))
    for number, element in enumerate(boxes):
        geom = model.geom(f"stair_{number}").id
        pose = numbers(element.find("pose"), "")
        np.testing.assert_allclose(pose[:3], data.geom_xpos[geom], atol=1e-12)
        np.testing.assert_allclose(turned(pose[3:]), data.geom_xmat[geom].reshape(3, 3), atol=1e-12)


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


@pytest.mark.parametrize("name", CHAIRS)
def test_an_independent_parser_reads_the_same_mass_from_the_urdf(name: str) -> None:
    chair = read_chair(name)
    # As it stands: MuJoCo would take the chassis for a part of the world, and guess a mass for each pulley.
    ending = '<mujoco><compiler fusestatic="false" inertiafromgeom="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(urdf(chair, LOADING).replace("</robot>", ending))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ours = read_mjcf(chair)
    assert float(model.body_mass.sum()) == pytest.approx(ours.mass_kg, rel=1e-9)
    com = (model.body_mass[:, None] * data.xipos).sum(axis=0) / model.body_mass.sum()
    np.testing.assert_allclose(com, ours.com_B, atol=1e-9)


def test_urdf_has_the_cameras_frames_where_perception_has_them() -> None:
    chair = read_chair("wheelchair")
    robot = fromstring(urdf(chair, LOADING))
    R = np.eye(3)
    for name in ("rear_camera_link", "rear_camera_optical_frame"):
        joint = next(joint for joint in robot.findall("joint") if joint.find("child").get("link") == name)
        R = R @ turned(np.array([float(word) for word in joint.find("origin").get("rpy").split()]))
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


@pytest.fixture(scope="module")
def stair() -> Staircase:
    jitter = Stair(steps=5, rise_jitter_m=0.002, nosing_yaw_jitter_deg=2.0, walls="both")
    return build_staircase(jitter, np.random.default_rng(3))


def test_the_stair_is_the_same_in_mjcf_and_sdf(stair: Staircase) -> None:
    chair = read_chair("rescue")
    here = standing(stair, chair.tracks, Start(place="flight", step=3, heading_deg=20.0))
    model = mujoco.MjModel.from_xml_string(model_xml(stair, chair, LOADING, friction=0.62, start=here))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    world = fromstring(sdf_world(stair, chair, LOADING, start=here)).find("world")
    link = next(found for found in world.findall("model") if found.get("name") == "stair").find("link")
    theirs = [sdf_extent(collision, np.zeros(3), np.eye(3)) for collision in link.findall("collision")]
    ours = [i for i in range(model.ngeom) if model.geom_bodyid[i] == 0]
    assert len(theirs) == len(ours) == 3 + 2 * 5  # floor, two walls, five steps and their nosings
    for i, extent in zip(ours, theirs, strict=True):
        R, size = data.geom_xmat[i].reshape(3, 3), model.geom_size[i]
        is_box = model.geom_type[i] == mujoco.mjtGeom.mjGEOM_BOX
        half = box_around(R, size) if is_box else cylinder_around(R[:, 2], size[0], size[1])
        np.testing.assert_allclose(extent.centre, data.geom_xpos[i], atol=1e-9)
        np.testing.assert_allclose(extent.half, half, atol=1e-7)


def test_the_chair_stands_at_the_same_place_in_both_and_touches_nothing_yet(stair: Staircase) -> None:
    chair = read_chair("rescue")
    here = standing(stair, chair.tracks, Start(place="flight", step=3, heading_deg=20.0, lateral_m=0.1))
    model = mujoco.MjModel.from_xml_string(model_xml(stair, chair, LOADING, friction=0.62, start=here))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    world = fromstring(sdf_world(stair, chair, LOADING, start=here)).find("world")
    pose = numbers(next(found for found in world.findall("model") if found.get("name") == "rescue").find("pose"), "")
    np.testing.assert_allclose(pose[:3], data.body("chair").xpos, atol=1e-12)
    np.testing.assert_allclose(turned(pose[3:]), data.body("chair").xmat.reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize("start", [Start(place="floor", heading_deg=10.0), Start(place="flight", step=3), Start(place="landing")])
def test_a_chair_is_put_down_where_the_plant_puts_it(start: Start) -> None:
    scenario = Scenario(stair=Stair(steps=6)).model_copy(update={"start": start})
    plant = open_plant(scenario, seed=0)
    plant._pose()
    here: Standing = standing(plant.staircase, read_chair("wheelchair").tracks, start)
    np.testing.assert_allclose(here.p_WB, plant._data.qpos[:3], atol=1e-12)


def test_angles_turn_back_into_the_rotation_they_came_from() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        rpy = rng.uniform(-math.pi, math.pi, 3)
        np.testing.assert_allclose(turned(np.array(roll_pitch_yaw(turned(rpy)))), turned(rpy), atol=1e-9)
    straight_down = rotation_y(0.5 * math.pi) @ rotation_x(0.3)
    np.testing.assert_allclose(turned(np.array(roll_pitch_yaw(straight_down))), straight_down, atol=1e-6)
