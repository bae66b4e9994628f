"""What ROS 2 says where something is wrong: one line with what and what to do, and no node that pretends to work."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition, TransitionEvent
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState

from treadline.ros import channels as on

PACKAGE = Path(__file__).parents[2] / "ros2" / "treadline_ros2"


def last_line(command: list[str], **environment: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=os.environ | environment)
    lines = (done.stdout + done.stderr).splitlines()
    assert (done.returncode, len(lines)) == (2, 1), lines
    return lines[0]


def test_no_ros_2() -> None:
    """Test: a Python without ROS 2. Expected result: one line says what to source."""
    without = f"import sys; sys.path[:0] = [{str(PACKAGE)!r}]; sys.modules['rclpy'] = sys.modules['ament_index_python'] = None; \
from treadline_ros2.node import main; sys.exit(main())"
    assert "source /opt/ros/DISTRO/setup.bash" in last_line([sys.executable, "-c", without])


def test_a_middleware_that_is_not_installed() -> None:
    said = last_line([sys.executable, "-m", "treadline_ros2.node", "guard"], RMW_IMPLEMENTATION="rmw_none_cpp")
    assert said == (
        "treadline: RMW_IMPLEMENTATION is rmw_none_cpp, here is rmw_fastrtps_cpp: "
        f"install ros-{os.environ['ROS_DISTRO']}-rmw-none-cpp, or unset the variable"
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("-p", "scenario:=nowhere"), "nowhere"),
        (("-p", "role:=pilot"), "no role is called 'pilot'; name one of guard, camera"),
        (("-p", "cmd_vel:=joystick"), "cmd_vel is 'joystick'; give twist_stamped or twist"),
        (("-p", "pace:=0.0"), "pace is 0; give a positive number"),
    ],
)
def test_parameters_that_cannot_be(started: Callable[..., Any], given: tuple[str, ...], said: str) -> None:
    process = started("guard", given=given)
    assert process.process.wait(60) == 2
    assert [line for line in process.said if "ERROR" in line and said in line]


def test_a_node_of_bad_settings_stays_unconfigured(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    started("guard", given=("-r", "__ns:=/bad", "-p", "scenario:=nowhere"), autostart=False)
    bystander = watching()
    assert not bystander.change("/bad/guard", Transition.TRANSITION_CONFIGURE)
    assert bystander.state("/bad/guard") == "unconfigured"


def test_nobody_publishes_a_clock(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    """Test: readings come, and no clock, for longer than the node's patience. Expected result: one line; the node is in error, and
    says so to whoever manages it."""
    bystander = watching("/unclocked")
    changes = bystander.hear(TransitionEvent, "heading/transition_event")
    process = started("heading", given=("-r", "__ns:=/unclocked", "-p", "patience:=3.0"))
    publisher = bystander.node.create_publisher(Imu, "imu", qos_profile_sensor_data)
    bystander.node.create_timer(0.05, lambda: publisher.publish(Imu()))
    bystander.until(lambda: any(change.goal_state.label == "errorprocessing" for change in changes), "the error")
    errors = [line for line in process.said if "ERROR" in line]
    assert len(errors) == 1
    assert re.search(r"heading: nothing on /imu|heading: no /clock after 3 s: start a simulated plant", errors[0])
    assert bystander.state("heading") == "unconfigured"


def test_a_topic_of_another_type(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    bystander = watching("/mistyped")
    bystander.node.create_publisher(JointState, "imu", 10)
    process = started("heading", given=("-r", "__ns:=/mistyped", "-p", "patience:=3.0"))
    said = "/imu is published as sensor_msgs/msg/JointState; sensor_msgs/msg/Imu is read"
    bystander.until(lambda: any(said in line for line in process.said), "the line")


def test_a_quality_of_service_that_does_not_fit(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    """Test: a handset that publishes with best effort. Expected result: not heard, for no press may be lost; one line says so."""
    bystander = watching("/lossy")
    bystander.speaker(on.OPERATOR, qos_profile_sensor_data)
    process = started("guard", given=("-r", "__ns:=/lossy"))
    said = "/lossy/operator: a publisher whose RELIABILITY does not fit is not heard; publish with reliability RELIABLE"
    bystander.until(lambda: any(said in line for line in process.said), "the line")


def test_two_guards_in_a_namespace(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    bystander = watching("/twice")
    states = bystander.hear_signals(on.GUARD)
    for name in ("guard_left", "guard_right"):
        started("guard", given=("-r", "__ns:=/twice", "-r", f"__node:={name}"), sim=False)
    bystander.until(lambda: len({state.sender for state in states if state.holding}) == 2, "both hold")
    said = "(guard: )?two sources of /guard/state, /twice/guard_left and /twice/guard_right; stop one of them"
    assert all(re.fullmatch(said, state.holding) for state in states if state.holding)
