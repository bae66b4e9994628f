"""Frames of recordings: topics found by type, clouds like images, damaged and ambiguous logs named."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_files import add_cloud, points_of_frame, write_calibration

from treadline.cli import main
from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError
from treadline.io.frames import read_frames
from treadline.io.frames.evaluation import FrameEvaluator

RATE_HZ = 30.0
COUNT = 3
WALL = RgbdFrame(
    t_s=0.0,
    rgb=np.zeros((24, 32, 3), np.uint8),
    depth_m=np.full((24, 32), 1.5, np.float32),
    camera=PinholeCamera(width_px=32, height_px=24, fx_px=30.0, fy_px=30.0, cx_px=15.5, cy_px=11.5),
)
Walk = Callable[..., Any]


@pytest.fixture
def frame(rendered) -> RgbdFrame:
    """Return a frame from a flight."""
    return rendered()


@pytest.fixture
def walk(recording) -> Walk:
    """Return a recording of one view: depth and calibration."""

    def record(frame: RgbdFrame, *, ros1: bool = False) -> Any:
        log = recording(ros1=ros1)
        for t_s in np.arange(COUNT) / RATE_HZ:
            log.calibration("/camera/depth/camera_info", t_s, frame.camera)
            counts = np.round(np.nan_to_num(frame.depth_m) * 1000.0).astype(np.uint16)
            log.image("/camera/depth/image_rect", t_s, counts, "16UC1")
        return log

    return record


def headings(source) -> list[float | None]:
    return [values["heading_deg"] for _, values in map(FrameEvaluator("robust").evaluate, source)]


def direct(frame) -> float:
    bare = replace(frame, camera=replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0)))
    (heading,) = headings([NamedFrame(name="a", frame=bare, mount_known=False, gravity_C=None)])
    assert heading is not None
    return heading


@pytest.mark.parametrize("ending", [".mcap", ".bag", ""])  # MCAP of ROS 2, bag of ROS 1, folder of a bag of ROS 2
def test_depth_images_and_clouds_of_a_log_give_the_heading_of_their_frame(
    walk: Walk, recording, frame, tmp_path: Path, ending: str
) -> None:
    path = walk(frame, ros1=ending == ".bag").write(tmp_path / f"walk{ending}")
    found = list(read_frames(path))
    assert [named.t_s for named in found] == pytest.approx([number / RATE_HZ for number in range(COUNT)])
    assert not any(named.has_colour for named in found)
    # Depth rounded to a millimetre costs next to nothing.
    assert headings(found) == pytest.approx([direct(frame)] * COUNT, abs=0.05)
    log = recording(ros1=ending == ".bag")
    add_cloud(log, "/camera/points", 0.0, points_of_frame(frame), (320, 240))
    known = points_of_frame(frame)[np.isfinite(frame.depth_m).ravel()]
    add_cloud(log, "/camera/points", 0.1, known, (len(known), 1))
    source = read_frames(log.write(tmp_path / f"clouds{ending}"))
    # The property of clouds: within 0.05° of the depth image.
    assert headings(source) == pytest.approx([direct(frame)] * 2, abs=0.05)
    assert list(source.warnings) == []


def test_a_calibration_file_has_precedence_over_that_of_the_log(walk: Walk, tmp_path: Path) -> None:
    path = walk(WALL).write(tmp_path / "walk.mcap")
    (first, *_) = read_frames(path, camera=write_calibration(tmp_path / "right.toml", replace(WALL.camera, fx_px=31.0)))
    assert first.mount_known
    assert (first.frame.camera.fx_px, first.frame.camera.mount_pitch_rad) == (31.0, pytest.approx(np.deg2rad(40.0)))
    small = write_calibration(tmp_path / "small.toml", replace(WALL.camera, width_px=16, height_px=16, cx_px=8.0, cy_px=8.0))
    with pytest.raises(ImageError, match=r"an image of 32×24 at 0\.000 s, calibrated for 16×16"):
        list(read_frames(path, camera=small))


@pytest.mark.parametrize("ending", [".csv", ".jsonl"])
def test_see_writes_a_row_per_frame_and_a_summary(walk: Walk, capsys, frame, tmp_path: Path, ending: str) -> None:
    path = walk(frame).write(tmp_path / "walk.mcap")
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
