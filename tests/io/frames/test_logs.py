"""Frames of recordings: topics found by type, clouds like images, damaged and ambiguous logs named."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.cli import main
from treadline.core.camera_images import NamedFrame, RgbdFrame
from treadline.core.errors import ImageError, LogFormatError, SettingsError
from treadline.io.frames import read_frames
from treadline.io.frames._recorded_frames import FramesOfLog
from treadline.io.frames.evaluation import FrameEvaluator
from treadline.io.frames.point_cloud import FrameOptions

RATE_HZ = 30.0
ENDINGS = [".mcap", ".bag", ""]
"""MCAP of ROS 2, bag of ROS 1, folder of a bag of ROS 2."""
COUNT = 3


@pytest.fixture
def frame(rendered) -> RgbdFrame:
    """Return a frame from a flight."""
    return rendered()


@pytest.fixture
def walk(recording, frame) -> Callable[..., object]:
    """Return a recording of one view: depth, calibration and, if asked, colour."""

    def record(
        *, ros1: bool = False, colour_late_s: float | None = None, camera=None, depth: str = "/camera/depth/image_rect"
    ) -> Any:
        log = recording(ros1=ros1)
        for number in range(COUNT):
            t_s = number / RATE_HZ
            log.calibration(depth.rpartition("/")[0] + "/camera_info", t_s, camera or frame.camera)
            log.image(depth, t_s, np.round(np.nan_to_num(frame.depth_m) * 1000.0).astype(np.uint16), "16UC1")
            if colour_late_s is not None:
                log.image("/camera/color/image_raw", t_s + colour_late_s, frame.rgb, "rgb8")
        return log

    return record


def add_cloud(log, topic: str, t_s: float, points: np.ndarray, size: tuple[int, int], *, scale: float = 1.0) -> None:
    """Add a PointCloud2 with padding between the coordinates and a packed colour, as depth cameras publish it."""
    kind = np.dtype({"names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 3 + ["<u4"], "offsets": [0, 4, 8, 16], "itemsize": 32})
    rows = np.zeros(len(points), kind)
    rows["x"], rows["y"], rows["z"] = (scale * points).T
    rows["rgb"] = 0x808080
    Field = log._type("sensor_msgs/msg/PointField")
    fields = [Field(name, offset, number, 1) for name, offset, number in (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 16, 7))]
    data = np.frombuffer(rows.tobytes(), np.uint8)
    log._add(topic, "sensor_msgs/msg/PointCloud2", t_s, (size[1], size[0], fields, False, 32, 32 * size[0], data, False))


def headings(source) -> list[float | None]:
    return [values["heading_deg"] for _, values in map(FrameEvaluator("robust").evaluate, source)]


def direct(frame) -> float:
    bare = replace(frame, camera=replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0)))
    (heading,) = headings([NamedFrame(name="a", frame=bare, mount_known=False, gravity_C=None)])
    assert heading is not None
    return heading


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_log_gives_the_heading_of_each_frame(walk, frame, tmp_path: Path, ending: str) -> None:
    path = walk(ros1=ending == ".bag").write(tmp_path / f"walk{ending}")
    found = list(read_frames(path))
    assert [named.t_s for named in found] == pytest.approx([number / RATE_HZ for number in range(COUNT)])
    assert not any(named.has_colour for named in found)
    # Depth rounded to a millimetre costs next to nothing.
    assert headings(read_frames(path)) == pytest.approx([direct(frame)] * COUNT, abs=0.05)


@pytest.mark.parametrize("ending", ENDINGS)
def test_clouds_of_a_log_give_the_heading_of_its_depth_images(recording, frame, points, tmp_path: Path, ending: str) -> None:
    log = recording(ros1=ending == ".bag")
    add_cloud(log, "/camera/points", 0.0, points(frame), (320, 240))
    known = points(frame)[np.isfinite(frame.depth_m).ravel()]
    add_cloud(log, "/camera/points", 0.1, known, (len(known), 1))
    path = log.write(tmp_path / f"walk{ending}")
    source = read_frames(path)
    # The property of clouds: within 0.05° of the depth image.
    assert headings(source) == pytest.approx([direct(frame)] * 2, abs=0.05)
    assert list(source.warnings) == []


def test_depth_images_are_preferred_to_clouds_and_one_of_several_is_named(walk, frame, points, tmp_path: Path) -> None:
    log = walk()
    add_cloud(log, "/points", 0.0, points(frame), (320, 240))
    path = log.write(tmp_path / "walk.mcap")
    assert FramesOfLog(path, FrameOptions()).topic == "/camera/depth/image_rect"
    assert FramesOfLog(path, FrameOptions(topic="/points")).is_cloud
    with pytest.raises(SettingsError, match="--topic /nowhere: no such topic"):
        read_frames(path, topic="/nowhere")
    with pytest.raises(SettingsError, match="holds sensor_msgs/msg/CameraInfo"):
        read_frames(path, topic="/camera/depth/camera_info")
    other = walk(depth="/second/depth/image_rect")
    log.messages += other.messages
    path = log.write(tmp_path / "two.mcap")
    with pytest.raises(SettingsError, match=r"several topics hold depth.*--topic /camera/depth/image_rect"):
        read_frames(path)
    assert len(list(read_frames(path, topic="/second/depth/image_rect"))) == COUNT


def test_a_calibration_of_another_size_is_refused(walk, frame, calibration_file, tmp_path: Path) -> None:
    half = replace(frame.camera, width_px=160, height_px=120)
    path = walk(camera=half).write(tmp_path / "walk.mcap")
    with pytest.raises(LogFormatError, match="/camera/depth/camera_info 160×120 and /camera/depth/image_rect 320×240"):
        read_frames(path)
    small = calibration_file(tmp_path / "small.toml", replace(half, cx_px=80.0, cy_px=60.0))
    with pytest.raises(ImageError, match=r"an image of 320×240 at 0\.000 s, calibrated for 160×120"):
        list(read_frames(path, camera=small))
    right = calibration_file(tmp_path / "right.toml", frame.camera)
    (first, *_) = read_frames(path, camera=right)
    assert first.mount_known
    assert first.frame.camera.mount_pitch_rad == pytest.approx(np.deg2rad(40.0))


def test_depth_and_colour_of_different_times_are_counted(walk, tmp_path: Path) -> None:
    together = FramesOfLog(walk(colour_late_s=0.005).write(tmp_path / "a.mcap"), FrameOptions())
    assert [named.has_colour for named in together] == [True] * COUNT
    assert together.warnings == []
    # Half a second apart: no colour image is of the time of a depth image.
    apart = FramesOfLog(walk(colour_late_s=0.5).write(tmp_path / "b.mcap"), FrameOptions())
    assert [named.has_colour for named in apart] == [False] * COUNT
    assert apart.warnings == ["3 of 3 depth images have no colour image within 20 ms and were used without"]


def test_logs_without_depth_messages_or_whole_bytes_are_refused(walk, recording, frame, tmp_path: Path) -> None:
    log = recording()
    log.image("/camera/color/image_raw", 0.0, frame.rgb, "rgb8")
    with pytest.raises(LogFormatError, match="neither depth images nor point clouds"):
        read_frames(log.write(tmp_path / "colour.mcap"))
    empty = recording()
    with pytest.raises(LogFormatError, match="no messages"):
        read_frames(empty.write(tmp_path / "empty.mcap"))
    (tmp_path / "nothing.mcap").write_bytes(b"")
    with pytest.raises(LogFormatError):
        read_frames(tmp_path / "nothing.mcap")
    bare = recording()
    bare.image("/depth", 0.0, np.full((240, 320), 1500, np.uint16), "16UC1")
    with pytest.raises(LogFormatError, match=r"no intrinsics.*--camera"):
        read_frames(bare.write(tmp_path / "bare.mcap"))
    whole = walk().write(tmp_path / "walk.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(LogFormatError, match=r"cut\.mcap: not a whole log"):
        read_frames(tmp_path / "cut.mcap")


def test_a_cloud_whose_sizes_contradict_is_refused(recording, frame, points, tmp_path: Path) -> None:
    log = recording()
    add_cloud(log, "/points", 0.0, points(frame), (320, 241))
    with pytest.raises(LogFormatError, match="320×241 points of 32 bytes"):
        list(read_frames(log.write(tmp_path / "walk.mcap")))


def test_repeated_stamps_are_left_out_and_counted(walk, tmp_path: Path) -> None:
    log = walk()
    log.messages += log.messages[-1:]
    source = read_frames(log.write(tmp_path / "walk.mcap"))
    assert len(list(source)) == COUNT
    assert source.warnings == [
        "1 of 4 messages on /camera/depth/image_rect have no later stamp than the one before and were left out"
    ]


@pytest.mark.parametrize("ending", [".csv", ".jsonl"])
def test_see_writes_a_row_per_frame_and_a_summary(walk, capsys, frame, tmp_path: Path, ending: str) -> None:
    path = walk().write(tmp_path / "walk.mcap")
    table = tmp_path / f"walk{ending}"
    assert main(["see", str(path), "--headings", str(table)]) == 0
    said = capsys.readouterr().out
    assert "3 of 3 frames accepted (100 %), median " in said
    rows = list(csv.DictReader(table.open())) if ending == ".csv" else [json.loads(line) for line in table.read_text().splitlines()]
    assert [float(row["heading_deg"]) for row in rows] == pytest.approx([direct(frame)] * COUNT, abs=0.05)
    assert main(["see", str(path), "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["summary"]["accepted_share"] == 1.0
    assert values["summary"]["median_ms"] > 0.0
    assert main(["see", str(path), "--headings", str(table)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["see", str(path), "--headings", str(tmp_path / "walk.xlsx")]) == 2
    assert ".csv or .jsonl" in capsys.readouterr().err
