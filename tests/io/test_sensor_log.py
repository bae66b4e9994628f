"""Recordings of any origin as sensors: topics by type, readings in time order, implausible readings dropped and reported."""

from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from world import imu

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError, LogFormatError, SettingsError, TreadlineError
from treadline.core.signals import Event, HeadingMeasurement, ImuSample
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
        if "imu" not in leave:
            log.imu(NAMES["imu"], t_s, LEVEL, (0.0, 0.0, 0.001 * tick), WEIGHT)
        if tick % 10 == 0:
            if "info" not in leave:
                log.calibration(NAMES["info"], t_s, CAMERA)
            if "color" not in leave:
                log.image(NAMES["color"], t_s, COLOUR, "rgb8")
            if "depth" not in leave:
                log.image(NAMES["depth"], t_s, DEPTH, "16UC1")
    return log


def played(log: SensorLog) -> tuple[list[Any], list[Event]]:
    events: list[Event] = []
    return [signal for _, signal in log.arrivals(events.append)], events


def of(kind: type, signals: list[Any]) -> list[Any]:
    return [signal for signal in signals if isinstance(signal, kind)]


@pytest.mark.parametrize(("name", "ros1"), [("log.mcap", False), ("log.bag", True), ("log", False)])
def test_images_and_imu_come_back_from_every_kind_of_log(recording, tmp_path: Path, name: str, ros1: bool) -> None:
    log = SensorLog(fill(recording(ros1=ros1)).write(tmp_path / name))
    assert vars_of(log) == NAMES
    signals, events = played(log)
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


def copied(file: IO[bytes], out: IO[bytes]) -> None:
    """Copy a log as another recorder would write it: same messages, another name in the header."""
    writer = Writer(out)
    writer.start(profile="ros2", library="another recorder")
    channels: dict[int, int] = {}
    for schema, channel, message in make_reader(file).iter_messages():
        if channel.id not in channels:
            kind = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, kind)
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
    writer.finish()


def vars_of(log: SensorLog) -> dict[str, str | None]:
    return {name: getattr(log.topics, name) for name in NAMES}


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
    (frame,) = of(RgbdFrame, played(SensorLog(log.write(tmp_path / "log.mcap")))[0])
    np.testing.assert_array_equal(frame.rgb, COLOUR)


@pytest.mark.parametrize("order", ["<", ">"])
def test_depth_in_metres_or_millimetres_of_either_byte_order_is_the_same(recording, tmp_path: Path, order: str) -> None:
    holes = DEPTH.copy()
    holes[0, 0], holes[3, 5] = 0, 65535
    metres = (DEPTH / 1000.0).astype(f"{order}f4")
    metres[0, 0], metres[3, 5] = 0.0, np.inf
    for pixels, encoding in ((holes.astype(f"{order}u2"), "16UC1"), (metres, "32FC1")):
        log = fill(recording(), seconds=0.01, leave=("depth",))
        log.image(NAMES["depth"], 0.0, pixels, encoding, pad=8)
        (frame,) = of(RgbdFrame, played(SensorLog(log.write(tmp_path / f"{encoding}.mcap")))[0])
        seen = np.isfinite(frame.depth_m)
        assert not seen[0, 0]
        assert not seen[3, 5]
        assert seen.sum() == 22
        np.testing.assert_allclose(frame.depth_m[seen], (DEPTH / 1000.0)[seen], rtol=1e-6)


def test_without_colour_the_picture_is_black(recording, tmp_path: Path) -> None:
    log = SensorLog(fill(recording(), leave=("color",)).write(tmp_path / "log.mcap"))
    assert log.topics.color is None
    frames = of(RgbdFrame, played(log)[0])
    assert len(frames) == 5
    assert not frames[0].rgb.any()


def test_topics_that_arrive_late_are_put_in_the_order_of_their_stamps(recording, tmp_path: Path) -> None:
    log = recording()
    for tick in range(100):
        log.imu(NAMES["imu"], 0.01 * tick, LEVEL, STILL, WEIGHT)
        if tick % 10 == 0:
            # Frames are logged 150 ms after they were taken.
            log.image(NAMES["depth"], 0.01 * tick, DEPTH, "16UC1", logged_s=0.01 * tick + 0.15)
            log.calibration(NAMES["info"], 0.01 * tick, CAMERA, logged_s=0.01 * tick + 0.15)
    log.messages.sort(key=lambda message: message[1])
    signals, events = played(SensorLog(log.write(tmp_path / "log.mcap")))
    times = [signal.t_s for signal in signals]
    assert times == sorted(times)
    assert len(of(RgbdFrame, signals)) == 10
    assert events == []


def test_stamps_that_repeat_or_decrease_are_dropped_counted_and_reported(recording, tmp_path: Path) -> None:
    log = recording()
    for stamp, logged in ((0.00, 0.00), (0.01, 0.01), (0.01, 0.02), (-0.30, 0.03), (0.04, 0.04)):
        log.imu(NAMES["imu"], stamp, LEVEL, STILL, WEIGHT, logged_s=logged)
    fill(log, seconds=0.01, leave=("imu",))
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    signals, events = played(sensors)
    assert [round(signal.t_s, 9) for signal in of(ImuSample, signals)] == [0.0, 0.01, 0.04]
    assert sensors.dropped == {"/camera/imu: repeated stamp": 1, "/camera/imu: stamp goes back": 1}
    assert [event.name for event in events] == ["dropped", "dropped"]
    assert "-0.310 s" in events[1].cause
    assert sensors.ended is None


@pytest.mark.parametrize("leap_s", [-3.0, 3600.0])
def test_where_the_clock_leaps_the_recording_ends(recording, tmp_path: Path, leap_s: float) -> None:
    log = recording()
    for tick in range(200):
        t_s = 10.0 + 0.01 * tick
        log.imu(NAMES["imu"], t_s + (leap_s if tick >= 100 else 0.0), LEVEL, STILL, WEIGHT, logged_s=t_s)
        if tick % 10 == 0:
            log.image(NAMES["depth"], t_s, DEPTH, "16UC1")
            log.calibration(NAMES["info"], t_s, CAMERA)
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    signals, events = played(sensors)
    assert len(of(ImuSample, signals)) == 100
    assert sensors.ended is not None
    assert "leaps" in sensors.ended
    assert f"{leap_s + 0.01:+.3f} s" in sensors.ended
    assert [event.name for event in events] == ["ended"]


def test_a_recording_that_pauses_for_minutes_ends_there(recording, tmp_path: Path) -> None:
    log = fill(recording())
    log.imu(NAMES["imu"], 500.0, LEVEL, STILL, WEIGHT)
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    assert len(of(ImuSample, played(sensors)[0])) == 50
    assert sensors.ended is not None
    assert "500.0" in sensors.ended


def test_a_sample_that_is_not_finite_is_dropped(recording, tmp_path: Path) -> None:
    log = fill(recording(), seconds=0.02)
    log.imu(NAMES["imu"], 0.02, (np.nan, 0.0, 0.0, 0.0), STILL, WEIGHT)
    log.imu(NAMES["imu"], 0.03, LEVEL, (0.0, np.inf, 0.0), WEIGHT)
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    signals, events = played(sensors)
    assert len(of(ImuSample, signals)) == 2
    assert sensors.dropped["/camera/imu: not finite"] == 2
    assert len(events) == 2


def test_events_of_a_kind_are_few_however_much_is_dropped(recording, tmp_path: Path) -> None:
    log = fill(recording(), seconds=0.02)
    for _ in range(100):
        log.imu(NAMES["imu"], 0.01, LEVEL, STILL, WEIGHT)
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    _, events = played(sensors)
    assert sensors.dropped["/camera/imu: repeated stamp"] == 100
    assert len(events) == 20


def test_a_depth_image_without_its_colour_image_is_dropped(recording, tmp_path: Path) -> None:
    log = fill(recording(), seconds=0.2)
    log.messages = [message for k, message in enumerate(log.messages) if not (message[0] == NAMES["color"] and k < 10)]
    log.image(NAMES["depth"], 0.2, DEPTH, "16UC1")
    sensors = SensorLog(log.write(tmp_path / "log.mcap"))
    assert len(of(RgbdFrame, played(sensors)[0])) == 1
    assert sensors.dropped == {"/camera/depth/image_raw: no colour image of its time": 1}


def test_stamps_that_were_never_set_are_the_time_of_logging(recording, tmp_path: Path) -> None:
    log = recording()
    for tick in range(5):
        log.imu(NAMES["imu"], 0.0, LEVEL, STILL, WEIGHT, logged_s=0.01 * tick, origin_ns=0)
        log.calibration(NAMES["info"], 0.0, CAMERA, logged_s=0.01 * tick, origin_ns=0)
        log.image(NAMES["depth"], 0.0, DEPTH, "16UC1", logged_s=0.01 * tick, origin_ns=0)
    signals, events = played(SensorLog(log.write(tmp_path / "log.mcap")))
    assert [sample.t_s for sample in of(ImuSample, signals)] == [0.01 * k for k in range(5)]
    assert len(of(RgbdFrame, signals)) == 5
    assert events == []


def test_a_depth_topic_registered_to_colour_is_preferred(recording, tmp_path: Path) -> None:
    log = fill(recording())
    aligned = "/camera/aligned_depth_to_color/image_raw"
    log.image(aligned, 0.0, DEPTH, "16UC1")
    log.calibration("/camera/aligned_depth_to_color/camera_info", 0.0, CAMERA)
    log.image("/camera/infra1/image_rect_raw", 0.0, DEPTH, "mono16")
    topics = SensorLog(log.write(tmp_path / "log.mcap")).topics
    assert topics.depth == aligned
    assert topics.info == "/camera/aligned_depth_to_color/camera_info"
    path = tmp_path / "log.mcap"
    assert SensorLog(path, named={"depth": NAMES["depth"]}).topics.depth == NAMES["depth"]


def test_colour_of_another_size_is_left_out_unless_it_is_named(recording, tmp_path: Path) -> None:
    log = fill(recording(), leave=("color",))
    log.image(NAMES["color"], 0.0, np.zeros((8, 12, 3), np.uint8), "rgb8")
    path = log.write(tmp_path / "log.mcap")
    assert SensorLog(path).topics.color is None
    with pytest.raises(LogFormatError, match=r"sizes differ: .*12×8.*6×4"):
        SensorLog(path, named={"color": NAMES["color"]})


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(TreadlineError) as caught:
        played(SensorLog(path, **options))
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_log_without_intrinsics_is_refused_unless_they_are_given(recording, tmp_path: Path) -> None:
    path = fill(recording(), leave=("info",)).write(tmp_path / "log.mcap")
    assert "no intrinsics" in refusal(path)
    frames = of(RgbdFrame, played(SensorLog(path, calibrate=lambda _, size: CAMERA if size else None))[0])
    assert len(frames) == 5


@pytest.mark.parametrize(
    ("size", "focal_px", "word"), [((6, 4), 0.0, "never calibrated"), ((12, 8), 9.0, "sizes differ")], ids=["unset", "size"]
)
def test_a_calibration_that_is_unset_or_of_another_size_is_refused(
    recording, tmp_path: Path, size: tuple[int, int], focal_px: float, word: str
) -> None:
    log = fill(recording(), leave=("info",))
    width, height = size
    camera = PinholeCamera(width_px=width, height_px=height, fx_px=focal_px, fy_px=focal_px, cx_px=0.0, cy_px=0.0)
    log.calibration(NAMES["info"], 0.0, camera)
    assert word in refusal(log.write(tmp_path / "log.mcap"))


def test_images_that_change_their_size_are_refused(recording, tmp_path: Path) -> None:
    log = fill(recording(), leave=("color",))
    log.image(NAMES["depth"], 0.6, DEPTH[:2], "16UC1")
    assert "6×2" in refusal(log.write(tmp_path / "log.mcap"))


@pytest.mark.parametrize(
    ("pixels", "encoding", "unit_m"),
    [(DEPTH, "16UC1", 1.0), (DEPTH, "16UC1", 1e-6), (DEPTH.astype(np.float32), "32FC1", 0.001)],
)
def test_depth_in_another_unit_is_refused(recording, tmp_path: Path, pixels: np.ndarray, encoding: str, unit_m: float) -> None:
    log = fill(recording(), leave=("depth", "color"))
    log.image(NAMES["depth"], 0.0, pixels, encoding)
    message = refusal(log.write(tmp_path / "log.mcap"), depth_unit_m=unit_m)
    assert "unit" in message
    assert isinstance(ImageError(message), TreadlineError)


def test_a_log_with_nothing_to_see_names_its_topics(recording, tmp_path: Path) -> None:
    message = refusal(fill(recording(), leave=("depth", "color", "info")).write(tmp_path / "log.mcap"))
    assert "neither depth images nor headings" in message
    assert "/camera/imu" in message


def test_messages_that_are_not_ros_are_left_alone(recording, tmp_path: Path) -> None:
    log, path = fill(recording(), seconds=0.1), tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for name, kind in (("/points", "foxglove.PointCloud"), ("/note", "")):
            schema = writer.register_schema(kind, "protobuf", b"") if kind else 0
            writer.add_message(writer.register_channel(name, "protobuf" if kind else "json", schema), START_NS, b"{}", START_NS)
        for topic, logged_ns, kind, data in log.messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            writer.add_message(channels[topic], logged_ns, data, logged_ns)
        writer.finish()
    sensors = SensorLog(path)
    assert set(sensors.found) == {*NAMES.values(), "/points", "/note"}
    assert len(of(ImuSample, played(sensors)[0])) == 10


def test_several_imus_need_a_choice(recording, tmp_path: Path) -> None:
    log = fill(recording(), leave=("imu",))
    for name in ("/left/gyro", "/right/gyro"):
        log.imu(name, 0.0, LEVEL, STILL, WEIGHT)
    path = log.write(tmp_path / "log.mcap")
    assert "--topics imu=" in refusal(path)
    assert SensorLog(path, named={"imu": "/right/gyro"}).topics.imu == "/right/gyro"


@pytest.mark.parametrize(
    ("named", "word"),
    [
        ({"imu": "/nowhere"}, "no such topic"),
        ({"imu": NAMES["depth"]}, "sensor_msgs/msg/Imu"),
        ({"depth": NAMES["color"]}, "16UC1"),
    ],
)
def test_a_topic_named_wrongly_is_refused(recording, tmp_path: Path, named: dict[str, str], word: str) -> None:
    assert word in refusal(fill(recording()).write(tmp_path / "log.mcap"), named=named)


@pytest.mark.parametrize("text", ["depth", "depth=", "sonar=/a", "imu=/a,imu=/b", ""])
def test_topics_are_named_by_role(text: str) -> None:
    with pytest.raises(SettingsError, match="--topics"):
        parse_topics(text)
    assert parse_topics("depth=/a, imu=/b") == {"depth": "/a", "imu": "/b"}


def test_only_a_second_of_a_long_log_is_held(recording, tmp_path: Path) -> None:
    sensors = SensorLog(fill(recording(), seconds=5.0).write(tmp_path / "log.mcap"))
    held = 0
    for _ in sensors.arrivals(lambda _: None):
        held = max(held, len(sensors._ready))
    # 100 samples and 10 frames a second.
    assert held <= 112
