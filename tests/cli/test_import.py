"""``treadline import``: exported vehicles come back from their files, and what is no vehicle is refused in one line."""

import re
import tomllib
from pathlib import Path
from xml.etree.ElementTree import fromstring, tostring

import numpy as np
import pytest

from treadline.core.settings import settings_of
from treadline.plant.mujoco import model_xml
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import Body, Vehicle, inertia_of, vehicle
from treadline.vehicle.sdf import sdf_model
from treadline.vehicle.tracks import sections
from treadline.vehicle.urdf import urdf

from .conftest import Run, assert_refused

FRICTION = (0.8, 0.6)
LOADING = Chair(payload_kg=4.0, payload_offset_m=(0.01, 0.02, 0.03))
JOINT = {"range_deg": [-70.0, 50.0], "torque_n_m": 90.0, "max_rate_deg_s": 40.0, "lost_damping_n_m_s_rad": 50.0, "mass_kg": 6.0}
FOUR = {
    "name": "four",
    "masses": {
        "chassis_kg": 30.0,
        "chassis_com_m": [0.02, 0.01, 0.12],
        "inertia_kg_m2": [0.5, 0.9, 1.1, 0.02, -0.03, 0.01],
        "hull_m": [0.0, 0.0, 0.15],
        "chassis_size_m": [0.5, 0.3, 0.15],
    },
    "drives": {"max_speed_m_s": 1.0, "lag_s": 0.1, "max_acceleration_m_s2": 3.0, "brake_hold_n": 800.0},
    "camera": {"position_m": [0.3, 0.0, 0.5], "pitch_deg": 35.0},
    "belt": [
        {"name": "main", "start_m": [-0.3, 0.08], "end_m": [0.3, 0.08], "radii_m": [0.08, 0.08], "gauge_m": 0.45, "width_m": 0.08},
        {
            "name": "front",
            "start_m": [0.3, 0.08],
            "end_m": [0.61, 0.08],
            "radii_m": [0.08, 0.05],
            "angle_deg": 20.0,
            "flipper": JOINT | {"com_m": 0.1, "inertia_kg_m2": [0.4, 0.1, 0.45]},
        },
        {
            "name": "rear",
            "start_m": [-0.3, 0.08],
            "end_m": [-0.6, 0.05],
            "radii_m": [0.08, 0.05],
            "gauge_m": 0.62,
            "flipper": JOINT,
        },
    ],
}
"""Robot with two pairs of flippers, written as a list of sections alone."""


def chair_of(name: str) -> ChairDescription:
    return settings_of(FOUR, ChairDescription, where="four.toml") if name == "four" else read_chair(name)


def without_names(text: str) -> str:
    """Return a URDF whose links, joints and shapes have numbers for names."""
    root, numbers = fromstring(text), {}  # noqa: S314 - our own text
    for element in root.iter():
        for key in {"name", "link"}.intersection(element.keys()):
            element.set(key, f"n{numbers.setdefault(element.get(key), len(numbers))}")
    return tostring(root, encoding="unicode")


WRITERS = {
    "urdf": lambda chair: urdf(chair, LOADING),
    "numbered.urdf": lambda chair: without_names(urdf(chair, LOADING)),
    "sdf": lambda chair: sdf_model(chair, LOADING, friction=FRICTION),
    "xml": lambda chair: model_xml(None, chair, LOADING, friction=FRICTION),
}


def about_origin(bodies: tuple[Body, ...]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, first moment and inertia about B's origin of bodies with their joints at zero."""
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for body in bodies:
        place = np.add(body.origin_m, body.com_m)
        mass, first = mass + body.mass_kg, first + body.mass_kg * place
        second += inertia_of(body) + body.mass_kg * (place @ place * np.eye(3) - np.outer(place, place))
    return mass, first, second


def assert_same_masses(theirs: Vehicle, ours: Vehicle) -> None:
    for found, given in zip(about_origin(theirs.bodies), about_origin(ours.bodies), strict=True):
        np.testing.assert_allclose(found, given, atol=1e-9)
    for one, other in zip(theirs.flippers, ours.flippers, strict=True):
        np.testing.assert_allclose(
            (one.mass_kg, *one.origin_m, *one.com_m), (other.mass_kg, *other.origin_m, *other.com_m), atol=1e-9
        )
        np.testing.assert_allclose(inertia_of(one), inertia_of(other), atol=1e-9)
        assert one.hinge is not None
        assert other.hinge is not None
        assert (one.hinge.axis, one.hinge.torque_n_m) == (other.hinge.axis, other.hinge.torque_n_m)
        np.testing.assert_allclose(one.hinge.range_rad, other.hinge.range_rad, atol=1e-9)


@pytest.mark.parametrize("name", ["wheelchair", "wheelchair-fixed", "rescue", "four"])
@pytest.mark.parametrize("kind", WRITERS)
def test_an_exported_vehicle_comes_back(run: Run, tmp_path: Path, name: str, kind: str) -> None:
    chair, file, out = chair_of(name), tmp_path / f"robot.{kind}", tmp_path / "back.toml"
    file.write_text(WRITERS[kind](chair), encoding="utf-8")
    outcome = run("import", file, "--yes", "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["questions"] <= 8
    back = read_chair(str(out))
    assert_same_masses(vehicle(back, Chair(payload_kg=0.0)), vehicle(chair, LOADING))
    for one, other in zip(sections(back), sections(chair), strict=True):
        np.testing.assert_allclose((*one.start_m, *one.radii_m), (*other.start_m, *other.radii_m), atol=1e-9)
        fixed = (0.0, 0.0) if other.motor is not None else (one.stays_rad, other.stays_rad)
        np.testing.assert_allclose((one.length_m, one.zero_rad + fixed[0]), (other.length_m, other.zero_rad + fixed[1]), atol=1e-9)
        np.testing.assert_allclose((one.gauge_m, one.width_m), (other.gauge_m, other.width_m), atol=1e-9)
        if one.motor is not None and other.motor is not None and kind != "xml":  # MJCF has no rates
            assert one.motor.max_rate_deg_s == pytest.approx(other.motor.max_rate_deg_s)
    np.testing.assert_allclose(back.masses.hull_centre_m, chair.masses.hull_centre_m, atol=1e-9)
    np.testing.assert_allclose(back.masses.chassis_size_m, chair.masses.chassis_size_m, atol=1e-9)


def test_what_a_description_lacks_is_marked(run: Run, tmp_path: Path) -> None:
    (tmp_path / "four.sdf").write_text(WRITERS["sdf"](chair_of("four")), encoding="utf-8")
    assert run("import", tmp_path / "four.sdf", "--yes", "--out", tmp_path / "four.toml").code == 0
    text = (tmp_path / "four.toml").read_text(encoding="utf-8")
    marked = {line.partition(" =")[0] for line in text.splitlines() if "# not in the file: " in line}
    drives = {"max_speed_m_s", "lag_s", "max_acceleration_m_s2", "brake_hold_n"}
    assert marked == drives | {"angle_deg", "lost_damping_n_m_s_rad", "position_m", "pitch_deg"}
    assert tomllib.loads(text)["name"] == "four"


LINK = (
    '<link name="{}"><inertial><mass value="{}"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'
    '<collision><origin xyz="{} {} 0" rpy="1.5707963267948966 0 0"/><geometry><cylinder radius="0.1" length="0.05"/></geometry>'
    "</collision></link>"
)
HULL = (
    '<link name="base"><inertial><origin xyz="0 0 0.05"/><mass value="20"/>'
    '<inertia ixx="0.3" iyy="0.5" izz="0.6"/></inertial></link>'
)
FIXED = '<joint name="to_{0}" type="fixed"><parent link="base"/><child link="{0}"/></joint>'
TURNS = (
    '<joint name="to_{0}" type="{2}"><parent link="base"/><child link="{0}"/><origin xyz="{1} {3} 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" effort="30" velocity="1"/></joint>'
)
WHEELS = "".join(
    LINK.format(f"{side}_{end}", 1, x, y) + FIXED.format(f"{side}_{end}")
    for side, y in (("left", 0.2), ("right", -0.2))
    for end, x in (("rear", -0.3), ("front", 0.3))
)


def flipper(name: str, *, x: float = 0.3, y: float = 0.0, mass: float = 2.0, kind: str = "revolute") -> str:
    """Return a link with one pulley on either side 0.3 m ahead of its joint, which is at x."""
    tip = LINK.format(f"{name}_tip", 0, 0.3, 0.2) + FIXED.format(f"{name}_tip").replace(
        'parent link="base"', f'parent link="{name}"'
    )
    return LINK.format(name, mass, 0.3, -0.2) + TURNS.format(name, x, kind, y) + tip


def test_a_flipper_whose_limits_and_axis_point_the_other_way_is_raised_by_a_positive_angle(run: Run, tmp_path: Path) -> None:
    text = HULL + WHEELS + flipper("flipper").replace('lower="-1" upper="1"', 'lower="-0.5" upper="1"')
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{text}</robot>')
    assert run("import", tmp_path / "robot.urdf", "--yes", "--out", tmp_path / "robot.toml").code == 0
    joint = read_chair(str(tmp_path / "robot.toml")).flipper
    assert joint is not None
    np.testing.assert_allclose(np.radians(joint.range_deg), (-1.0, 0.5), atol=1e-9)


@pytest.mark.parametrize(
    ("given", "changed", "remark"),
    [
        ('izz="0.1"/>', 'izz="0.1" ixy="0.01"/>', "its products xy, xz, yz of [0.01, 0.0, 0.0]"),
        ("<inertial>", '<inertial><origin xyz="0 0.05 0"/>', "0.0500 m left of the middle"),
        ('radius="0.1" length="0.05"', 'radius="0.1" length="0.08"', "its width is 0.08 m"),
    ],
)
def test_what_a_flipper_cannot_have_is_named_in_its_file(run: Run, tmp_path: Path, given: str, changed: str, remark: str) -> None:
    plain, other = (flipper("flipper"), flipper("flipper").replace(given, changed))
    for name, text in (("plain", plain), ("other", other)):
        (tmp_path / f"{name}.urdf").write_text(f'<robot name="r">{HULL}{WHEELS}{text}</robot>')
        assert run("import", tmp_path / f"{name}.urdf", "--yes", "--out", tmp_path / f"{name}.toml").code == 0
    assert "# not written" not in (tmp_path / "plain.toml").read_text(encoding="utf-8")
    assert f"# not written: in the file {remark}" in (tmp_path / "other.toml").read_text(encoding="utf-8")


def test_what_the_belts_of_a_vehicle_cannot_have_is_named_in_its_file(run: Run, tmp_path: Path) -> None:
    """Test: sprockets above the flat run, sides of unequal rates, a rear pair off the middle whose sections taper."""
    high = "".join(LINK.format(name, 1, -0.2, y).replace(' 0" rpy', ' 0.1" rpy') + FIXED.format(name) for name, y in SPROCKETS)
    rear = flipper("rear", x=-0.3).replace('xyz="0.3 ', 'xyz="-0.3 ').replace("0.3 0.2 0", "0.3 0.24 0")
    sides = "".join(LINK.format(name, 2, 0.3, y) + TURNS.format(name, 0.3, "revolute", y) for name, y in FRONT)
    text = HULL + WHEELS + high + rear.replace('radius="0.1"', 'radius="0.07"') + sides.replace('velocity="1"', 'velocity="2"', 1)
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{text}</robot>')
    outcome = run("import", tmp_path / "robot.urdf", "--yes", "--out", tmp_path / "robot.toml")
    assert outcome.code == 0, outcome.err
    written = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert "the faster side has 114.6" in written
    assert "its middle is 0.0200 m left of the belts'" in written
    assert "pulleys above the flat run" in written
    (section,) = (section for section in read_chair(str(tmp_path / "robot.toml")).belt if section.name == "rear")
    # The lower side of a section whose pulleys have 0.1 and 0.07 m, 0.3 m apart, is in line with the belts.
    np.testing.assert_allclose(section.angle_deg, -np.degrees(np.arcsin(0.03 / 0.3)), atol=1e-6)


SPROCKETS = (("left_sprocket", 0.2), ("right_sprocket", -0.2))
FRONT = (("left_front_flipper", 0.2), ("right_front_flipper", -0.2))
BAD = {
    "xacro": ('<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"/>', "run xacro first"),
    "no belts": (HULL, "has no belts: nothing round about y lies left or right of its middle; give --belts 'REGEX'"),
    "type": (HULL + WHEELS + flipper("flipper", kind="screw"), "joint 'to_flipper' is of type 'screw', which is unknown"),
    "link": (HULL + FIXED.format("lost"), "joint 'to_lost' names link 'lost', which the file does not have"),
    "mass": (HULL + WHEELS + flipper("flipper", mass=0.0), "link 'flipper' has a mass of 0; give its <inertial>"),
    "chassis": (HULL.replace("20", "0") + WHEELS.replace('mass value="1"', 'mass value="0"'), "link 'base' has a mass of 0"),
    "loop": (HULL + WHEELS + FIXED.format("left_rear").replace("to_", "and_"), "hangs on 'base' and 'base', a loop; remove one"),
    "trees": (HULL + LINK.format("other", 1, 0, 0.2), "no joint holds the links base, other"),
    "behind": (HULL + WHEELS + flipper("flipper", x=0.2), "link 'flipper' turns 0.100 m behind the front pulley"),
    "twice": (
        HULL + WHEELS + flipper("one") + flipper("other"),
        "links one, other turn about one axis, two sections on one side",
    ),
    "axis": (
        HULL + "".join(LINK.format(name, 1, 0, y) + FIXED.format(name) for name, y in (("left", 0.2), ("right", -0.2))),
        "its belts stand on one axis, that of ''",
    ),
    "number": (HULL.replace('"20"', '"heavy"') + WHEELS, "link 'base': mass: 'heavy' is not 1 finite numbers"),
    "numbers": (HULL.replace("0 0 0.05", "0 0") + WHEELS, "'0 0' is not 3 finite numbers"),
    "XML": ("<link", "not XML"),
    "inertia": (HULL.replace('ixx="0.3"', 'ixx="9"') + WHEELS, "masses.inertia_kg_m2 has principal moments of"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_description_that_is_no_vehicle_is_refused_in_one_line(run: Run, tmp_path: Path, case: str) -> None:
    text, words = BAD[case]
    file = tmp_path / "robot.urdf"
    file.write_text(text if text.startswith("<robot") else f'<robot name="r">{text}</robot>')
    assert_refused(run("import", file, "--yes", "--out", tmp_path / "robot.toml"), f"{file}: ", words)
    assert not (tmp_path / "robot.toml").exists()


MODEL = '<sdf version="1.6"><model name="m">{}<link name="base"/></model></sdf>'
OTHERS = {
    "nothing.svg": ("<svg/>", "<svg> is no robot description"),
    "inner.sdf": (
        MODEL.format("<include><uri>model://lidar</uri></include>"),
        "include 'model://lidar' is not resolved; flatten it",
    ),
    "frame.sdf": (MODEL.format('<frame name="f"/>'), "frame 'f' is not resolved"),
    "posed.sdf": (MODEL.format('<pose relative_to="f">0 0 0 0 0 0</pose>'), "a pose is relative to 'f'"),
    "static.sdf": (MODEL.format("<static>1</static>"), "has no model that moves"),
    "empty.urdf": ('<robot name="r"/>', "has no link"),
    "mesh.xml": (
        '<mujoco><asset><mesh name="m" file="lost.stl"/></asset><worldbody><body><geom type="mesh" mesh="m"/></body></worldbody>'
        "</mujoco>",
        "lost.stl",
    ),
    "loop.xml": (
        '<mujoco><worldbody><body name="a"><freejoint/><geom size="1"/></body></worldbody><equality>'
        '<connect name="c" body1="a" anchor="0 0 0"/></equality></mujoco>',
        "equality 'c' closes a loop",
    ),
    "two.xml": ('<mujoco><worldbody><body name="a"/><body name="b"/></worldbody></mujoco>', "has 2 bodies in the world (a, b)"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_kind_is_refused_in_one_line(run: Run, tmp_path: Path, name: str) -> None:
    text, words = OTHERS[name]
    (tmp_path / name).write_text(text)
    assert_refused(run("import", tmp_path / name, "--yes", "--out", tmp_path / "robot.toml"), name, words)


def test_an_import_without_a_terminal_asks_for_the_defaults(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="r">{HULL}{WHEELS}</robot>')
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert_refused(run("import", file, "--out", tmp_path / "robot.toml"), "lacks the largest speed of the belts", "--yes")
    assert_refused(run("import", file, "--belts", "(", "--out", tmp_path / "robot.toml"), "--belts '(' is no regular expression")


def test_answers_at_a_terminal_are_in_the_file(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: belts that meshes hide, named. Expected: radius, width and speed as answered, the other values at their defaults."""
    file, answers = tmp_path / "robot.urdf", iter(["0.11", "0.06", "0.9", "", "0.7"])
    drawn = re.sub(r"<collision>.*?</collision>", "", WHEELS)
    places = {"left_rear": "-0.3 0.2", "left_front": "0.3 0.2", "right_rear": "-0.3 -0.2", "right_front": "0.3 -0.2"}
    for name, place in places.items():
        drawn = drawn.replace(f'<child link="{name}"/>', f'<child link="{name}"/><origin xyz="{place} 0"/>')
    file.write_text(f'<robot name="r">{HULL}{drawn}</robot>')
    monkeypatch.setattr("sys.stdin", type("Terminal", (), {"isatty": lambda _: True, "readline": lambda _: next(answers) + "\n"})())
    outcome = run("import", file, "--belts", "left.*|right.*", "--out", tmp_path / "robot.toml", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["questions"] == 5
    chair = read_chair(str(tmp_path / "robot.toml"))
    assert (chair.tracks.pulley_radius_m, chair.tracks.belt_width_m, chair.tracks.flat_run_m) == (0.11, 0.06, 0.6)
    assert (chair.drives.max_speed_m_s, chair.drives.brake_hold_n, chair.camera.position_m[2]) == (0.9, 600.0, 0.7)
    text = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert "radii_m = [0.11, 0.11]  # not in the file: answered at the import" in text
    assert "width_m = 0.06  # not in the file: answered at the import" in text
