"""What RViz and Foxglove draw on ROS 2: every frame leads to ``odom``, and every display names a topic of its type."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.core.rotations import rotation_of
from treadline.core.signals import FreeGround
from treadline.io.message_types import message_of
from treadline.io.scene_messages import ADD, CLEAR, DELETE_ALL, TEXT_FACING
from treadline.io.stair_markers import drop_marker
from treadline.mission.mission_blocks import build_blocks, guard_config
from treadline.plant.faults import faulty
from treadline.plant.mujoco import open_plant
from treadline.ros import channels as on
from treadline.ros._codec import encoded
from treadline.ros.lockstep import LockStep
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

RVIZ = Path(__file__).parents[2] / "ros2" / "treadline_ros2" / "rviz" / "chair.rviz"
DISPLAYS = {
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Odometry": "nav_msgs/msg/Odometry",
    "Image": "sensor_msgs/msg/Image",
    "RobotModel": "std_msgs/msg/String",
}
FLIGHT = {"stair": {"steps": 12, "slope_deg": 28}, "start": {"place": "flight", "step": 4, "heading_deg": 12}}
FLIGHT |= {"sensors": {"camera": "statistical"}, "fault": [{"kind": "operator_stop", "at_s": 0.6}]}


class FrameBuffer:
    """The newest transform of each frame, as a buffer of tf2 keeps them."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}

    def set(self, transforms: Sequence[Any]) -> None:
        for at in transforms:
            q, p = at.transform.rotation, at.transform.translation
            known = self._parents.get(at.child_frame_id, (at.header.frame_id,))
            assert known[0] == at.header.frame_id, f"{at.child_frame_id} has two parents"
            placed = at.header.frame_id, rotation_of((q.w, q.x, q.y, q.z)), np.array([p.x, p.y, p.z])
            self._parents[at.child_frame_id] = placed

    def pose(self, frame: str, of: str = "odom") -> tuple[np.ndarray, np.ndarray]:
        """Return rotation and place of a frame in another; a KeyError names the frame without a parent."""
        R, p = np.eye(3), np.zeros(3)
        while frame != of:
            frame, R_up, p_up = self._parents[frame]
            R, p = R_up @ R, R_up @ p + p_up
        return R, p


@pytest.fixture(scope="module")
def graph() -> dict[str, tuple[str, list[Any]]]:
    """Type and messages of each topic of a graph on ROS 2: on a flight, with a hold after 0.6 s."""
    scenario = Scenario.model_validate(FLIGHT)
    config = mission_config(scenario, shipped_controller(scenario.chair.model))
    blocks, plant = build_blocks(config), faulty(open_plant(scenario, 3), scenario, 3)
    graph = LockStep(plant, blocks, guard_config(config, blocks.driver.period_s), mount=config.camera)
    said: dict[str, tuple[str, list[Any]]] = {}

    def say(channel: str, signal: Any) -> None:
        for topic, kind, data in encoded(channel, signal, ros1=False):
            said.setdefault(topic, (kind, []))[1].append(message_of(kind, data))

    for channel in on.CHANNELS:
        graph.transport.subscribe(channel, lambda signal, channel=channel: say(channel, signal))
    for _ in range(120):
        graph.tick()
    plant.close()
    return said


def test_every_frame_of_every_message_leads_to_odom(graph: dict[str, tuple[str, list[Any]]]) -> None:
    buffer, frames = FrameBuffer(), set[str]()
    for topic in ("/tf_static", "/tf"):
        for message in graph[topic][1]:
            buffer.set(message.transforms)
    for topic, (_, messages) in graph.items():
        for message in messages:
            headers = [message.header] if hasattr(message, "header") else [item.header for item in getattr(message, "markers", ())]
            frames |= {header.frame_id for header in headers} - (
                {"world", "guard"} if topic in ("/truth", "/diagnostics") else set()
            )
    assert {"stair", "chair", "base_link"} <= frames
    for frame in frames - {"odom"} - {name for name in frames if name in ("guard", "camera", "driver", "heading", "seat")}:
        buffer.pose(frame)


def test_the_frame_of_the_stair_is_along_the_flight(graph: dict[str, tuple[str, list[Any]]]) -> None:
    """Test: a chair at +12° on a flight of 28°. Expected result: x of the frame up the flight, z its normal, y level."""
    buffer = FrameBuffer()
    buffer.set([at for message in graph["/tf"][1] for at in message.transforms])
    R_OS, _ = buffer.pose("stair")
    assert R_OS[2, 1] == pytest.approx(0.0, abs=1e-9)
    assert math.asin(R_OS[2, 0]) == pytest.approx(math.radians(28.0), abs=math.radians(1.0))
    R_OB, _ = buffer.pose("base_link")
    heading = graph["/stair/heading/detail"][1][-1].heading_rad
    np.testing.assert_allclose((R_OS.T @ R_OB)[:2, 0], [math.cos(heading), math.sin(heading)], atol=0.02)


def test_markers_show_stair_way_set_heading_and_hold(graph: dict[str, tuple[str, list[Any]]]) -> None:
    """Test: the markers before and during a hold. Expected result: nosings, steps' directions, sides, way and set heading; then the
    cause as a text; each message replaces the markers of the one before."""
    arrays = graph["/stair/markers"][1]
    assert all([marker.action for marker in array.markers][:1] == [DELETE_ALL] for array in arrays)
    names = [{marker.ns for marker in array.markers if marker.action == ADD} for array in arrays]
    assert {"seen", "directions", "left side", "right side", "way", "set heading"} <= names[10]
    assert "hold" not in names[10]
    (hold,) = (marker for marker in arrays[-1].markers if marker.ns == "hold")
    assert (hold.type, hold.scale.z > 0.0) == (TEXT_FACING, True)
    assert hold.text.startswith("HOLD: ")
    assert hold.pose.position.z > 1.0
    assert all(
        len(marker.points) >= 2 for array in arrays for marker in array.markers if marker.type not in (TEXT_FACING, CLEAR.kind)
    )


def test_a_drop_is_drawn_where_the_ground_ends() -> None:
    """Test: an edge 1.2 m behind the chair, turned by +10° seen from above. Expected result: a line that crosses x at -1.2 m."""
    ground = FreeGround(t_s=1.0, view="rear", blind_m=0.4, seen_m=1.2, end_m=1.2, direction_rad=math.radians(10.0))
    first, last = drop_marker(ground).points_m
    np.testing.assert_allclose(0.5 * (first + last), [-1.2, 0.0, 0.0])
    assert math.atan2(*(last - first)[:2]) == pytest.approx(-math.radians(10.0))


def test_each_quantity_has_one_topic(graph: dict[str, tuple[str, list[Any]]]) -> None:
    twins = [topic for topic in graph if topic + "/detail" in graph]
    assert twins == []


def test_every_display_of_the_rviz_file_names_a_topic_of_its_type(graph: dict[str, tuple[str, list[Any]]]) -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    manager = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]
    kinds = {topic: kind for topic, (kind, _) in graph.items()} | {"/robot_description": "std_msgs/msg/String"}
    kinds |= {topic.name: topic.kind for topic in on.CHANNELS[on.CAMERA].topics}  # the camera of this graph measures by itself
    shown = 0
    for display in manager["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            shown += 1
            assert kinds["/" + topic["Value"]] == DISPLAYS[display["Class"].partition("/")[2]]
    assert shown == 4
    assert manager["Global Options"]["Fixed Frame"] == "odom"
