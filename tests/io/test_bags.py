"""Channels of a bag with separate time axes, resampled to one grid without inventing data."""

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import bag, one_topic

from treadline.core.errors import LogFormatError, RecordError
from treadline.core.models import InputOutputRecord
from treadline.io.records import read_record


def read(path: Path, **options: Any) -> InputOutputRecord:
    return read_record(path, ("/u.data",), ("/y.data",), **options)


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


def test_a_clock_that_jumps_back_is_named(tmp_path: Path) -> None:
    times = [0.1 * k for k in range(1, 20)]
    stamps = [*times[:10], *[t - 0.5 for t in times[10:]]]
    path = bag(tmp_path / "log.mcap", stamps={"y": stamps}, u=[(t, 0.0) for t in times], y=[(t, 0.0) for t in times])
    with pytest.raises(RecordError, match=r"/y does not increase: message 11 is stamped 0\.4 s before"):
        read(path)


def test_an_element_beyond_the_array_is_refused(written, record: InputOutputRecord) -> None:
    log = written("mcap", record)
    with pytest.raises(LogFormatError, match=r"2 elements there, not \[2\]"):
        read_record(log.path, ("/tracks/cmd.data[2]",), log.outputs)


def test_parts_of_a_bag_are_read_in_their_order(tmp_path: Path) -> None:
    whole = [(0.1 * k, float(k)) for k in range(30)]
    for number, part in ((2, whole[:15]), (10, whole[15:])):
        bag(tmp_path / f"run_{number}.mcap", u=part, y=part)
    (tmp_path / "metadata.yaml").write_text("")
    assert read(tmp_path).y[:, 0].tolist() == list(range(30))


def test_a_bag_without_definitions_is_of_the_types_of_ros_2(record: InputOutputRecord, written) -> None:
    log = written("db3", record)
    with sqlite3.connect(log.path) as base:
        base.execute("DELETE FROM message_definitions")
    assert read_record(log.path, log.inputs, log.outputs).u.tobytes() == record.u.tobytes()


def test_a_type_that_is_defined_at_length_is_refused(tmp_path: Path) -> None:
    long = one_topic(tmp_path / "log.mcap", kind="a_msgs/A", language="ros2msg", definition="float64 data\n" + "# long\n" * 200_000)
    with pytest.raises(LogFormatError, match=r"log\.mcap: .* too long or computes"):
        read_record(long, (), ("/y.data",))
