"""Writer of MCAP files: its file is byte for byte the one that the ``mcap`` package writes from the same messages."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from treadline.io.mcap_writer import McapWriter

DEFAULT_LEVEL = 3
"""Compression level of the ``mcap`` package."""
METADATA = {"seed": "3", "scenario": "{}"}


def _messages(count: int, seed: int) -> list[tuple[int, int, bytes, int]]:
    """Return channel, log time, data and publish time; log times do not increase, as a late camera frame's do not."""
    rng = np.random.default_rng(seed)
    times = rng.integers(0, 10**10, (count, 2)).tolist()
    return [(int(rng.integers(1, 4)), logged, rng.bytes(int(rng.integers(0, 60))), published) for logged, published in times]


def _by_library(messages: list[tuple[int, int, bytes, int]], chunk_bytes: int) -> bytes:
    file = BytesIO()
    writer = Writer(file, chunk_size=chunk_bytes, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="ros2", library="treadline")
    writer.add_metadata("treadline", METADATA)
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    for topic in ("/a", "/b", "/c"):
        writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": topic})
    counts = [0, 0, 0, 0]
    for channel, logged, data, published in messages:
        writer.add_message(channel, logged, data, published, counts[channel])
        counts[channel] += 1
    writer.finish()
    return file.getvalue()


def _by_us(messages: list[tuple[int, int, bytes, int]], chunk_bytes: int, **more: Any) -> bytes:
    file = BytesIO()
    writer = McapWriter(file, "treadline", chunk_bytes=chunk_bytes, **more)
    writer.add_metadata("treadline", METADATA)
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    for topic in ("/a", "/b", "/c"):
        writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": topic})
    for message in messages:
        writer.add_message(*message)
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize(("count", "chunk_bytes"), [(0, 1000), (1, 1000), (1, 10**6), (300, 1000), (300, 10**6)])
def test_the_file_is_the_one_of_the_mcap_package(count: int, chunk_bytes: int) -> None:
    """Test: no message, a message that fills its chunk, many chunks, one chunk. Expected result: identical bytes."""
    messages = _messages(count, seed=count)
    assert _by_us(messages, chunk_bytes, level=DEFAULT_LEVEL) == _by_library(messages, chunk_bytes)


def test_the_index_finds_the_messages_of_a_topic_in_order_of_time() -> None:
    messages = _messages(200, seed=1)
    reader = make_reader(BytesIO(_by_us(messages, 1000)), validate_crcs=True)
    found = [message.data for _, _, message in reader.iter_messages(topics=["/b"])]
    expected = sorted((logged, k) for k, (channel, logged, _, _) in enumerate(messages) if channel == 2)
    assert found == [messages[k][2] for _, k in expected]
