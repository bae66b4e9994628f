"""What nodes tell each other comes back from the wire as it was, in ROS 1's bytes and in ROS 2's."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from world import stair

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.signals import (
    Event,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on
from treadline.ros._codec import Decoder, encoded
from treadline.ros._node_signals import Beat, Clock, GuardState, Mounts, VelocityCommand

T_S = 12.34
CAMERA = PinholeCamera(
    width_px=8, height_px=6, fx_px=7.0, fy_px=7.5, cx_px=3.5, cy_px=2.5, mount_pitch_rad=0.4, mount_m=(0.1, 0.0, 0.9)
)
DEPTH = np.linspace(0.5, 3.0, 48, dtype=np.float32).reshape(6, 8)
DEPTH[2, 3] = np.nan
PLACES_B = [(-0.1, 0.0, 0.01), (-0.4, 0.001, -0.17)]
SIDES_M = {"right_wall_m": 0.6, "left_seen_m": -0.1, "right_seen_m": 0.55}
MAP = stair(T_S, PLACES_B, direction="down", rise_m=0.17, slope_rad=0.5, ends=True, **SIDES_M)
SIGNALS = [
    (on.CLOCK, Clock(t_s=T_S)),
    (on.TWIST, VelocityCommand(speed_m_s=0.2, turn_rad_s=-0.1)),
    (
        on.ODOM,
        Odometry(
            t_s=T_S,
            p_OB=np.array([1.0, -2.0, 0.5]),
            orientation=np.array([0.8, 0.0, -0.6, 0.0]),
            speed_m_s=0.2,
            angular_velocity_rad_s=np.array([0.1, 0.2, 0.3]),
        ),
    ),
    (
        on.IMU,
        ImuSample(
            t_s=T_S,
            orientation=np.array([0.9, 0.1, 0.2, 0.3]),
            angular_velocity_rad_s=np.array([0.1, np.nan, 3.0]),
            linear_acceleration_m_s2=np.array([1.0, 2.0, 9.8]),
        ),
    ),
    (on.TRACKS, TrackReading(t_s=T_S, left_m_s=0.1, right_m_s=-0.2, brake_on=True)),
    (on.SEAT, SeatReading(t_s=T_S, pitch_rad=0.1, stroke_m=0.2)),
    (on.FLIPPER, FlipperReading(t_s=T_S, angle_rad=0.3, torque_n_m=-40.0)),
    (on.OPERATOR, OperatorInput(t_s=T_S, dead_man=True, stop=False, rearm=True)),
    (on.CAMERA, RgbdFrame(t_s=T_S, rgb=np.arange(144, dtype=np.uint8).reshape(6, 8, 3), depth_m=DEPTH, camera=CAMERA)),
    (on.CAMERA_HEADING, HeadingMeasurement(t_s=T_S, heading_rad=0.1, sigma_rad=0.01, edge_count=4)),
    (on.CAMERA_MAP, MAP),
    (on.CAMERA_QUALITY, FrameQuality(t_s=T_S, fingerprint=4294967295, brightness=0.5, contrast=0.1, valid_share=0.9)),
    (on.QUALITY, FrameQuality(t_s=T_S, fingerprint=1, brightness=0.5, contrast=0.1, valid_share=0.9)),
    (on.QUALITY, FrameQuality(t_s=T_S, fingerprint=1, brightness=0.5, contrast=0.1, valid_share=0.9, obstacle_m=1.25)),
    (on.MEASURED, HeadingMeasurement(t_s=T_S, heading_rad=-0.1, sigma_rad=0.02, edge_count=5, correction_rad=0.03)),
    (on.MAP, MAP),
    (on.ESTIMATE, HeadingEstimate(t_s=T_S, heading_rad=0.1, heading_rate_rad_s=0.2, sigma_rad=0.3, source="gyro")),
    (
        on.HEALTH,
        HeadingHealth(
            t_s=T_S,
            fault="jump",
            since_s=1.25,
            cause="by 5°",
            disagreement_rad=0.1,
            unseen_s=0.2,
            bias_rad_s=1e-3,
            scale=1.01,
            walk_rad_rts=1e-4,
        ),
    ),
    (on.PLAN, MotionPlan(t_s=T_S, phase="climb", speed_m_s=0.2, cause="traction tried")),
    (
        on.PLAN,
        MotionPlan(
            t_s=T_S,
            phase="crest",
            speed_m_s=-0.1,
            turn_m_s=0.05,
            heading_rad=0.1,
            pitch_feedforward_m_s=-0.1 + 0.003,
            flipper=FlipperCommand(t_s=T_S, rate_rad_s=0.1 + 0.2),
            needs_stair=False,
            cause="Kuppe",
            hold="knows no further",
        ),
    ),
    (on.TRACKS_PROPOSED, TrackCommand(t_s=T_S, left_m_s=0.1, right_m_s=0.2)),
    (on.TRACKS_CMD, TrackCommand.stop(T_S)),
    (on.SEAT_PROPOSED, SeatCommand(t_s=T_S, rate_m_s=0.01)),
    (on.SEAT_CMD, SeatCommand(t_s=T_S, rate_m_s=-0.01)),
    (on.FLIPPER_CMD, FlipperCommand(t_s=T_S, rate_rad_s=0.3)),
    (on.GUARD, GuardState(t_s=T_S, holding=None)),
    (on.GUARD, GuardState(t_s=T_S, holding="slip 0.40")),
    (on.DIAGNOSTICS, Beat(t_s=T_S, node="camera")),
    (on.DIAGNOSTICS, Event(t_s=T_S, name="hold", cause="slip 0.40")),
]


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
