"""Message types on the wire and in logs are those of ROS 2: the hashes that rclpy compares, for every topic of the graph."""

import importlib
from collections.abc import Callable
from typing import Any

from rclpy.serialization import deserialize_message
from treadline_msgs.msg import BeltCommand

from treadline.core.signals import TrackCommand
from treadline.io.message_types import store
from treadline.ros import channels as on
from treadline.ros._codec import encoded

KINDS = sorted(
    {topic.kind for channel in on.CHANNELS.values() for topic in channel.topics_of(ros1=False)} - {"tf2_msgs/msg/TFMessage"}
)
"""Types of the graph; of tf2_msgs the test environment has one message, made for it."""


def test_each_type_has_the_hash_that_ros_2_gives_it(watching: Callable[[], Any]) -> None:
    bystander, found = watching(), {}
    for kind in KINDS:
        package, _, name = kind.split("/")
        topic = name.lower()
        bystander.node.create_publisher(getattr(importlib.import_module(f"{package}.msg"), name), topic, 1)
        bystander.until(lambda topic=topic: bystander.node.get_publishers_info_by_topic(topic), topic)
        digest = bystander.node.get_publishers_info_by_topic(topic)[0].topic_type_hash
        found[kind] = f"RIHS{digest.version:02d}_{bytes(digest.value).hex()}"
    assert len(found) > 20
    assert found == {kind: store().hash_rihs01(kind) for kind in KINDS}


def test_rclpy_reads_our_bytes() -> None:
    ((_, _, data),) = encoded(on.TRACKS_CMD, TrackCommand(t_s=1.5, left_m_s=0.1, right_m_s=-0.2, sender="guard-1"), ros1=False)
    command = deserialize_message(data, BeltCommand)
    assert (command.left_m_s, command.right_m_s, command.brake, command.sender) == (0.1, -0.2, False, "guard-1")
    assert (command.header.stamp.sec, command.header.stamp.nanosec, command.header.frame_id) == (1, 500_000_000, "base_link")
