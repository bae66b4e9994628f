"""The graph as a user of ROS 2 changes it: two chairs, other drivers, parameters, the life cycle, and nodes that end."""

import math
import re
import signal
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from lifecycle_msgs.msg import Transition, TransitionEvent
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from treadline.core.signals import ImuSample, TrackReading
from treadline.ros import channels as on

CLOCKED = ("-r", "/clock:=clock", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static")


def in_(namespace: str, *more: str) -> tuple[str, ...]:
    return ("-r", f"__ns:={namespace}", *CLOCKED, *more)


def test_two_chairs_in_one_graph(started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...]) -> None:
    """Test: two whole graphs in two namespaces, each with its own clock; the planner of one is killed. Expected result: its guard
    holds, the other chair drives on."""
    left, right = watching("/left"), watching("/right")
    states = {}
    for bystander in (left, right):
        bystander.watch_clock("clock")
        states[bystander] = bystander.hear_signals(on.GUARD)
    started(*(role for role in roles if role != "driver"), given=in_("/left"))
    driver = started("driver", given=in_("/left"))
    started(*roles, given=in_("/right"))
    left.until(lambda: left.t_s > 1.0, "the first second of the left chair")
    right.until(lambda: right.t_s > 1.0, "the first second of the right chair")
    assert [state.holding for state in states[left] if state.holding] == []
    left.pause(0.3)  # hears what has come meanwhile, the clock included
    driver.end(signal.SIGKILL)
    killed_s = left.t_s
    left.until(lambda: any(state.holding for state in states[left]), "a hold")
    held = next(state for state in states[left] if state.holding)
    assert held.t_s - killed_s < 0.8
    passed_s = right.t_s + 2.0
    right.until(lambda: right.t_s > passed_s, "two more seconds of the right chair")
    assert [state.holding for state in states[right] if state.holding] == []


def test_a_second_source_of_a_sensor_holds_and_both_are_named(
    started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...]
) -> None:
    """Test: a chair that drives, and another node that repeats what its IMU says. Expected result: a hold within 1 s."""
    bystander = watching("/twin")
    bystander.watch_clock("clock")
    states, samples = bystander.hear_signals(on.GUARD), bystander.hear_signals(on.IMU)
    speak = bystander.speaker(on.IMU, qos_profile_sensor_data)
    started(*roles, given=in_("/twin", "-p", "pace:=0.5"))
    bystander.until(lambda: bystander.t_s > 1.0, "a second of driving")
    assert [state.holding for state in states if state.holding] == []
    bystander.node.create_timer(0.02, lambda: speak(samples[-1]))
    bystander.until(lambda: any(state.holding for state in states), "a hold", 1.0)
    held = next(state.holding for state in states if state.holding)
    assert re.fullmatch("(.*: )?two sources of /imu, /twin/bystander and /twin/plant; stop one of them", held)


def test_life_cycle_and_parameters(started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...]) -> None:
    """Test: a graph that a manager configures and activates; then its planner is deactivated. Expected result: the guard holds."""
    bystander = watching("/managed")
    bystander.watch_clock("clock")
    states = bystander.hear_signals(on.GUARD)
    started(*roles, given=in_("/managed", "-p", "seed:=3", "-p", "pace:=0.5"), autostart=False)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        for role in roles:
            assert bystander.change(role, transition)
    answer = bystander.ask(GetParameters, "plant/get_parameters", GetParameters.Request(names=["seed", "pace", "role"]))
    seed, pace, role = answer.values
    assert (seed.integer_value, pace.double_value, role.string_value) == (3, 0.5, "plant")
    bystander.until(lambda: bystander.t_s > 1.0, "a second of driving")
    assert [state.holding for state in states if state.holding] == []
    assert bystander.change("driver", Transition.TRANSITION_DEACTIVATE)
    bystander.until(lambda: any(state.holding for state in states), "a hold")
    assert bystander.change("driver", Transition.TRANSITION_CLEANUP)
    assert bystander.state("driver") == "unconfigured"


def test_an_error_of_a_block_is_an_error_of_its_node(
    started: Callable[..., Any], watching: Callable[..., Any], broken: Path
) -> None:
    """Test: a controller of the user's own raises an error. Expected result: one line, ErrorProcessing; the node can
    be configured again."""
    bystander = watching("/broken")
    changes = bystander.hear(TransitionEvent, "driver/transition_event")
    given = ("-r", "__ns:=/broken", "-p", f"controller:={broken}:Broken")
    process = started("driver", given=given, sim=False, autostart=False)
    bystander.until(lambda: bystander.node.count_publishers("/broken/driver/transition_event"), "the node")
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert bystander.change("driver", transition)
    bystander.until(lambda: any(change.goal_state.label == "errorprocessing" for change in changes), "the error")
    assert bystander.state("driver") == "unconfigured"
    assert [line for line in process.said if "ERROR" in line] == [line for line in process.said if "broken on purpose" in line]


def test_drivers_with_sensor_data_quality_are_heard(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    """Test: drivers of IMU and belts, best effort, stamped by the wall's clock. Expected result: odometry, on the wall's clock."""
    bystander = watching("/real")
    odometry = bystander.hear(Odometry, "odom")
    imu, tracks = (bystander.speaker(channel, qos_profile_sensor_data) for channel in (on.IMU, on.TRACKS))

    def sample() -> None:
        t_s = math.floor(100.0 * time.time()) / 100.0
        rest = {"angular_velocity_rad_s": (0.0, 0.0, 0.0), "linear_acceleration_m_s2": (0.0, 0.0, 9.81)}
        imu(ImuSample(t_s=t_s, orientation=(1.0, 0.0, 0.0, 0.0), **rest))
        tracks(TrackReading(t_s=t_s, left_m_s=0.1, right_m_s=0.1, brake_on=False))

    bystander.node.create_timer(0.01, sample)
    started("heading", given=("-r", "__ns:=/real"), sim=False)
    bystander.until(lambda: len(odometry) > 10, "odometry")
    assert abs(odometry[-1].header.stamp.sec - time.time()) < 5.0
    assert odometry[-1].pose.pose.position.x > odometry[0].pose.pose.position.x


CAMERAS = {
    "realsense": (
        "camera/camera/color/image_raw",
        "camera/camera/aligned_depth_to_color/image_raw",
        "camera/camera/color/camera_info",
    ),
    "orbbec": ("camera/color/image_raw", "camera/depth/image_raw", "camera/color/camera_info"),
    "depthai": ("oak/rgb/image_raw", "oak/stereo/image_raw", "oak/rgb/camera_info"),
}


@pytest.mark.parametrize("maker", CAMERAS)
def test_topics_of_a_camera_by_remapping_alone(started: Callable[..., Any], watching: Callable[..., Any], maker: str) -> None:
    """Test: a camera's own topics: depth in millimetres, colour as bgr8, best effort. Expected result: its frames are measured."""
    bystander = watching(f"/{maker}")
    qualities = bystander.hear_signals(on.QUALITY)
    ours = [topic.name.lstrip("/") for topic in on.CHANNELS[on.CAMERA].topics]
    remaps = [word for own, theirs in zip(ours, CAMERAS[maker], strict=True) for word in ("-r", f"{own}:={theirs}")]
    started("camera", given=("-r", f"__ns:=/{maker}", *remaps), sim=False)
    make = bystander.node.create_publisher
    color, depth, info = (
        make(kind, topic, qos_profile_sensor_data) for kind, topic in zip((Image, Image, CameraInfo), CAMERAS[maker], strict=True)
    )
    width, height, number = 160, 120, count()

    def frame() -> None:
        at = Header(stamp=bystander.node.get_clock().now().to_msg(), frame_id="optical")
        k = [130.0, 0.0, 80.0, 0.0, 130.0, 60.0, 0.0, 0.0, 1.0]
        info.publish(CameraInfo(header=at, width=width, height=height, k=k, distortion_model="plumb_bob", d=[0.0] * 5))
        size = {"header": at, "width": width, "height": height}
        far = (2000 + next(number) % 50).to_bytes(2, "little") * (width * height)
        color.publish(Image(encoding="bgr8", step=3 * width, data=b"\x80" * (3 * width * height), **size))
        depth.publish(Image(encoding="16UC1", step=2 * width, data=far, **size))

    bystander.node.create_timer(0.1, frame)
    bystander.until(lambda: len(qualities) > 3, "measured frames")
    assert all(quality.valid_share > 0.9 for quality in qualities)


@pytest.mark.parametrize("kind", [Twist, TwistStamped], ids=lambda kind: kind.__name__)
def test_a_joystick_without_stamps(
    started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...], kind: Any
) -> None:
    """Test: 0.1 m/s each 50 ms as a Twist, and as a TwistStamped whose stamp is zero. Expected result: the belts run at it; of the
    missing stamp a line speaks once, where there should be one."""
    name = f"/joystick_{kind.__name__.lower()}"
    bystander = watching(name)
    bystander.watch_clock("clock")
    commands = bystander.hear_signals(on.TRACKS_CMD)
    of_type = "twist" if kind is Twist else "twist_stamped"
    graph = started(*roles, given=in_(name, "-p", f"cmd_vel:={of_type}", "-p", "start:=goal"))
    publisher, message = bystander.node.create_publisher(kind, "cmd_vel", 10), kind()
    getattr(message, "twist", message).linear.x = 0.1
    bystander.node.create_timer(0.05, lambda: publisher.publish(message))
    bystander.until(lambda: commands and math.isclose(commands[-1].left_m_s, 0.1, abs_tol=1e-6), "belts at 0.1 m/s")
    assert (commands[-1].right_m_s, commands[-1].brake) == (commands[-1].left_m_s, False)
    assert len([line for line in graph.said if "cmd_vel has a stamp of zero" in line]) == int(kind is TwistStamped)
