"""No bytes on any topic end a node: a broken message is dropped and counted, and the first of a series is reported."""

from typing import Any

import numpy as np
import pytest
from mutations import mutated_bytes
from node_messages import SIGNALS, T_S
from wires import Air
from world import limits

from treadline.core.errors import LogFormatError
from treadline.core.signals import Event
from treadline.mission.mission_config import MissionConfig
from treadline.mission.replay_plant import ReplayPlant
from treadline.ros import channels as on
from treadline.ros._codec import Decoder, encoded
from treadline.ros.assembly import node_of
from treadline.ros.block_nodes import GuardNode
from treadline.ros.node_process import NodeRunner
from treadline.scenario.chair import read_chair

COUNT = 1000
"""Mutated messages of each channel and wire."""


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a message overwritten as files are, or with a part of it left out or put in."""
    at, left_out = int(rng.integers(len(data))), int(rng.integers(9))
    return mutated_bytes(data, rng) if rng.random() < 0.7 else data[:at] + rng.bytes(int(rng.integers(9))) + data[at + left_out :]


@pytest.mark.parametrize("ros1", [True, False], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize(("channel", "signal"), SIGNALS, ids=[f"{channel} {type(signal).__name__}" for channel, signal in SIGNALS])
def test_mutated_bytes_are_a_signal_or_a_format_error(channel: str, signal: Any, *, ros1: bool) -> None:
    rng = np.random.default_rng(39)
    decoder = Decoder(channel, ros1=ros1)
    read = {topic.name for topic in on.CHANNELS[channel].topics_of(ros1=ros1) if topic.read}
    messages = [(topic, data) for topic, _, data in encoded(channel, signal, ros1=ros1) if topic in read]
    broken = 0
    for k in range(COUNT):
        topic, data = messages[k % len(messages)]
        try:
            decoder.signal(topic, mutated(data, rng))
        except LogFormatError:
            broken += 1
    assert broken > 0.05 * COUNT


@pytest.mark.parametrize("name", ["guard", "camera", "heading", "seat", "driver", "plant"])
def test_no_mutated_message_ends_a_node(name: str) -> None:
    """Test: 100 mutations of each message reach a node, whatever they still say. Expected result: it goes on."""
    rng = np.random.default_rng(39)
    wire, config = Air(), MissionConfig(chair=read_chair("wheelchair"), loop="open")
    node = node_of(name, config, plant=lambda: ReplayPlant([]))
    node.listen(wire)
    for k in range(100):
        node.advance(T_S + 0.01 * k)
        for channel, signal in SIGNALS:
            if channel == on.CAMERA:
                continue  # images are of any size, and take long
            for topic, _, data in encoded(channel, signal, ros1=False):
                if topic in wire.topics:
                    wire.inbox.put(topic, mutated(data, rng))
        while wire.deliver(0.0):
            pass
        node.tick(T_S + 0.01 * k)
    assert sum(wire.broken.values()) > 10


def test_a_programming_error_in_a_reader_is_not_taken_for_a_broken_message() -> None:
    decoder = Decoder(on.SEAT, ros1=False)
    with pytest.raises(TypeError):
        decoder.signal("/seat/state", None)  # type: ignore[arg-type]


def test_broken_messages_are_counted_and_the_first_of_a_series_is_reported() -> None:
    """Test: the guard's node gets 3 messages whose sender is no text (GUARD §1, hole 2), a sound one, a broken one. Expected
    result: the node goes on, 4 are counted, and two events say which topic."""
    wire = Air()
    runner = NodeRunner(GuardNode(limits()), wire)
    command = next(signal for channel, signal in SIGNALS if channel == on.TRACKS_PROPOSED)
    ((topic, _, data),) = encoded(on.TRACKS_PROPOSED, command, ros1=False)
    broken = data.replace(b"chair", b"\xff\xff\xff\xff\xff")
    for message in (broken, broken, broken, data, broken):
        wire.inbox.put(topic, message)
        assert wire.deliver(0.0) == 1
    runner.beat(1.0)
    assert wire.broken == {topic: 4}
    events = [signal for channel, signal in wire.sent if channel == on.DIAGNOSTICS and isinstance(signal, Event)]
    assert [event.name for event in events] == ["dropped", "dropped"]
    assert events[0].cause.startswith(f"guard: {topic}: ")
