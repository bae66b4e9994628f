"""A closed-loop flight of ten seconds over real ROS 2, each role in a process of its own, and what everybody hears of it."""

import math
import signal
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, Imu, JointState
from tf2_msgs.msg import TFMessage
from treadline_msgs.msg import StairHeading
from visualization_msgs.msg import MarkerArray

from treadline.ros import channels as on
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.urdf import urdf

FLIGHT_S = 10.0
TOPICS: dict[str, Any] = {
    "imu": Imu,
    "camera/color/image_raw": Image,
    "camera/depth/image_rect": Image,
    "camera/color/camera_info": CameraInfo,
    "stair/heading/detail": StairHeading,
    "stair/markers": MarkerArray,
    "diagnostics": DiagnosticArray,
    "joint_states": JointState,
    "odom": Odometry,
}


@pytest.fixture(scope="module")
def flight(
    started_once: Callable[..., Any], watching_once: Callable[..., Any], roles: tuple[str, ...]
) -> tuple[Any, dict[str, Any]]:
    """Run the graph under names of the user's own."""
    bystander = watching_once()
    bystander.watch_clock()
    for topic, kind in TOPICS.items():
        bystander.hear(kind, topic)
    bystander.hear_signals(on.GUARD)
    for topic in ("/tf", "/tf_static"):
        bystander.hear(TFMessage, topic)
    processes = {role: started_once(role, given=("-r", f"__node:=my_{role}")) for role in roles}
    bystander.until(lambda: bystander.t_s >= FLIGHT_S, "ten seconds of flight")
    return bystander, processes


def stamp_s(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def test_nodes_of_any_name_are_active(flight: tuple[Any, dict[str, Any]], roles: tuple[str, ...]) -> None:
    bystander, _ = flight
    assert {role: bystander.state(f"my_{role}") for role in roles} == dict.fromkeys(roles, "active")


def test_the_chair_comes_straight_and_is_not_held(flight: tuple[Any, dict[str, Any]]) -> None:
    heard = flight[0].heard
    assert [state.holding for state in heard[on.GUARD] if state.holding] == []
    first, last = (abs(heard["stair/heading/detail"][at].heading_rad) for at in (0, -1))
    assert first > math.radians(6.0)
    assert last < math.radians(3.0)


def test_no_stamp_is_zero(flight: tuple[Any, dict[str, Any]]) -> None:
    heard = flight[0].heard
    assert [topic for topic in TOPICS for message in heard[topic] if hasattr(message, "header") and stamp_s(message) == 0.0] == []


def test_messages_are_those_of_drivers_and_tools(flight: tuple[Any, dict[str, Any]]) -> None:
    """Test: IMU at 100 Hz, images and calibration. Expected result: no sample is lost; one name of the camera's optical frame."""
    heard = flight[0].heard
    stamps = [round(100.0 * stamp_s(message)) for message in heard["imu"]]
    assert {later - sooner for sooner, later in pairwise(stamps)} == {1}
    frames = {message.header.frame_id for topic in TOPICS if topic.startswith("camera") for message in heard[topic]}
    assert len(frames) == 1
    children = {at.child_frame_id for message in heard["/tf_static"] for at in message.transforms}
    assert frames <= children
    assert {at.child_frame_id for message in heard["/tf"] for at in message.transforms} == {"base_link", "stair"}


def test_joint_states_name_the_joints_of_the_urdf(flight: tuple[Any, dict[str, Any]]) -> None:
    robot = urdf(read_chair("wheelchair"), Chair())
    for message in flight[0].heard["joint_states"]:
        assert message.name
        assert all(f'name="{name}"' in robot for name in message.name)


def test_ctrl_c_ends_each_process_with_one_line(flight: tuple[Any, dict[str, Any]]) -> None:
    """Test: SIGINT twice, as a terminal and ``ros2 launch`` send it. Expected result: exit code 0, one line."""
    _, processes = flight
    before = {role: len(process.said) for role, process in processes.items()}
    for process in processes.values():
        process.process.send_signal(signal.SIGINT)
    assert {role: process.end() for role, process in processes.items()} == dict.fromkeys(processes, 0)
    for role, process in processes.items():
        assert len(process.said) == before[role] + 1
        assert process.said[-1].endswith(f"[my_{role}]: ended")
