"""A bag in MCAP with rclpy's own bytes, as ``ros2 bag record -s mcap`` writes it, is replayed to the same headings."""

import importlib
import subprocess
import sys
from pathlib import Path

from processes import SHORT_FLIGHT
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer

from treadline.io.mcap_read import mcap_messages
from treadline.io.message_types import store


def treadline(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "treadline", *map(str, words)], check=True, capture_output=True)


def test_a_bag_in_mcap_is_replayed_to_the_same_headings(tmp_path: Path) -> None:
    """Test: a log of 2.5 s on a flight, images and all, each message read and written anew by rclpy. Expected result: the replay of
    the bag has the same series to the last digit."""
    (tmp_path / "short.toml").write_text(SHORT_FLIGHT)
    log, bag = tmp_path / "run" / "log.mcap", tmp_path / "bag"
    treadline("nodes", tmp_path / "short.toml", "--duration", "2.5", "--out", log.parent)
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections, classes = {}, {}
        for topic, logged_ns, data in mcap_messages(log, lambda _: True, sealed=True):
            if topic.name not in connections:
                connections[topic.name] = writer.add_connection(topic.name, topic.kind, typestore=store())
                package, _, name = topic.kind.split("/")
                classes[topic.name] = getattr(importlib.import_module(f"{package}.msg"), name)
            message = deserialize_message(data, classes[topic.name])
            writer.write(connections[topic.name], logged_ns, serialize_message(message))
    assert len(connections) > 10
    for source, out in ((log, "first"), (bag, "again")):
        treadline("replay", source, "--out", tmp_path / out)
    first, again = ((tmp_path / out / "series.csv").read_bytes() for out in ("first", "again"))
    assert len(first.splitlines()) > 20
    assert again == first
