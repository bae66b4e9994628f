"""The messages of nodes, beyond ``test_transport_contract``: an independent encoder, frames, stamps, words that are not known."""

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from node_messages import CAMERA, DEPTH, SIGNALS, T_S

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.signals import HeadingFault, OperatorInput, Phase, Source, VelocityCommand, View
from treadline.io.message_types import message_of, store
from treadline.io.messages import joints
from treadline.ros import channels as on
from treadline.ros._codec import Decoder, encoded, messages_on


def test_a_handset_without_the_two_answers_is_still_heard() -> None:
    """Test: a JointState of dead-man switch, stop and re-arm alone, as handsets sent before. Expected: no answer is pressed."""
    message = joints(on.OPERATOR, T_S, ("dead_man", "stop", "rearm"), (1.0, 0.0, 1.0), (), "operator")
    found = Decoder(on.OPERATOR, ros1=True).signal(message.topic, message.encoded(ros1=True))
    assert found == OperatorInput(t_s=T_S, dead_man=True, rearm=True)


def test_a_velocity_stamped_zero_has_no_stamp() -> None:
    """Test: a TwistStamped with a stamp of zero, as ``ros2 topic pub`` sends it. Expected: no time; the guard takes it as now."""
    ((topic, _, data),) = encoded(on.TWIST, VelocityCommand(t_s=0.0, speed_m_s=0.2, turn_rad_s=0.1), ros1=False)
    found = Decoder(on.TWIST, ros1=False).signal(topic, data)
    assert (math.isnan(found.t_s), found.speed_m_s, found.turn_rad_s) == (True, 0.2, 0.1)


@pytest.mark.parametrize("ros1", [True, False], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize(("channel", "signal"), [*SIGNALS, (on.MOUNTS, on.Mounts(t_s=T_S, camera=CAMERA))])
def test_rosbags_writes_the_same_bytes(channel: str, signal: Any, *, ros1: bool) -> None:
    """An independent encoder of the same definitions gives each message to its last byte."""
    messages = messages_on(channel, signal, ros1=ros1)
    assert [(message.topic, message.kind) for message in messages] == [
        (topic.name, topic.kind_of(ros1=ros1)) for topic in on.CHANNELS[channel].topics_of(ros1=ros1)
    ]
    for message in messages:
        of, write = store(ros1=ros1), f"serialize_{'ros1' if ros1 else 'cdr'}"
        data = message.encoded(ros1=ros1)
        assert bytes(getattr(of, write)(message_of(message.kind, data, ros1=ros1), message.kind)) == data


def test_images_are_in_the_optical_frame_of_the_urdf_and_in_ros_1_in_that_of_the_paper() -> None:
    """Test: a frame of the front camera, and one of a camera turned by 180°. Expected: the frame of each in the URDF, "camera" in
    ROS 1."""
    for turned_rad, name in ((0.0, "camera_optical_frame"), (math.pi, "rear_camera_optical_frame")):
        rgb = np.zeros((6, 8, 3), np.uint8)
        frame = RgbdFrame(t_s=T_S, rgb=rgb, depth_m=DEPTH, camera=replace(CAMERA, mount_yaw_rad=turned_rad))
        for ros1, expected in ((False, name), (True, "camera")):
            sent = encoded(on.CAMERA, frame, ros1=ros1)
            assert {message_of(kind, data, ros1=ros1).header.frame_id for _, kind, data in sent} == {expected}


@pytest.mark.parametrize(
    ("channel", "word", "other", "known"),
    [
        (on.PLAN, b"climb", b"chute", "search, align"),
        (on.MAP, b"down", b"left", "up, down"),
        (on.ESTIMATE, b"gyro", b"nose", "vision, gyro"),
    ],
)
def test_a_word_that_treadline_does_not_know_is_refused(channel: str, word: bytes, other: bytes, known: str) -> None:
    """Test: a phase, a direction, a source of another make in ROS 1. Expected result: a line that says what is known."""
    signal = next(signal for name, signal in SIGNALS if name == channel)
    decoder = Decoder(channel, ros1=True)
    topic, _, data = next(message for message in encoded(channel, signal, ros1=True) if word in message[2])
    with pytest.raises(LogFormatError, match=f"unknown value '{other.decode()}'; known: {known}"):
        decoder.signal(topic, data.replace(word, other))


def test_a_message_has_a_number_for_each_word_and_refuses_others() -> None:
    """Test: constants of the messages against the words of the signals; a heading whose source, its last byte, is 9."""
    of = {"MotionPlan": Phase, "HeadingHealth": HeadingFault, "StairHeading": Source, "FreeGround": View}
    for name, words in of.items():
        constants, _ = store().fielddefs[f"treadline_msgs/msg/{name}"]
        assert [word.partition("_")[2].lower() for word, _, number in constants if number] == list(get_args(words))
    topic, _, data = encoded(on.ESTIMATE, next(signal for name, signal in SIGNALS if name == on.ESTIMATE), ros1=False)[-1]
    with pytest.raises(LogFormatError, match="unknown value 9; known: 1 vision, 2 gyro"):
        Decoder(on.ESTIMATE, ros1=False).signal(topic, data[:-1] + b"\x09")
