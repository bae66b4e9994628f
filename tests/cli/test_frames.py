"""``treadline frames``: a folder that ``treadline see`` reads, with a truth to score it by."""

import csv
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from treadline.core.angles import DEG


def table(path: Path) -> dict[str, dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize(("direction", "sensor"), [("down", "kinect1"), ("up", "kinect2"), ("up", "d435")])
def test_see_reads_the_folder_and_finds_the_true_heading(run, tmp_path: Path, direction: str, sensor: str) -> None:
    scenario = tmp_path / "stair.toml"
    scenario.write_text(f'[start]\nplace = "landing"\n[drive]\ndirection = "{direction}"\n' if direction == "down" else "")
    out = tmp_path / "frames"
    drawn = run("frames", scenario, "--out", out, "--count", 2, "--seed", 4, "--heading=-15,15", "--sensor", sensor, "--json")
    assert drawn.code == 0
    assert drawn.values == {"frames": 2, "out": str(out), "truth": str(out / "truth.csv"), "seed": 4}
    truth = table(out / "truth.csv")
    seen = run("see", out, "--json").values["frames"]
    assert [item["name"] for item in seen] == list(truth) == ["00000", "00001"]
    for item in seen:
        true = truth[item["name"]]
        assert item["accepted"], item["reason"]
        assert abs(float(true["heading_deg"])) <= 15.0
        assert item["heading_deg"] == pytest.approx(float(true["heading_deg"]), abs=0.6)
        assert item["stair"]["rise_m"] == pytest.approx(float(true["rise_m"]), abs=0.01)
        edge = [float(true[axis]) for axis in ("edge_x", "edge_y", "edge_z")]
        assert abs(float(np.dot(edge, item["edge_direction"]))) > np.cos(1.0 * DEG)


def test_a_full_disk_is_one_line_that_names_the_file(run, no_room_for, tmp_path: Path) -> None:
    """Test: no room is left for one of the files. Expected result: one line, exit code 2; what was written is whole."""
    no_room_for("truth.csv")
    outcome = run("frames", "--out", tmp_path, "--count", 1)
    said = f"treadline: {tmp_path / 'truth.csv'}: cannot be written: No space left on device"
    assert (outcome.code, outcome.err.splitlines()[-1]) == (2, said)
    assert not {path.name for path in tmp_path.iterdir()} & {"truth.csv", "truth.csv.part"}


def test_the_same_seed_gives_the_same_bytes_and_nothing_of_an_earlier_run_is_left(run, tmp_path: Path) -> None:
    few, again = tmp_path / "few", tmp_path / "again"
    for folder, count in ((few, 1), (again, 2)):
        assert run("frames", "--out", folder, "--count", count).code == 0
    first, more = contents(few), contents(again)
    assert all(more[name] == data for name, data in first.items() if name.endswith(".png"))
    assert run("frames", "--out", again, "--count", 1, "--force").code == 0
    assert contents(again) == first
    assert run("frames", "--out", again, "--count", 1, "--seed", 1, "--force").code == 0
    assert contents(again)["00000_depth.png"] != first["00000_depth.png"]
    depth = cv2.imread(str(few / "00000_depth.png"), cv2.IMREAD_UNCHANGED)  # in millimetres; zero for no return
    assert (depth.dtype, depth.shape, depth.all()) == (np.uint16, (240, 320), False)
    assert 500 < np.median(depth[depth > 0]) < 4000


def test_an_interruption_leaves_tables_of_what_was_finished(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from treadline.plant.sensors import camera

    rendered = camera.stair_frames

    def interrupted(*arguments: object, **options: object) -> Iterator[object]:
        for number, item in enumerate(rendered(*arguments, **options)):
            if number == 2:
                raise KeyboardInterrupt
            yield item

    monkeypatch.setattr(camera, "stair_frames", interrupted)
    assert run("frames", "--out", tmp_path, "--count", 5).code == 130
    assert list(table(tmp_path / "truth.csv")) == list(table(tmp_path / "gravity.csv")) == ["00000", "00001"]
    assert len(run("see", tmp_path, "--json").values["frames"]) == 2
