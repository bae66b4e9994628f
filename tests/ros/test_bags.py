"""Bags of every kind, written and read with no ROS installed: what is recorded is replayed to the same heading, and identified."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from treadline.cli import main
from treadline.io.records import read_record

SCENARIO = """
[stair]
steps = 12
[start]
place = "flight"
step = 4
heading_deg = 10
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short drive of the graph, images and all."""
    folder = tmp_path_factory.mktemp("bags")
    (folder / "short.toml").write_text(SCENARIO)
    treadline("nodes", folder / "short.toml", "--duration", "2.5", "--out", folder / "run")
    return folder / "run"


def treadline(*words: object) -> dict[str, Any]:
    """Run a command as a user does: compiled code is then read back, not compiled again under the shape checker."""
    command = [sys.executable, "-m", "treadline", *map(str, words), "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.fixture(scope="module")
def before(run: Path) -> dict[str, Any]:
    return treadline("replay", run / "log.mcap", "--out", run / "before")


@pytest.fixture(scope="module")
def copies(run: Path) -> dict[str, Path]:
    """The drive in each kind of bag."""
    made = {kind: run.with_name(f"copy.{kind}") for kind in ("bag", "db3", "mcap")}
    for copy in made.values():
        assert main(["record", str(run), "--out", str(copy)]) == 0
    return made


def test_a_ros_1_copy_is_replayed_to_the_same_heading(
    run: Path, copies: dict[str, Path], before: dict[str, Any], tmp_path: Path
) -> None:
    after = treadline("replay", copies["bag"], "--out", tmp_path / "after")
    keys = ("frames", "accepted", "rms_difference_deg", "rms_error_deg")
    assert [after[key] for key in keys] == [before[key] for key in keys]
    assert (tmp_path / "after" / "series.csv").read_bytes() == (run / "before" / "series.csv").read_bytes()


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_copy_is_read_for_identification(run: Path, copies: dict[str, Path], kind: str) -> None:
    own = ("/tracks/cmd.left_m_s", "/tracks/cmd.right_m_s"), ("/stair/heading/detail.heading_rad",)
    standard = ("/tracks/cmd.velocity[0]", "/tracks/cmd.velocity[1]"), ("/stair/heading/detail.position[0]",)
    ours = read_record(run / "log.mcap", *own, period_s=0.25)
    theirs = read_record(copies[kind], *(standard if kind == "bag" else own), period_s=0.25)
    np.testing.assert_array_equal(theirs.u, ours.u)
    np.testing.assert_array_equal(theirs.y, ours.y)


def test_the_recorder_leaves_a_record_for_identification(run: Path) -> None:
    record = read_record(run, ("left_m_s", "right_m_s"), ("heading_rad", "yaw_rate_rad_s"))
    assert record.dt_s == 0.25
    assert len(record.u) >= 8
    assert abs(record.y[-1, 0]) < abs(record.y[0, 0])


@pytest.mark.parametrize("kind", ["mcap", "bag", "db3"])
def test_a_drive_is_recorded_with_what_viewers_need_to_place_it(run: Path, tmp_path: Path, kind: str) -> None:
    """Test: the recorder's own file in somebody else's reader. Expected result: odometry, its frame and the sensors' places."""
    bag = tmp_path / f"drive.{kind}"
    treadline("nodes", run.parent / "short.toml", "--duration", "1.0", "--out", bag)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        topics = {connection.topic: connection.msgtype for connection, _, _ in reader.messages()}
        moved = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic == "/odom"]
    assert moved[-1].pose.pose.position.x > moved[0].pose.pose.position.x
    assert (moved[0].header.frame_id, moved[0].child_frame_id) == ("odom", "base_link")
    assert topics["/odom"] == "nav_msgs/msg/Odometry"
    assert topics["/tf"] == topics["/tf_static"] == "tf2_msgs/msg/TFMessage"
