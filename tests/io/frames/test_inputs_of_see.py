"""``treadline see`` with clouds, folders of clouds, and run logs; random damage is one line."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_files import points_of_frame, write_calibration, write_pcd

from treadline.cli import main
from treadline.io.mcap_log import RunLog


def seen(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, Any]:
    """Return what the command prints as JSON."""
    assert main(["see", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_cloud_is_an_answer_with_its_exit_code(rendered, capsys, tmp_path: Path) -> None:
    frame = rendered()
    points = points_of_frame(frame)
    path = write_pcd(tmp_path / "a.pcd", points, (320, 240))
    # About the camera's own axis: tan 12° · cos 40° is that of 9.2° (docs/frames.md).
    assert seen(capsys, path, "--out", tmp_path / "out")["heading_deg"] == pytest.approx(9.2, abs=0.2)
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["a-seen.png"]
    values = seen(capsys, path, "--camera", write_calibration(tmp_path / "camera.toml", frame.camera))
    assert values["mount_known"]
    assert values["heading_deg"] == pytest.approx(12.0, abs=0.2)
    wall = points_of_frame(replace(frame, depth_m=np.full_like(frame.depth_m, 1.5)))
    assert main(["see", str(write_pcd(tmp_path / "w.pcd", wall, (320, 240)))]) == 1
    assert "no heading" in capsys.readouterr().out
    assert main(["see", str(write_pcd(tmp_path / "mm.pcd", points, (320, 240), 1000.0))]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "--unit mm" in said.err


def test_a_folder_of_clouds_is_read_cloud_by_cloud(rendered, capsys, tmp_path: Path) -> None:
    for name in ("a.pcd", "b.pcd", "c.pcd"):
        write_pcd(tmp_path / name, points_of_frame(rendered()), (320, 240))
    (tmp_path / "b.pcd").write_bytes(b"no cloud")
    values = seen(capsys, tmp_path)
    assert [item["accepted"] for item in values["frames"]] == [True, False, True]
    assert "b.pcd: not a PCD file" in values["frames"][1]["reason"]
    assert values["summary"]["accepted"] == 2
    for path in tmp_path.iterdir():
        path.write_bytes(b"no cloud")
    assert main(["see", str(tmp_path)]) == 2


def test_a_run_folder_with_images_is_read_like_a_recording(rendered, tmp_path: Path, capsys) -> None:
    run = tmp_path / "run"
    with RunLog(run / "log.mcap", image_every=1) as log:
        for number in range(3):
            log(replace(rendered(), t_s=0.1 * number))
    values = seen(capsys, run / "log.mcap")
    assert [item["t_s"] for item in values["frames"]] == pytest.approx([0.0, 0.1, 0.2])
    assert values["summary"]["accepted"] == 3
    assert seen(capsys, run)["frames"][0]["mount_known"] is False
    (run / "manifest.json").write_text('{"settings": {}, "seed": 0, "command": "treadline climb"}')
    for path in (run, run / "log.mcap"):
        first = seen(capsys, path)["frames"][0]
        # The manifest names the chair, and the chair has the mount of its camera.
        assert first["mount_known"]
        assert first["heading_deg"] == pytest.approx(12.0, abs=0.2)
