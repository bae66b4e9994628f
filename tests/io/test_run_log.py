"""Logs: what goes in comes out, the same in gives the same bytes, and a damaged file is one LogFormatError."""

import errno
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from wires import decoded

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError, TreadlineError
from treadline.core.ports import Truth
from treadline.core.signals import (
    Event,
    FlipperCommand,
    FlipperReading,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.io import mcap_read
from treadline.io.mcap_log import RunLog
from treadline.io.mcap_read import read_log
from treadline.io.message_types import RosMessage
from treadline.io.messages import TRUTH_NAMES, joints, messages_of
from treadline.io.standard_messages import standard_messages_of

CAMERA = PinholeCamera(width_px=5, height_px=3, fx_px=4.5, fy_px=4.25, cx_px=2.0, cy_px=1.0)


def frame(t_s: float, seed: int) -> RgbdFrame:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 3.0, (3, 5)).astype(np.float32)
    depth[0, 0] = np.nan
    return RgbdFrame(t_s=t_s, rgb=rng.integers(0, 255, (3, 5, 3), dtype=np.uint8), depth_m=depth, camera=CAMERA)


def one_of_each(t_s: float, seed: int) -> list[Any]:
    a, b, c = np.random.default_rng(seed).normal(size=3).tolist()
    return [
        ImuSample(
            t_s=t_s,
            orientation=np.array([0.5, -0.5, 0.5, a]),
            angular_velocity_rad_s=np.array([a, b, c]),
            linear_acceleration_m_s2=np.array([b, c, 9.81]),
        ),
        frame(t_s, seed),
        HeadingMeasurement(t_s=t_s, heading_rad=a, sigma_rad=abs(b), edge_count=5, correction_rad=c),
        HeadingEstimate(t_s=t_s, heading_rad=a, heading_rate_rad_s=b, sigma_rad=abs(c), source="gyro"),
        SeatReading(t_s=t_s, pitch_rad=a, stroke_m=b),
        TrackReading(t_s=t_s, left_m_s=a, right_m_s=b, brake_on=True),
        OperatorInput(t_s=t_s, dead_man=False, stop=True),
        TrackCommand(t_s=t_s, left_m_s=a, right_m_s=b),
        SeatCommand(t_s=t_s, rate_m_s=c),
        Event(t_s=t_s, name="hold", cause="heading 31° beyond 30°"),
        Truth(t_s=t_s, **{name: a + i for i, name in enumerate(TRUTH_NAMES)}),
        FlipperReading(t_s=t_s, angle_rad=a, torque_n_m=b),
        FlipperCommand(t_s=t_s, rate_rad_s=b),
    ]


def write(path: Path, signals: list[Any], *, image_every: int = 1, **options: Any) -> Path:
    with RunLog(path, image_every=image_every, **options) as log:
        for signal in signals:
            log(signal)
    return path


def comparable(signal: Any) -> tuple[Any, ...]:
    values = [getattr(signal, item.name) for item in fields(signal)]
    return (type(signal), *[value.tobytes() if isinstance(value, np.ndarray) else value for value in values])


SIGNALS = [signal for k in range(4) for signal in one_of_each(k * 0.01, k)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write(tmp_path / "log.mcap", SIGNALS)


@pytest.mark.parametrize("messages", [messages_of, standard_messages_of])
def test_every_signal_comes_back_as_it_went_in(tmp_path: Path, messages: Callable[[Any], list[RosMessage]]) -> None:
    """Test: a log of this release, and one as release 0.3 wrote it, with JointState and DiagnosticArray. Expected: the signals."""
    path = write(tmp_path / "log.mcap", SIGNALS, messages=messages)
    assert (b"treadline_msgs" in path.read_bytes()) == (messages is messages_of)
    assert [comparable(signal) for signal in read_log(path)] == [comparable(signal) for signal in SIGNALS]


@pytest.mark.parametrize(
    ("gone", "said"), [("hull_contacts", None), ("chassis_z_m", None), ("pitch_rad", "a Truth lacks pitch_rad")]
)
def test_a_truth_of_an_older_log_is_still_read(tmp_path: Path, gone: str, said: str | None) -> None:
    """Test: a log whose ground truth has no contacts of the hull, or no pose, or no pitch. Expected: 0; NaN; refused by name."""
    truth = next(signal for signal in SIGNALS if isinstance(signal, Truth))
    known = {name: getattr(truth, name) for name in TRUTH_NAMES if name != gone}
    message = joints("/truth", truth.t_s, tuple(known), tuple(known.values()), (), "simulator")
    path = write(tmp_path / "log.mcap", [truth], messages=lambda _: [message])
    if said is None:
        (back,) = read_log(path)
        default = next(item.default for item in fields(Truth) if item.name == gone)
        assert repr(back) == repr(replace(truth, **{gone: default}))  # as text: NaN differs from itself
    else:
        with pytest.raises(LogFormatError, match=said):
            list(read_log(path))


def test_a_late_signal_keeps_its_stamp_and_its_arrival(tmp_path: Path) -> None:
    """Test: a frame exposed at 0.10 s and taken at 0.16 s. Expected: publish time and log time of its three messages."""
    late = frame(0.10, seed=1)
    with RunLog(tmp_path / "log.mcap", image_every=1) as log:
        log(late, 0.16)
    with (tmp_path / "log.mcap").open("rb") as file:
        times = [(message.publish_time, message.log_time) for _, _, message in make_reader(file).iter_messages()]
    assert times == [(100_000_000, 160_000_000)] * 3
    (back,) = read_log(tmp_path / "log.mcap")
    assert back.t_s == 0.10


@pytest.mark.parametrize("t_s", [0.0, 1e-9, 0.123456789, 59.99, 3600.000000001])
def test_time_comes_back_to_the_nanosecond(tmp_path: Path, t_s: float) -> None:
    (back,) = read_log(write(tmp_path / "log.mcap", [SeatCommand(t_s=t_s, rate_m_s=0.0)]))
    assert round(back.t_s * 1e9) == round(t_s * 1e9)


def test_another_decoder_of_ros_2_reads_the_same_numbers(log: Path) -> None:
    first = {topic: messages[0] for topic, messages in decoded(log).items()}
    imu, image, estimate = SIGNALS[0], SIGNALS[1], SIGNALS[3]
    assert first["/imu"].orientation.w == imu.orientation[0]
    assert first["/imu"].orientation.z == imu.orientation[3]
    assert first["/imu"].linear_acceleration.z == 9.81
    assert first["/stair/heading/detail"].heading_rad == estimate.heading_rad
    assert first["/stair/heading/detail"].sigma_rad == estimate.sigma_rad
    assert "/stair/heading" not in first  # its detail is the one topic
    assert bytes(first["/camera/color/image_raw"].data) == image.rgb.tobytes()
    assert first["/camera/depth/image_rect"].encoding == "32FC1"
    assert list(first["/camera/color/camera_info"].k[:3]) == [CAMERA.fx_px, 0.0, CAMERA.cx_px]
    assert first["/tracks/state"].brake_on is True
    assert first["/diagnostics"].status[0].message == "heading 31° beyond 30°"
    assert first["/truth"].y_m == SIGNALS[10].y_m


def test_the_same_signals_give_the_same_bytes(tmp_path: Path, log: Path) -> None:
    assert write(tmp_path / "again.mcap", SIGNALS).read_bytes() == log.read_bytes()


@pytest.mark.parametrize(("every", "kept"), [(0, 0), (1, 7), (3, 3)])
def test_every_nth_frame_is_kept(tmp_path: Path, every: int, kept: int) -> None:
    path = write(tmp_path / "log.mcap", [frame(0.1 * k, k) for k in range(7)], image_every=every)
    assert len(list(read_log(path))) == kept


@pytest.mark.parametrize("step", ["add_message", "finish"])
def test_a_log_that_cannot_be_written_is_one_error_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    for name in {step, "finish"}:
        monkeypatch.setattr(Writer, name, Mock(side_effect=OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(TreadlineError, match=r"log\.mcap: cannot be written: No space"):
        write(tmp_path / "log.mcap", [SeatCommand(t_s=0.0, rate_m_s=0.0)])
    assert not list(tmp_path.iterdir())


def test_a_log_cut_anywhere_or_beyond_its_cap_is_refused(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, cut = log.read_bytes(), tmp_path / "cut.mcap"
    for size in [0, 1, 7, *range(8, len(data) - 1, len(data) // 40), len(data) - 1]:
        cut.write_bytes(data[:size])
        with pytest.raises(LogFormatError, match=r"cut\.mcap"):
            list(read_log(cut))
    monkeypatch.setattr(mcap_read, "MAX_FILE_BYTES", 10)
    with pytest.raises(LogFormatError, match="at most 10 are read"):
        list(read_log(log))


def test_what_is_no_log_is_refused_by_name(tmp_path: Path) -> None:
    text = tmp_path / "text.mcap"
    text.write_text("t_s,left_m_s\n0,1\n" * 40)
    for path in (text, tmp_path / "none.mcap", tmp_path):
        with pytest.raises(LogFormatError, match=path.name):
            list(read_log(path))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"enable_crcs": False}, "a chunk is compressed by 'zstd' or has no checksum"),
        ({"compression": CompressionType.LZ4}, "a chunk is compressed by 'lz4'"),
        ({"use_chunking": False}, "a message outside a chunk has no checksum"),
        ({"enable_data_crcs": False}, "the data has no checksum"),
    ],
)
def test_a_log_without_checksums_throughout_is_refused(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    path = tmp_path / "bare.mcap"
    with path.open("wb") as file:
        writer = Writer(file, **{"compression": CompressionType.ZSTD, "enable_data_crcs": True} | options)
        writer.start()
        schema = writer.register_schema("a", "ros2msg", b"")
        writer.add_message(writer.register_channel("/else", "cdr", schema), 0, b"", 0)
        writer.finish()
    with pytest.raises(LogFormatError, match=words):
        list(read_log(path))
