"""Odometry and frames, for RViz and other planners: what a node of somebody else's reads."""

import math
from typing import Any

import numpy as np
import pytest
from world import belts, imu

from treadline.core.rotations import rotation_of
from treadline.core.signals import FlipperReading, SeatReading
from treadline.mission.mission_config import MissionConfig
from treadline.mission.odometry import DeadReckoning, Odometry
from treadline.ros import channels as on
from treadline.ros._codec import encoded
from treadline.ros.assembly import node_of
from treadline.ros.lockstep import InProcess
from treadline.scenario.chair import read_chair
from treadline.vehicle.linkage import SeatLinkage


def test_a_way_up_and_then_to_the_left_adds_up() -> None:
    reckoning = DeadReckoning()
    assert reckoning.step(belts(0.0, 0.5, 0.5)) is None  # whither is not known yet
    place: Odometry | None = None
    for k in range(201):
        # On the flight one belt runs ahead, and slips; on the landing both count.
        yaw, pitch, right_m_s = (0.0, 0.5, 0.9) if k <= 100 else (0.5 * math.pi, 0.0, 0.5)
        reckoning.update(imu(k / 100, pitch, yaw_rad=yaw))
        place = reckoning.step(belts(k / 100, 0.5, right_m_s))
    np.testing.assert_allclose(place.p_OB, [0.5 * math.cos(0.5), 0.5, 0.5 * math.sin(0.5)], atol=1e-9)
    assert place.speed_m_s == pytest.approx(0.5)


def test_over_a_gap_nothing_is_made_up() -> None:
    reckoning = DeadReckoning()
    reckoning.update(imu(0.0))
    reckoning.step(belts(0.0, 0.5, 0.5))
    place = reckoning.step(belts(3.0, 0.5, 0.5))
    assert place.p_OB.tolist() == [0.0, 0.0, 0.0]


def test_the_heading_node_says_where_the_chair_its_sensors_and_its_joints_are() -> None:
    """Test: 2.5 s at 0.2 m/s, with a seat at a stroke beyond its end and a flipper at 20°. Expected result: odometry and the angles
    of the URDF's joints at 20 Hz, the seat's at its end; the sensors' places each second."""
    chair = read_chair("wheelchair")
    node, air = node_of("heading", MissionConfig(chair=chair, loop="open")), InProcess()
    said: dict[str, list[Any]] = {on.ODOM: [], on.MOUNTS: [], on.JOINT_STATES: []}
    for channel, kept in said.items():
        air.subscribe(channel, kept.append)
    node.listen(air)
    for k in range(250):
        node.advance(k / 100)
        air.publish(on.IMU, imu(k / 100))
        air.publish(on.SEAT, SeatReading(t_s=k / 100, pitch_rad=0.0, stroke_m=chair.levelled_seat.stroke_m[1] + 0.001))
        air.publish(on.FLIPPER, FlipperReading(t_s=k / 100, angle_rad=math.radians(20.0), torque_n_m=0.0))
        air.publish(on.TRACKS, belts(k / 100, 0.2, 0.2))
        node.tick(k / 100)
    for channel in (on.ODOM, on.JOINT_STATES):
        assert [place.t_s for place in said[channel]] == pytest.approx([k / 20 for k in range(50)])
    assert said[on.ODOM][-1].p_OB[0] == pytest.approx(0.2 * 2.45)
    assert [mounts.t_s for mounts in said[on.MOUNTS]] == [0.0, 1.0, 2.0]
    state = said[on.JOINT_STATES][-1]
    assert dict(zip(state.names, state.angles_rad, strict=True)) == {
        "seat_joint": SeatLinkage(chair.levelled_seat).angle_range[1],
        "flipper_joint": math.radians(20.0),
    }
    ((topic, kind, _),) = encoded(on.JOINT_STATES, state, ros1=False)
    assert (topic, kind) == ("/joint_states", "sensor_msgs/msg/JointState")


def test_a_tree_of_frames_leads_from_odometry_to_the_camera() -> None:
    from rosbags import typesys

    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    camera = MissionConfig(chair=read_chair("wheelchair"), loop="open").camera
    turned = imu(1.0, yaw_rad=0.3).orientation
    place = Odometry(t_s=1.0, p_OB=np.array([1.0, 2.0, 3.0]), orientation=turned, speed_m_s=0.2, angular_velocity_rad_s=np.zeros(3))
    sent = [*encoded(on.ODOM, place, ros1=False), *encoded(on.MOUNTS, on.Mounts(t_s=1.0, camera=camera), ros1=False)]
    frames: dict[str, Any] = {}
    for topic, kind, data in sent:
        message = store.deserialize_cdr(data, kind)
        if topic == on.ODOM:
            assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        else:
            frames |= {part.child_frame_id: part for part in message.transforms}
    assert {child: part.header.frame_id for child, part in frames.items()} == {
        "base_link": "odom",
        **dict.fromkeys(("chair", "imu"), "base_link"),
        "camera_link": "chair",
        "camera_optical_frame": "camera_link",
    }
    move = frames["camera_link"].transform.translation
    assert (move.x, move.y, move.z) == camera.mount_m
    R_BC = np.eye(3)
    for name in ("camera_link", "camera_optical_frame"):
        turn = frames[name].transform.rotation
        R_BC = R_BC @ rotation_of(np.array([turn.w, turn.x, turn.y, turn.z]))
    np.testing.assert_allclose(R_BC, camera.R_BC, atol=1e-12)
    assert frames["base_link"].transform.rotation.z == pytest.approx(math.sin(0.15))
