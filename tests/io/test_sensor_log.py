"""Recordings of any origin as sensors: topics by type, readings in time order, implausible readings dropped and reported."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from world import imu

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import SettingsError
from treadline.core.signals import Event, HeadingMeasurement, ImuSample, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.sensor_log import SensorLog
from treadline.io.topics import parse_topics

CAMERA = PinholeCamera(width_px=6, height_px=4, fx_px=5.0, fy_px=5.5, cx_px=2.5, cy_px=1.5)
LEVEL = (1.0, 0.0, 0.0, 0.0)
STILL, WEIGHT = (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)
DEPTH = np.arange(600, 624, dtype=np.uint16).reshape(4, 6) * 2
COLOUR = np.arange(72, dtype=np.uint8).reshape(4, 6, 3)
START_NS = 1_700_000_000_123_456_789
NAMES = {
    "depth": "/camera/depth/image_raw",
    "color": "/camera/color/image_raw",
    "info": "/camera/depth/camera_info",
    "imu": "/camera/imu",
}


def fill(log: Any, *, seconds: float = 0.5, leave: tuple[str, ...] = ()) -> Any:
    """Record 100 Hz of IMU and 10 Hz of frames."""
    for tick in range(round(seconds * 100)):
        t_s = 0.01 * tick
        log.imu(NAMES["imu"], t_s, LEVEL, (0.0, 0.0, 0.001 * tick), WEIGHT)
        if tick % 10 == 0:
            if "info" not in leave:
                log.calibration(NAMES["info"], t_s, CAMERA)
            if "color" not in leave:
                log.image(NAMES["color"], t_s, COLOUR, "rgb8")
            if "depth" not in leave:
                log.image(NAMES["depth"], t_s, DEPTH, "16UC1")
    return log


def played(path: Path, **options: Any) -> tuple[SensorLog, list[Any], list[Event]]:
    log, events = SensorLog(path, **options), []
    return log, [signal for _, signal in log.arrivals(events.append)], events


def of(kind: type, signals: list[Any]) -> list[Any]:
    return [signal for signal in signals if isinstance(signal, kind)]


@pytest.mark.parametrize(("name", "ros1"), [("log.mcap", False), ("log.bag", True), ("log", False)])
def test_images_and_imu_come_back_from_every_kind_of_log(recording, tmp_path: Path, name: str, ros1: bool) -> None:
    log, signals, events = played(fill(recording(ros1=ros1)).write(tmp_path / name))
    assert {name: getattr(log.topics, name) for name in NAMES} == NAMES
    assert events == []
    frames, samples = of(RgbdFrame, signals), of(ImuSample, signals)
    assert [frame.t_s for frame in frames] == [0.0, 0.1, 0.2, 10 * 3 * 0.01, 0.4]
    np.testing.assert_allclose(frames[2].depth_m, DEPTH / 1000.0, rtol=1e-6)
    np.testing.assert_array_equal(frames[2].rgb, COLOUR)
    assert frames[2].camera == CAMERA
    # Whole ticks come back as the very numbers that a mission counts.
    assert [sample.t_s for sample in samples] == [0.01 * k for k in range(50)]
    np.testing.assert_array_equal(samples[7].angular_velocity_rad_s, [0.0, 0.0, 0.007])
    np.testing.assert_array_equal(samples[7].orientation, LEVEL)


def test_readings_of_our_own_logs_are_due_at_their_arrival_and_of_others_at_their_stamp(tmp_path: Path) -> None:
    """Test: a heading of 0.02 s that taken at 0.05 s. Expected: due at 0.05 s; at its stamp in the log of another recorder."""
    path = tmp_path / "log.mcap"
    with RunLog(path) as log:
        for k in range(8):
            t_s = 0.01 * k
            log(imu(t_s), t_s)
            if k == 5:
                log(HeadingMeasurement(t_s=0.02, heading_rad=0.1, sigma_rad=0.01, edge_count=3), t_s)
    due = list(SensorLog(path).arrivals(lambda _: None))
    assert [due_s for due_s, _ in due] == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.05, 0.06, 0.07], abs=1e-9)
    assert [(place, signal.t_s) for place, (_, signal) in enumerate(due) if isinstance(signal, HeadingMeasurement)] == [(6, 0.02)]

    foreign = tmp_path / "foreign.mcap"
    with path.open("rb") as file, foreign.open("wb") as out:
        copied(file, out)
    due = list(SensorLog(foreign).arrivals(lambda _: None))
    assert [(place, due_s) for place, (due_s, signal) in enumerate(due) if isinstance(signal, HeadingMeasurement)] == [(3, 0.02)]


def copied(file: IO[bytes], out: IO[bytes], others: Mapping[str, str] = MappingProxyType({})) -> None:
    """Copy a log as another recorder would write it: another name in the header, and messages of topics that are not of ROS."""
    writer = Writer(out)
    writer.start(profile="ros2", library="another recorder")
    for name, kind in others.items():
        schema = writer.register_schema(kind, "protobuf", b"") if kind else 0
        writer.add_message(writer.register_channel(name, "protobuf" if kind else "json", schema), START_NS, b"{}", START_NS)
    channels: dict[int, int] = {}
    for schema, channel, message in make_reader(file).iter_messages():
        if channel.id not in channels:
            kind = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, kind)
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
    writer.finish()


@pytest.mark.parametrize(
    ("pixels", "encoding"),
    [
        (COLOUR[:, :, ::-1], "bgr8"),
        (np.dstack([COLOUR, COLOUR[:, :, :1]]), "rgba8"),
        (np.dstack([COLOUR[:, :, ::-1], COLOUR[:, :, :1]]), "bgra8"),
    ],
)
def test_colour_is_colour_whatever_its_encoding(recording, tmp_path: Path, pixels: np.ndarray, encoding: str) -> None:
    log = fill(recording(), seconds=0.01, leave=("color",))
    log.image(NAMES["color"], 0.0, pixels, encoding, pad=5)
    (frame,) = of(RgbdFrame, played(log.write(tmp_path / "log.mcap"))[1])
    np.testing.assert_array_equal(frame.rgb, COLOUR)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("encoding", "kind", "unit", "beyond"), [("16UC1", "u2", 1, 65535), ("32FC1", "f4", 1000, np.inf)])
def test_depth_in_metres_or_millimetres_of_either_byte_order_is_the_same(
    recording, tmp_path: Path, order: str, encoding: str, kind: str, unit: int, beyond: float
) -> None:
    pixels = (DEPTH / unit).astype(order + kind)
    pixels[0, 0], pixels[3, 5] = 0, beyond
    log = fill(recording(), seconds=0.01, leave=("depth",))
    log.image(NAMES["depth"], 0.0, pixels, encoding, pad=8)
    (frame,) = of(RgbdFrame, played(log.write(tmp_path / "log.mcap"))[1])
    assert np.flatnonzero(~np.isfinite(frame.depth_m)).tolist() == [0, 23]
    np.testing.assert_allclose(frame.depth_m.ravel()[1:23], DEPTH.ravel()[1:23] / 1000.0, rtol=1e-6)


def test_stamps_that_were_never_set_are_the_time_of_logging(recording, tmp_path: Path) -> None:
    log = recording()
    for tick in range(5):
        log.imu(NAMES["imu"], 0.0, LEVEL, STILL, WEIGHT, logged_s=0.01 * tick, origin_ns=0)
        log.calibration(NAMES["info"], 0.0, CAMERA, logged_s=0.01 * tick, origin_ns=0)
        log.image(NAMES["depth"], 0.0, DEPTH, "16UC1", logged_s=0.01 * tick, origin_ns=0)
    _, signals, events = played(log.write(tmp_path / "log.mcap"))
    assert [sample.t_s for sample in of(ImuSample, signals)] == [0.01 * k for k in range(5)]
    assert len(of(RgbdFrame, signals)) == 5
    assert events == []


def test_given_intrinsics_stand_in_for_those_of_the_log(recording, tmp_path: Path) -> None:
    path = fill(recording(), leave=("info",)).write(tmp_path / "log.mcap")
    frames = of(RgbdFrame, played(path, calibrate=lambda _, size: CAMERA if size else None)[1])
    assert [frame.camera for frame in frames] == [CAMERA] * 5


def test_messages_that_are_not_ros_are_left_alone(recording, tmp_path: Path) -> None:
    log, path = fill(recording(), seconds=0.1), tmp_path / "log.mcap"
    log.write(tmp_path / "ros.mcap")
    with (tmp_path / "ros.mcap").open("rb") as file, path.open("wb") as out:
        copied(file, out, {"/points": "foxglove.PointCloud", "/note": ""})
    sensors, signals, _ = played(path)
    assert set(sensors.found) == {*NAMES.values(), "/points", "/note"}
    assert len(of(ImuSample, signals)) == 10


@pytest.mark.parametrize("text", ["depth", "depth=", "sonar=/a", "imu=/a,imu=/b", ""])
def test_topics_are_named_by_role(text: str) -> None:
    with pytest.raises(SettingsError, match="--topics"):
        parse_topics(text)
    assert parse_topics("depth=/a, imu=/b") == {"depth": "/a", "imu": "/b"}


def test_a_long_log_is_read_a_second_ahead(tmp_path: Path) -> None:
    ahead: list[TrackCommand] = []
    with RunLog(tmp_path / "log.mcap") as log:
        for k in range(500):
            log(imu(0.01 * k), 0.01 * k)
            log(HeadingMeasurement(t_s=0.01 * k, heading_rad=0.1, sigma_rad=0.01, edge_count=3), 0.01 * k)
            log(TrackCommand(t_s=0.01 * k, left_m_s=0.1, right_m_s=0.1), 0.01 * k)
    early_s = [ahead[-1].t_s - due_s for due_s, _ in SensorLog(tmp_path / "log.mcap").arrivals(ahead.append) if due_s < 3.9]
    assert max(early_s) == pytest.approx(1.0, abs=0.02)
