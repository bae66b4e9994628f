"""Channels of a bag with separate time axes, resampled to one grid without inventing data."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import SECOND, Channel, bag, cdr
from mcap.writer import Writer

from treadline.core.errors import LogFormatError, NotFinite, RecordError, TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.io.records import read_record


def one_topic(path: Path, kind: str, language: str, definition: str, messages: list[bytes], encoding: str = "cdr") -> Path:
    """Write one topic, /y, with a message per second."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        key = writer.register_channel("/y", encoding, writer.register_schema(kind, language, definition.encode()))
        for k, data in enumerate(messages):
            writer.add_message(key, k * SECOND, data, 0)
        writer.finish()
    return path


COUNTING = [cdr(float(k), None) for k in range(9)]


def read(path: Path, **options: Any) -> InputOutputRecord:
    return read_record(path, ("/u.data",), ("/y.data",), **options)


def test_the_grid_has_the_slowest_topics_period_and_the_common_time(tmp_path: Path) -> None:
    fast = [(0.01 * k, float(k)) for k in range(200)]
    slow = [(0.33 + 0.1 * k, float(k)) for k in range(10)]
    record = read(bag(tmp_path / "log.mcap", u=fast, y=slow))
    assert record.dt_s == 0.1
    assert len(record) == 10
    assert record.u[:, 0].tolist() == [33.0 + 10.0 * k for k in range(10)]
    assert record.y[:, 0].tolist() == list(range(10))


def test_inputs_are_held_and_outputs_interpolated(tmp_path: Path) -> None:
    u = [(0.0, 1.0), (0.26, 2.0), (0.5, 3.0), (0.76, 4.0), (1.0, 5.0)]
    y = [(0.0, 0.0), (0.2, 0.2), (0.4, 0.4), (0.6, 0.6), (0.8, 0.8), (1.0, 1.0)]
    record = read(bag(tmp_path / "log.mcap", u=u, y=y), period_s=0.25)
    assert record.u[:, 0].tolist() == [1.0, 1.0, 3.0, 3.0, 5.0]
    # The straight line, but for rounding.
    np.testing.assert_allclose(record.y[:, 0], [0.0, 0.25, 0.5, 0.75, 1.0], atol=1e-15)


@pytest.mark.parametrize("pausing", ["u", "y"])
def test_a_pause_is_a_gap_and_not_a_line(tmp_path: Path, pausing: str) -> None:
    whole = [(0.1 * k, float(k)) for k in range(41)]
    # Two lost in a row are bridged; from the third on it is a pause.
    broken = [item for k, item in enumerate(whole) if k not in {5, 6, 20, 21, 22}]
    channels = {"u": whole, "y": whole} | {pausing: broken}
    path = bag(tmp_path / "log.mcap", **channels)
    with pytest.raises(NotFinite, match=rf"log\.mcap: 2\.000 s after.*'/{pausing}\.data' holds NaN.*--allow-gaps"):
        read(path)
    record = read(path, allow_gaps=True)
    column = record.u if pausing == "u" else record.y
    assert np.flatnonzero(np.isnan(column[:, 0])).tolist() == [20, 21, 22]
    assert column[5, 0] == (4.0 if pausing == "u" else pytest.approx(5.0))


def test_a_header_stamp_counts_before_the_time_of_logging(tmp_path: Path) -> None:
    times = [0.1 * k for k in range(1, 30)]
    late = [(t + 0.03 * (k % 2), float(k)) for k, t in enumerate(times)]
    path = bag(tmp_path / "log.mcap", stamps={"u": times, "y": times}, u=late, y=late)
    record = read(path)
    assert record.dt_s == 0.1
    np.testing.assert_array_equal(record.u[:, 0], np.arange(29))
    # A header that nobody filled in says nothing.
    unset = bag(tmp_path / "unset.mcap", stamps={"y": [0.0] * 29}, u=late, y=[(t, float(k)) for k, t in enumerate(times)])
    assert read(unset).dt_s == pytest.approx(0.1)


def test_of_messages_with_one_stamp_the_last_counts(tmp_path: Path) -> None:
    y = [(0.1 * k, float(k)) for k in range(10)]
    record = read(bag(tmp_path / "log.mcap", u=[(0.0, -1.0), *y], y=y))
    assert record.u[0, 0] == 0.0


@pytest.mark.parametrize(
    ("channels", "kind", "words"),
    [
        (
            {"u": [(0.1 * k, 0.0) for k in range(9)]},
            LogFormatError,
            "no topic '/y' for '/y.data' \\(there are: /u\\); a column is topic.field",
        ),
        ({"u": [(0.0, 1.0)], "y": [(0.0, 1.0)]}, LogFormatError, "1 messages on /u; at least two"),
        ({"u": [(0.0, 1.0)] * 3, "y": [(0.0, 1.0)] * 3}, RecordError, "same time"),
        ({"u": [(0.0, 1.0), (0.1, 1.0)], "y": [(5.0, 1.0), (5.1, 1.0)]}, RecordError, "share less than a period.*one clock"),
        (
            {"u": [(0.0, 1.0), (1e-9, 1.0), (2e-9, 1.0), (9e8, 1.0)], "y": [(0.0, 1.0), (1e-9, 1.0), (2e-9, 1.0), (9e8, 1.0)]},
            RecordError,
            "--period",
        ),
    ],
)
def test_channels_that_make_no_record_say_why(
    tmp_path: Path, channels: dict[str, Channel], kind: type[TreadlineError], words: str
) -> None:
    with pytest.raises(kind, match=words) as caught:
        read(bag(tmp_path / "log.mcap", **channels))
    assert "\n" not in str(caught.value)


def test_a_clock_that_jumps_back_is_named(tmp_path: Path) -> None:
    times = [0.1 * k for k in range(1, 20)]
    stamps = [*times[:10], *[t - 0.5 for t in times[10:]]]
    path = bag(tmp_path / "log.mcap", stamps={"y": stamps}, u=[(t, 0.0) for t in times], y=[(t, 0.0) for t in times])
    with pytest.raises(RecordError, match=r"/y does not increase: message 11 is stamped 0\.4 s before"):
        read(path)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("/y.nothing", "no field 'nothing' for '/y.nothing' \\(there are: header, data, note\\)"),
        ("/y", "is not a number"),
        ("/y.header", "is not a number but .*there are: stamp, frame_id"),
        ("/y.note", "is not a number but str"),
        ("/y.data[0]", "no elements there"),
        ("/y.data..x", "is not a number"),
        ("y.header.stamp.sec.real.imag[", "is not a number"),
    ],
)
def test_a_column_that_leads_nowhere_says_what_is_there(tmp_path: Path, column: str, words: str) -> None:
    times = [0.1 * k for k in range(1, 20)]
    path = bag(tmp_path / "log.mcap", stamps={"y": times}, u=[(t, 0.0) for t in times], y=[(t, 0.0) for t in times])
    with pytest.raises(LogFormatError, match=words):
        read_record(path, ("u.data",), (column,))


def test_an_element_beyond_the_array_is_refused(written, record: InputOutputRecord) -> None:
    log = written("mcap", record)
    with pytest.raises(LogFormatError, match=r"2 elements there, not \[2\]"):
        read_record(log.path, ("/tracks/cmd.data[2]",), log.outputs)


def test_degrees_in_a_bag_are_refused(tmp_path: Path) -> None:
    path = one_topic(tmp_path / "log.mcap", "test_msgs/msg/Heading", "ros2msg", "float64 heading_rad", [cdr(20.0, None)] * 9)
    with pytest.raises(RecordError, match="degrees"):
        read_record(path, (), ("/y.heading_rad",))


@pytest.mark.parametrize(
    ("encoding", "language", "words"),
    [("protobuf", "protobuf", "encoded in 'protobuf'"), ("json", "jsonschema", "'json'"), ("cdr", "", "not defined in the bag")],
)
def test_messages_of_another_encoding_are_named(tmp_path: Path, encoding: str, language: str, words: str) -> None:
    path = one_topic(tmp_path / "log.mcap", "test_msgs/msg/Unknown", language, "", [b"{}"], encoding)
    with pytest.raises(LogFormatError, match=words):
        read_record(path, (), ("/y.data",))


def test_parts_of_a_bag_are_read_in_their_order(tmp_path: Path) -> None:
    whole = [(0.1 * k, float(k)) for k in range(30)]
    for number, part in ((2, whole[:15]), (10, whole[15:])):
        bag(tmp_path / f"run_{number}.mcap", u=part, y=part)
    (tmp_path / "metadata.yaml").write_text("")
    assert read(tmp_path).y[:, 0].tolist() == list(range(30))


def test_idl_definitions_and_bags_without_any_are_read_by_rosbags(tmp_path: Path, record: InputOutputRecord, written) -> None:
    import sqlite3

    log = written("db3", record)
    with sqlite3.connect(log.path) as base:
        base.execute("DELETE FROM message_definitions")
    assert read_record(log.path, log.inputs, log.outputs).u.tobytes() == record.u.tobytes()
    idl = "module test_msgs { module msg { struct Y { double data; }; }; };"
    path = one_topic(tmp_path / "idl.mcap", "test_msgs/msg/Y", "ros2idl", idl, COUNTING)
    assert read_record(path, (), ("/y.data",)).y[:, 0].tolist() == list(range(9))


@pytest.mark.parametrize(
    ("kind", "language", "definition"),
    [
        (
            "a_msgs/msg/A",
            "ros2idl",
            "module a_msgs { module msg { const long X = 1 << 99999999999; struct A { double data; }; }; };",
        ),
        ("a_msgs/msg/A", "ros2msg", "float64 data\n" + "# long\n" * 200_000),
        ("a_msgs/msg/A", "ros2msg", "A data"),
        ("a_msgs/A", "ros1msg", "A data"),
        ("a_msgs/A:\n import os", "ros1msg", "float64 data"),
        ("a_msgs/A", "ros1msg", "float64[99999999999] data"),
        ("a_msgs/msg/A", "ros2msg", "float64[99999999999] data"),
        ("a_msgs/A", "ros1msg", "float64 X=1e999\nfloat64 data"),
    ],
)
def test_a_malicious_definition_is_refused(tmp_path: Path, kind: str, language: str, definition: str) -> None:
    path = one_topic(tmp_path / "log.mcap", kind, language, definition, COUNTING, "ros1" if language == "ros1msg" else "cdr")
    with pytest.raises(LogFormatError, match=r"log\.mcap") as caught:
        read_record(path, (), ("/y.data",))
    assert "\n" not in str(caught.value)
