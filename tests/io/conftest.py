"""One record as a log of every kind that is read."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from scipy.io import savemat

from treadline.core.models import InputOutputRecord
from treadline.io.records import write_record

Names = tuple[str, ...]
START_NS = 1_700_000_000_000_000_000
"""Bags count from 1970: more digits than a float has."""
COMMAND, ANSWER = "/tracks/cmd", "/imu/data"
BAG_INPUTS: Names = ("/tracks/cmd.data[0]", "tracks/cmd.data[1]")
BAG_OUTPUTS: Names = ("/imu/data.angular_velocity.z",)


@dataclass(frozen=True)
class Written:
    path: Path
    inputs: Names
    outputs: Names


def stamps(record: InputOutputRecord) -> list[int]:
    return [START_NS + round(k * record.dt_s * 1e9) for k in range(len(record))]


class RosMessages:
    """Serialised messages of one ROS version: a command as Float64MultiArray, an answer as Imu."""

    def __init__(self, *, ros1: bool) -> None:
        from rosbags import typesys

        self.ros1 = ros1
        self.store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
        self.serialise = self.store.serialize_ros1 if ros1 else self.store.serialize_cdr

    def type_of(self, name: str) -> Any:
        return self.store.types[name]

    def command(self, values: np.ndarray) -> tuple[str, bytes]:
        kind = "std_msgs/msg/Float64MultiArray"
        layout = self.type_of("std_msgs/msg/MultiArrayLayout")([], 0)
        return kind, bytes(self.serialise(self.type_of(kind)(layout, np.array(values)), kind))

    def answer(self, rate: float, stamp_ns: int) -> tuple[str, bytes]:
        kind = "sensor_msgs/msg/Imu"
        time = self.type_of("builtin_interfaces/msg/Time")(stamp_ns // 10**9, stamp_ns % 10**9)
        header = self.type_of("std_msgs/msg/Header")(*((7,) if self.ros1 else ()), time, "imu")
        vector, zeros = self.type_of("geometry_msgs/msg/Vector3"), np.zeros(9)
        turn = self.type_of("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0)
        imu = self.type_of(kind)(header, turn, zeros, vector(0.0, 0.0, float(rate)), zeros, vector(0.0, 0.0, 9.8), zeros)
        return kind, bytes(self.serialise(imu, kind))

    def definition(self, kind: str) -> str:
        text, _ = self.store.generate_msgdef(kind, ros_version=1 if self.ros1 else 2)
        return str(text)


Packets = list[tuple[str, int, str, bytes]]
"""Topic, log time, type, message."""


def packets(record: InputOutputRecord, ros: RosMessages, *, delay_ns: int = 0) -> Packets:
    every: Packets = []
    for k, stamp in enumerate(stamps(record)):
        every.append((COMMAND, stamp, *ros.command(record.u[k])))
        every.append((ANSWER, stamp + delay_ns, *ros.answer(record.y[k, 0], stamp)))
    return every


def write_mcap(path: Path, every: Packets, ros: RosMessages, **options: Any) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **({"compression": CompressionType.ZSTD, "enable_data_crcs": True} | options))
        writer.start()
        channels: dict[str, int] = {}
        for topic, time_ns, kind, data in every:
            if topic not in channels:
                language, encoding = ("ros1msg", "ros1") if ros.ros1 else ("ros2msg", "cdr")
                schema = writer.register_schema(kind, language, ros.definition(kind).encode())
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()


def write_ros_bag(writer: Any, every: Packets, ros: RosMessages) -> None:
    with writer:
        connections: dict[str, Any] = {}
        for topic, time_ns, kind, data in every:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ros.store)
            writer.write(connections[topic], time_ns, data)


def in_csv(path: Path, record: InputOutputRecord) -> Written:
    write_record(path, record, 0.5)
    return Written(path, record.input_names, record.output_names)


def in_tsv(path: Path, record: InputOutputRecord) -> Written:
    write_record(path, record, 0.5)
    path.write_text(path.read_text().replace(",", "\t"))
    return Written(path, record.input_names, record.output_names)


def in_a_spreadsheet(path: Path, record: InputOutputRecord) -> Written:
    """Write as spreadsheets do: byte order mark, semicolons, quotes, returns."""
    write_record(path, record, 0.5)
    lines = [";".join(f'"{cell}"' for cell in line.split(",")) for line in path.read_text().splitlines()]
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode())
    return Written(path, record.input_names, record.output_names)


def in_npz(path: Path, record: InputOutputRecord) -> Written:
    np.savez(path, t_s=0.5 + record.dt_s * np.arange(len(record)), u=record.u, heading=record.y[:, 0])
    return Written(path, ("u[0]", "u[1]"), ("heading",))


def in_npz_since_1970(path: Path, record: InputOutputRecord) -> Written:
    left, right = np.asfortranarray(record.u).T
    np.savez_compressed(path, t_ns=np.array(stamps(record)), left=left, right=right, y=np.asfortranarray(record.y))
    return Written(path, ("left", "right"), ("y[0]",))


def in_mat(path: Path, record: InputOutputRecord, **options: Any) -> Written:
    t = 0.5 + record.dt_s * np.arange(len(record))
    savemat(
        path,
        {"time": t, "run": {"u": record.u, "out": {"y": record.y}}, "note": "fast", "cells": np.array(["a"], object)},
        **options,
    )
    return Written(path, ("run.u[0]", "run.u[1]"), ("run.out.y",))


def in_mat_4(path: Path, record: InputOutputRecord) -> Written:
    savemat(path, {"t": 0.5 + record.dt_s * np.arange(len(record)), "u": record.u, "y": record.y}, format="4")
    return Written(path, ("u[0]", "u[1]"), ("y",))


def in_parquet(path: Path, record: InputOutputRecord) -> Written:
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is an extra")
    from pyarrow import parquet

    columns = {name: record.u[:, j] for j, name in enumerate(record.input_names)} | {record.output_names[0]: record.y[:, 0]}
    time = arrow.array(np.array(stamps(record)), arrow.timestamp("ns", "UTC"))
    parquet.write_table(arrow.table({"time": time, **columns, "note": ["x"] * len(record)}), path, row_group_size=16)
    return Written(path, record.input_names, record.output_names)


def in_mcap(path: Path, record: InputOutputRecord, *, ros1: bool = False, **options: Any) -> Written:
    ros = RosMessages(ros1=ros1)
    # The answer is stamped when it is measured, and logged a little later.
    write_mcap(path, packets(record, ros, delay_ns=3_000_000), ros, **options)
    return Written(path, BAG_INPUTS, BAG_OUTPUTS)


def in_bag(path: Path, record: InputOutputRecord, compression: str = "") -> Written:
    from rosbags import rosbag1

    ros, writer = RosMessages(ros1=True), rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    write_ros_bag(writer, packets(record, ros), ros)
    return Written(path, BAG_INPUTS, BAG_OUTPUTS)


def in_ros2_folder(path: Path, record: InputOutputRecord, storage: str) -> Written:
    from rosbags import rosbag2

    ros = RosMessages(ros1=False)
    write_ros_bag(rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage]), packets(record, ros), ros)
    return Written(path, BAG_INPUTS, BAG_OUTPUTS)


def in_db3(path: Path, record: InputOutputRecord) -> Written:
    in_ros2_folder(path.with_suffix(""), record, "SQLITE3")
    (path.with_suffix("") / path.name).rename(path)
    return Written(path, BAG_INPUTS, BAG_OUTPUTS)


BARE = {"compression": CompressionType.NONE, "enable_crcs": False, "enable_data_crcs": False}
KINDS: dict[str, tuple[str, Callable[[Path, InputOutputRecord], Written]]] = {
    "csv": ("log.csv", in_csv),
    "txt": ("log.txt", in_csv),
    "tsv": ("log.tsv", in_tsv),
    "spreadsheet": ("log.CSV", in_a_spreadsheet),
    "npz": ("log.npz", in_npz),
    "npz since 1970": ("log.npz", in_npz_since_1970),
    "mat": ("log.mat", in_mat),
    "mat compressed": ("log.mat", lambda path, record: in_mat(path, record, do_compression=True)),
    "mat 4": ("log.mat", in_mat_4),
    "parquet": ("log.parquet", in_parquet),
    "mcap": ("log.mcap", in_mcap),
    "mcap lz4": ("log.mcap", lambda path, record: in_mcap(path, record, compression=CompressionType.LZ4)),
    "mcap bare": ("log.mcap", lambda path, record: in_mcap(path, record, **BARE)),
    "mcap unchunked": (
        "log.mcap",
        lambda path, record: in_mcap(path, record, use_chunking=False, index_types=IndexType.NONE),
    ),
    "mcap ros 1": ("log.mcap", lambda path, record: in_mcap(path, record, ros1=True)),
    "bag": ("log.bag", in_bag),
    "bag bz2": ("log.bag", lambda path, record: in_bag(path, record, "BZ2")),
    "bag lz4": ("log.bag", lambda path, record: in_bag(path, record, "LZ4")),
    "db3": ("log.db3", in_db3),
    "folder of db3": ("log", lambda path, record: in_ros2_folder(path, record, "SQLITE3")),
    "folder of mcap": ("log", lambda path, record: in_ros2_folder(path, record, "MCAP")),
}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def record() -> InputOutputRecord:
    rng = np.random.default_rng(3)
    return InputOutputRecord(
        u=rng.normal(size=(40, 2)),
        y=rng.uniform(-1, 1, (40, 1)),
        dt_s=0.25,
        input_names=("left_m_s", "right_m_s"),
        output_names=("heading_rad",),
    )


Write = Callable[[str, InputOutputRecord], Written]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    """Write a record as a log of a kind."""

    def write(kind: str, record: InputOutputRecord) -> Written:
        name, writer = KINDS[kind]
        return writer(tmp_path / name, record)

    return write
