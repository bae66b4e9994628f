"""Further sections of the belts: a second pair of flippers in statics, simulation and files."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from chairs import CHAIR

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.settings import settings_of
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.mujoco import open_plant
from treadline.plant.mujoco._mjcf_scene import model_xml
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair, Scenario
from treadline.vehicle.bodies import centre_of_mass, vehicle
from treadline.vehicle.rest_poses import rest_chair

LEVEL = np.array([[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
JOINT = {"range_deg": [-75.0, 60.0], "torque_n_m": 60.0, "max_rate_deg_s": 30.0, "lost_damping_n_m_s_rad": 50.0, "mass_kg": 2.0}
REAR = {"name": "rear", "start_m": [-0.3, 0.08], "end_m": [-0.6, 0.08], "radii_m": [0.08, 0.05], "flipper": JOINT}
TRACKS = {
    "flat_run_m": 0.6, "approach_m": 0.3, "approach_angle_deg": 30.0, "pulley_radius_m": 0.08, "nose_radius_m": 0.05,
    "gauge_m": 0.45, "belt_width_m": 0.08,
}  # fmt: skip
ROBOT: dict[str, Any] = {
    "name": "four",
    "tracks": TRACKS,
    "masses": {"chassis_kg": 30.0, "chassis_com_m": [0.0, 0.0, 0.12], "chassis_size_m": [0.5, 0.3, 0.15]},
    "drives": {"max_speed_m_s": 1.0, "lag_s": 0.1, "max_acceleration_m_s2": 3.0, "brake_hold_n": 800.0},
    "camera": {"position_m": [0.3, 0.0, 0.5], "pitch_deg": 35.0},
    "flipper": JOINT,
}


def robot(*belts: dict[str, Any], **tables: Any) -> ChairDescription:
    return settings_of(ROBOT | {"belt": list(belts)} | tables, ChairDescription, where="robot.toml")


@pytest.mark.parametrize("angle_deg", [-20.0, 10.0, 40.0])
def test_a_rear_pair_that_follows_makes_the_robot_symmetric(angle_deg: float) -> None:
    chair = rest_chair(robot(REAR | {"follows": True}), 0.0)
    pose = chair.at(LEVEL, 0.0, (angle_deg * DEG,), 0.02)
    assert pose.pitch_rad == pytest.approx(0.0, abs=0.01 * DEG)
    assert pose.front_margin_rad == pytest.approx(pose.rear_margin_rad, abs=0.1 * DEG)
    assert pose.front_share == pytest.approx(0.5, abs=1e-3)
    front_n_m, rear_n_m = pose.torques_n_m
    assert front_n_m == pytest.approx(rear_n_m, abs=0.1)
    # Tips that reach below the flat run bear all of the weight, each pair a half at its lever.
    borne = 0.5 * 34.0 * 9.81 * 0.3 * math.cos(angle_deg * DEG) if angle_deg < 0.0 else 0.0
    assert front_n_m == pytest.approx(borne, rel=0.02)


def test_a_tapered_section_touches_an_edge_where_the_common_tangent_does() -> None:
    """Test: an edge 0.45 m behind the middle. Expected: the lower tangent of circles of 0.08 and 0.05 m, 0.3 m apart, is there."""
    edge = np.array([[-9.0, 0.0, 0.0], [-0.451, 0.0, 0.0], [-0.45, 0.2, 0.0], [-0.449, 0.0, 0.0], [9.0, 0.0, 0.0]])
    chair = rest_chair(robot(REAR | {"angle_deg": 0.0}), 0.0)
    pose = chair.at(edge, 0.0, (30.0 * DEG,), -15.0 * DEG)
    tilt = math.asin((0.08 - 0.05) / 0.3)
    # In the robot's axes: the tangent point below the first pulley, and from there along the tangent.
    foot = np.array([-0.3 - 0.08 * math.sin(tilt), 0.08 - 0.08 * math.cos(tilt)])
    c, s = math.cos(pose.pitch_rad), math.sin(pose.pitch_rad)
    place = np.array([[c, s], [-s, c]]) @ (np.array(pose.rear_m) - [0.0, pose.height_m])
    along = place - foot
    assert along[1] == pytest.approx(-along[0] * math.tan(tilt), abs=1e-4)


@pytest.mark.parametrize(("belt", "rear_deg"), [({"angle_deg": 25.0}, 25.0), ({"follows": True}, -10.0)])
def test_simulation_and_statics_agree_on_where_a_robot_rests(belt: dict[str, Any], rear_deg: float) -> None:
    """Test: the front pair pressed down to -10°, the rear one staying, or following. Expected: the pitch of the rest pose."""
    chair = robot(REAR | belt, seat=None)
    scenario = Scenario.model_validate({"chair": {"payload_kg": 0.0}, "sensors": {"camera": "statistical"}})
    plant = open_plant(scenario, chair=chair)
    plant.start()
    now = {"seat": SeatCommand(t_s=0.0, rate_m_s=0.0), "tracks": TrackCommand(t_s=0.0, left_m_s=0.0, right_m_s=0.0)}
    plant.write(**now, flipper=FlipperCommand(t_s=0.0, rate_rad_s=-20.0 * DEG))
    plant.advance(2.0)
    plant.write(**now, flipper=FlipperCommand(t_s=2.0, rate_rad_s=0.0))
    plant.advance(3.0)
    angle_rad = next(reading.angle_rad for reading in reversed(plant.read()) if hasattr(reading, "angle_rad"))
    pose = rest_chair(chair, 0.0).at(LEVEL, 0.0, (angle_rad,), 0.0)
    # The motors' servos yield by up to 0.3° under half of the weight.
    assert plant.truth()[-1].pitch_rad == pytest.approx(pose.pitch_rad, abs=0.6 * DEG)
    assert angle_rad == pytest.approx(-10.0 * DEG, abs=1.0 * DEG)
    assert (pose.pitch_rad > 1.0 * DEG) == (rear_deg > 0.0)


def test_bodies_statics_and_simulator_have_one_mass_and_one_centre() -> None:
    chair, loading = robot(REAR | {"angle_deg": 20.0}), Chair(payload_kg=0.0)
    model = mujoco.MjModel.from_xml_string(model_xml(None, chair, loading, friction=(0.8, 0.65)))
    data = mujoco.MjData(model)
    data.qpos[-2:] = 0.5, 20.0 * DEG
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.subtree_com[1], centre_of_mass(chair, loading, 0.0, 0.5), atol=1e-12)
    assert model.body_subtreemass[1] == pytest.approx(sum(body.mass_kg for body in vehicle(chair, loading).bodies))


@pytest.mark.parametrize(
    ("belts", "words"),
    [
        ([REAR, REAR], "two sections of the vehicle are called 'rear'"),
        ([REAR | {"name": "approach"}], "two sections of the vehicle are called 'approach'"),
        ([REAR, REAR | {"name": "other"}], "two sections turn about one axis, at -0.3 m ahead and 0.08 m up"),
        ([REAR | {"follows": True, "flipper": None}], "follows the flipper, and has no"),
        ([REAR | {"radii_m": [0.4, 0.05]}], "one pulley holds the other"),
        ([REAR | {"angle_deg": 70.0}], "outside its range of -75 to 60"),
    ],
)
def test_sections_that_contradict_each_other_are_refused(belts: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        robot(*belts)


def test_a_chair_without_further_sections_is_as_before() -> None:
    assert [body.name for body in vehicle(CHAIR, Chair()).bodies] == ["chair", "seat", "flipper"]
