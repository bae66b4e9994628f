"""One record as a log of every kind that is read."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
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


def in_csv(path: Path, record: InputOutputRecord) -> Written:
    write_record(path, record, 0.5)
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


BARE = {"compression": CompressionType.NONE, "enable_crcs": False, "enable_data_crcs": False}
KINDS: dict[str, tuple[str, Callable[[Path, InputOutputRecord], Written]]] = {
    "csv": ("log.csv", in_csv),
    "spreadsheet": ("log.CSV", in_a_spreadsheet),
    "npz": ("log.npz", in_npz),
    "npz since 1970": ("log.npz", in_npz_since_1970),
    "mat": ("log.mat", in_mat),
    "mat compressed": ("log.mat", lambda path, record: in_mat(path, record, do_compression=True)),
    "mat 4": ("log.mat", in_mat_4),
    "parquet": ("log.parquet", in_parquet),
}
BAGS: dict[str, tuple[str, bool, dict[str, Any]]] = {
    "mcap": ("log.mcap", False, {}),
    "mcap lz4": ("log.mcap", False, {"compression": CompressionType.LZ4}),
    "mcap bare": ("log.mcap", False, BARE),
    "mcap unchunked": ("log.mcap", False, {"use_chunking": False, "index_types": IndexType.NONE}),
    "mcap ros 1": ("log.mcap", True, {}),
    "bag": ("log.bag", True, {}),
    "bag bz2": ("log.bag", True, {"packed": "BZ2"}),
    "bag lz4": ("log.bag", True, {"packed": "LZ4"}),
    "db3": ("log.db3", False, {}),
    "folder of db3": ("log", False, {}),
    "folder of mcap": ("log", False, {"storage": "MCAP"}),
}
"""File, whether it is of ROS 1, and how it is written."""


def in_bag(log: Any, path: Path, record: InputOutputRecord, options: dict[str, Any]) -> Written:
    """Write a command as Float64MultiArray, and an answer as Imu that is logged a little after its stamp."""
    for k in range(len(record)):
        t_s = k * record.dt_s
        log.numbers(COMMAND, t_s, record.u[k])
        log.imu(ANSWER, t_s, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, float(record.y[k, 0])), (0.0, 0.0, 9.8), logged_s=t_s + 0.003)
    if path.suffix == ".db3":
        (log.write(path.with_suffix("")) / path.name).rename(path)
    else:
        log.write(path, **options)
    return Written(path, BAG_INPUTS, BAG_OUTPUTS)


@pytest.fixture(params=[*KINDS, *BAGS])
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
def written(tmp_path: Path, recording: Any) -> Write:
    """Write a record as a log of a kind."""

    def write(kind: str, record: InputOutputRecord) -> Written:
        folder = Path(mkdtemp(dir=tmp_path))
        if kind in BAGS:
            name, ros1, options = BAGS[kind]
            return in_bag(recording(ros1=ros1), folder / name, record, options)
        name, writer = KINDS[kind]
        return writer(folder / name, record)

    return write
