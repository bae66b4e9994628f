"""Messages of a scene: the definitions are those of ROS 2, and other decoders read what was written."""

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from wires import decoded

from treadline.io.mcap_log import KEPT, RunLog
from treadline.io.message_types import RosMessage, store
from treadline.io.scene_messages import (
    FramePose,
    Marker,
    compressed_message,
    frames_message,
    markers_message,
    odometry_message,
    text_message,
)

# Literals, so that a changed value in the code is detected here.
LINE_LIST = 5
TRIANGLE_LIST = 11

POINTS = np.arange(18, dtype=float).reshape(6, 3)
POSE = FramePose(parent="odom", child="base_link", place_m=(1.0, 2.0, 3.0), quaternion=np.array([0.5, 0.5, -0.5, 0.5]))
MARKERS = [
    Marker(frame="seat", name="cushion", number=2, kind=TRIANGLE_LIST, points_m=POINTS, rgba=(0.25, 0.5, 0.75, 1.0)),
    Marker(frame="chair", name="seen", number=0, kind=LINE_LIST, points_m=POINTS[:2], rgba=(0.0, 1.0, 0.0, 0.5), width_m=0.02),
    Marker(frame="chair", name="seen", number=1, kind=LINE_LIST, points_m=POINTS[:0], rgba=(0.0, 1.0, 0.0, 0.5), width_m=0.02),
]
MESSAGES = [
    frames_message("/tf_static", 0.25, [POSE]),
    odometry_message("/odom", 0.25, POSE, 0.2, (0.1, 0.2, 0.3)),
    markers_message("/chair", 0.25, MARKERS),
    text_message("/robot_description", "<robot/>"),
    compressed_message("/camera/overlay/compressed", 0.25, "camera_optical_frame", b"\xff\xd8jpeg"),
]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    with RunLog(tmp_path / "log.mcap", metadata={"seed": "3"}) as log:
        log.add(MESSAGES, 0.25)
    return tmp_path / "log.mcap"


def test_a_decoder_of_ros_2_reads_frames_markers_and_images(log: Path) -> None:
    read = {topic: messages[-1] for topic, messages in decoded(log).items()}
    with log.open("rb") as file:
        assert [(item.name, item.metadata) for item in make_reader(file).iter_metadata()] == [("treadline", {"seed": "3"})]
    (moved,) = read["/tf_static"].transforms
    assert (moved.header.frame_id, moved.child_frame_id, moved.transform.translation.z) == ("odom", "base_link", 3.0)
    assert (moved.transform.rotation.w, moved.transform.rotation.y) == (0.5, -0.5)
    assert read["/odom"].twist.twist.angular.z == 0.3
    cushion, seen, empty = read["/chair"].markers
    assert (cushion.header.frame_id, cushion.ns, cushion.id, cushion.type, cushion.frame_locked) == ("seat", "cushion", 2, 11, True)
    assert [(point.x, point.y, point.z) for point in cushion.points] == [tuple(row) for row in POINTS.tolist()]
    assert (cushion.color.r, cushion.color.a, cushion.scale.z, cushion.pose.orientation.w) == (0.25, 1.0, 1.0, 1.0)
    assert (seen.type, seen.scale.x, seen.color.a, len(seen.points), len(empty.points)) == (5, 0.02, 0.5, 2, 0)
    assert read["/robot_description"].data == "<robot/>"
    assert bytes(read["/camera/overlay/compressed"].data) == b"\xff\xd8jpeg"


@pytest.mark.parametrize("kind", [message.kind for message in MESSAGES])
def test_definitions_are_those_of_ros_2(kind: str) -> None:
    """Test: the definitions in a log, against those of ROS 2 Humble, whose logs are read too."""
    humble = get_typestore(Stores.ROS2_HUMBLE)
    for name, (_, members) in get_types_from_msg(store().generate_msgdef(kind, ros_version=2)[0], kind).items():
        assert members == humble.fielddefs[name][1], name


def test_a_player_keeps_what_is_published_once(log: Path) -> None:
    with AnyReader([log]) as reader:
        profiles = {item.topic: [qos.durability.name for qos in item.ext.offered_qos_profiles] for item in reader.connections}
    assert profiles == {message.topic: ["TRANSIENT_LOCAL"] if message.topic in KEPT else [] for message in MESSAGES}


@pytest.mark.parametrize("lengths", [(0, 0), (1, 0), (2, 3)])
def test_a_message_is_as_rosbags_writes_it(lengths: tuple[int, int]) -> None:
    """Test: texts whose lengths need padding before numbers, empty sequences, sequences of texts; against rosbags' own encoder."""
    names, numbers = ["a", "bcdef"][: lengths[0]], [0.5, -2.0, 7.0][: lengths[1]]
    values = (12, 34, "abc", len(names), *names, len(numbers), *numbers, 0, 0)
    data = RosMessage("/any", "sensor_msgs/msg/JointState", values, (len(names), len(numbers), 0, 0)).encoded()
    store = get_typestore(Stores.ROS2_HUMBLE)
    message = store.deserialize_cdr(data, "sensor_msgs/msg/JointState")
    assert (message.header.stamp.nanosec, message.header.frame_id, message.name) == (34, "abc", names)
    assert message.position.tolist() == numbers
    assert bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState")) == data


def test_a_message_asks_for_as_many_values_as_it_has() -> None:
    with pytest.raises(struct.error):
        RosMessage("/any", "builtin_interfaces/msg/Time", (1,)).encoded()
