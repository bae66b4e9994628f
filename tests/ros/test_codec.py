"""What nodes tell each other comes back from the wire as it was, in ROS 1's bytes and in ROS 2's."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from node_messages import CAMERA, DEPTH, SIGNALS, T_S

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.signals import OperatorInput
from treadline.io.messages import joints
from treadline.ros import channels as on
from treadline.ros._codec import Decoder, encoded
from treadline.ros._node_signals import Mounts


@pytest.mark.parametrize("ros1", [True, False], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize(("channel", "signal"), SIGNALS, ids=[f"{channel} {type(signal).__name__}" for channel, signal in SIGNALS])
def test_a_signal_comes_back_as_it_was(channel: str, signal: Any, *, ros1: bool) -> None:
    read = {topic.name for topic in on.CHANNELS[channel].topics if topic.read}
    decoder = Decoder(channel, ros1=ros1, mount=CAMERA)
    messages = encoded(channel, signal, ros1=ros1)
    assert [(topic, kind) for topic, kind, _ in messages] == [(topic.name, topic.kind) for topic in on.CHANNELS[channel].topics]
    back = [decoder.signal(topic, data) for topic, _, data in messages if topic in read][-1]
    assert type(back) is type(signal)
    for field in fields(signal):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(signal, field.name))


def test_a_handset_without_the_two_answers_is_still_heard() -> None:
    """Test: a JointState of dead-man switch, stop and re-arm alone, as handsets sent before. Expected: no answer is pressed."""
    topic, _, data = joints(on.OPERATOR, T_S, ("dead_man", "stop", "rearm"), (1.0, 0.0, 1.0), (), "operator")
    assert Decoder(on.OPERATOR, ros1=False).signal(topic, data) == OperatorInput(t_s=T_S, dead_man=True, rearm=True)


@pytest.mark.parametrize("ros1", [True, False], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize(
    ("channel", "signal"),
    [*SIGNALS, (on.MOUNTS, Mounts(t_s=T_S, camera=CAMERA))],
    ids=[*(f"{channel} {type(signal).__name__}" for channel, signal in SIGNALS), "where sensors sit"],
)
def test_rosbags_reads_the_same_bytes(channel: str, signal: Any, *, ros1: bool) -> None:
    """An independent codec reads each message to its last byte."""
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is an extra")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_JAZZY)
    if ros1:  # not in rosbags' set of ROS 1's
        store.register(typesys.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", on.FRAMES))
    for _, kind, data in encoded(channel, signal, ros1=ros1):
        message = store.deserialize_ros1(data, kind) if ros1 else store.deserialize_cdr(data, kind)
        again = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
        assert bytes(again)[4 * (not ros1) :] == data[4 * (not ros1) :]


@pytest.mark.parametrize(
    ("channel", "word", "other", "known"),
    [
        (on.PLAN, b"climb", b"chute", "search, align"),
        (on.MAP, b"down", b"left", "up, down"),
        (on.ESTIMATE, b"gyro", b"nose", "vision, gyro"),
    ],
)
def test_a_word_that_treadline_does_not_know_is_refused(channel: str, word: bytes, other: bytes, known: str) -> None:
    """Test: a phase, a direction, a source of another make. Expected result: a line that says what is known."""
    signal = next(signal for name, signal in SIGNALS if name == channel)
    decoder = Decoder(channel, ros1=False)
    topic, _, data = next(message for message in encoded(channel, signal, ros1=False) if word in message[2])
    with pytest.raises(LogFormatError, match=f"unknown value '{other.decode()}'; known: {known}"):
        decoder.signal(topic, data.replace(word, other))


@pytest.mark.parametrize("ahead", [0, 1], ids=["colour ahead", "depth ahead"])
def test_images_meet_though_one_topic_is_frames_ahead_of_the_other(ahead: int) -> None:
    decoder = Decoder(on.CAMERA, ros1=True)
    rgb = np.zeros((6, 8, 3), np.uint8)
    sent = [encoded(on.CAMERA, RgbdFrame(t_s=0.1 * k, rgb=rgb + k, depth_m=DEPTH, camera=CAMERA), ros1=True) for k in range(6)]
    topic, _, info = sent[0][2]
    assert decoder.signal(topic, info) is None
    order = [sent[k][ahead] for k in range(4)] + [sent[k][1 - ahead] for k in range(6)] + [sent[k][ahead] for k in (4, 5)]
    came = [decoder.signal(topic, data) for topic, _, data in order]
    frames = [frame for frame in came if frame is not None]
    assert [round(10.0 * frame.t_s) for frame in frames] == [0, 1, 2, 3, 4, 5]
    assert [int(frame.rgb[0, 0, 0]) for frame in frames] == [0, 1, 2, 3, 4, 5]
