"""``treadline frames``: a folder that ``treadline see`` reads, with a truth to score it by."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.settings import read_toml
from treadline.plant.sensors.camera import ViewRecipe


def table(path: Path) -> dict[str, dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("options", [(), ("--sensor", "kinect2"), ("--height", "480"), ("--sensor", "ideal", "--open-risers")])
def test_see_reads_the_folder_and_finds_the_true_heading(run, tmp_path: Path, options: tuple[str, ...]) -> None:
    drawn = run("frames", "--out", tmp_path, "--count", 3, "--seed", 4, "--heading=-15,15", *options, "--json")
    assert drawn.code == 0
    assert drawn.values == {"frames": 3, "out": str(tmp_path), "truth": str(tmp_path / "truth.csv"), "seed": 4}
    truth = table(tmp_path / "truth.csv")
    seen = run("see", tmp_path, "--json").values["frames"]
    assert [item["name"] for item in seen] == list(truth) == ["00000", "00001", "00002"]
    for item in seen:
        true = truth[item["name"]]
        assert item["accepted"], item["reason"]
        assert item["heading_deg"] == pytest.approx(float(true["heading_deg"]), abs=0.6)
        edge = [float(true[axis]) for axis in ("edge_x", "edge_y", "edge_z")]
        assert float(np.dot(edge, item["edge_direction"])) > np.cos(1.0 * DEG)


@pytest.mark.parametrize("name", ["camera.toml", "00001_depth.png", "truth.csv"])
def test_a_full_disk_is_one_line_that_names_the_file(run, no_room_for, tmp_path: Path, name: str) -> None:
    """Test: no room is left for one of the files. Expected result: one line, exit code 2; what was written is whole."""
    no_room_for(name)
    outcome = run("frames", "--out", tmp_path, "--count", 2)
    assert (outcome.code, outcome.err.splitlines()[-1]) == (
        2,
        f"treadline: {tmp_path / name}: cannot be written: No space left on device",
    )
    assert not {path.name for path in tmp_path.iterdir()} & {name, f"{name}.part"}


def test_gravity_is_given_with_its_error_and_the_truth_without(run, tmp_path: Path) -> None:
    run("frames", "--out", tmp_path, "--count", 4)
    told, truth = table(tmp_path / "gravity.csv"), table(tmp_path / "truth.csv")
    for name, row in told.items():
        down = [float(row[axis]) for axis in ("x", "y", "z")]
        true = [float(truth[name][f"gravity_{axis}"]) for axis in ("x", "y", "z")]
        assert np.arccos(np.clip(np.dot(down, true), -1.0, 1.0)) == pytest.approx(0.5 * DEG, rel=1e-2)


def test_the_same_seed_gives_the_same_bytes_and_more_frames_leave_the_first(run, tmp_path: Path) -> None:
    few, again, many = tmp_path / "few", tmp_path / "again", tmp_path / "many"
    for folder, count in ((few, 2), (again, 2), (many, 3)):
        assert run("frames", "--out", folder, "--count", count, "--scene", "mixed", "--clutter", "all").code == 0
    assert contents(few) == contents(again)
    first, more = contents(few), contents(many)
    assert all(more[name] == data for name, data in first.items() if name.endswith(".png"))
    other = tmp_path / "other"
    run("frames", "--out", other, "--count", 2, "--scene", "mixed", "--clutter", "all", "--seed", 1)
    assert contents(other)["00000_depth.png"] != first["00000_depth.png"]


def test_depth_is_16_bit_in_millimetres_with_zero_for_no_return(run, tmp_path: Path) -> None:
    run("frames", "--out", tmp_path, "--count", 1, "--clutter", "rail_left", "--sensor", "ideal")
    depth = cv2.imread(str(tmp_path / "00000_depth.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    assert depth.shape == (240, 320)
    assert 500 < np.median(depth[depth > 0]) < 4000
    assert not list(tmp_path.glob("*.part"))


def test_places_without_a_stair_have_no_heading_in_the_truth(run, tmp_path: Path) -> None:
    assert run("frames", "--out", tmp_path, "--count", 6, "--scene", "stairless").code == 0
    for row in table(tmp_path / "truth.csv").values():
        assert row["heading_deg"] == row["slope_deg"] == row["direction"] == ""
        assert row["gravity_z"] != ""


def test_the_truth_holds_the_sides_of_the_flight_and_the_calibration_the_sensor(run, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text('width_m = [0.5, 0.5]\nwalls = ["left"]\nbow_m = [0.03, 0.03]\nsensor = "d455"\nsensor_known = true\n')
    assert run("frames", "--out", tmp_path / "out", "--count", 2, "--recipe", recipe).code == 0
    for row in table(tmp_path / "out" / "truth.csv").values():
        assert float(row["left_edge_m"]) + float(row["right_edge_m"]) == pytest.approx(0.5)
        assert (row["left_side"], row["right_side"]) == ("wall", "open")
        assert (float(row["bow_m"]), float(row["curvature_1_m"])) == (0.03, 0.0)
    assert 'sensor = "d455"\n' in (tmp_path / "out" / "camera.toml").read_text()


@pytest.mark.parametrize(
    ("word", "scenes"), [("down", {"down", "edge", "bottom"}), ("top", {"top"}), ("shelf", {"shelf"}), ("blinds", {"blinds"})]
)
def test_a_scene_is_one_or_several(run, tmp_path: Path, word: str, scenes: set[str]) -> None:
    run("frames", "--out", tmp_path, "--count", 12, "--scene", word)
    assert {row["scene"] for row in table(tmp_path / "truth.csv").values()} == scenes


def test_a_recipe_gives_what_options_leave_open(run, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text('slope_deg = [28.0, 28.0]\nheading_deg = [5.0, 5.0]\nscenes = ["top"]\npitch_deg = [30, 30]\n')
    assert read_toml(recipe, ViewRecipe).scenes == ("top",)
    run("frames", "--out", tmp_path / "out", "--count", 2, "--recipe", recipe, "--heading", "7,7")
    for row in table(tmp_path / "out" / "truth.csv").values():
        assert float(row["slope_deg"]) == pytest.approx(28.0)
        assert float(row["heading_deg"]) == pytest.approx(7.0)
        assert row["scene"] == "top"
    assert "mount_pitch_deg = 30.0" in (tmp_path / "out" / "camera.toml").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scene", "attic"), ("--scene", "attic", "mixed")),
        (("--sensor", "kinect9"), ("sensor", "kinect9")),
        (("--count", "0"), ("--count", "0")),
        (("--seed", "-1"), ("--seed", "-1")),
        (("--height", "7"), ("--height", "7")),
        (("--heading", "10"), ("heading_deg", "two numbers")),
        (("--heading", "20,10"), ("heading_deg", "smaller first")),
        (("--heading", "a,b"), ("--heading", "'a'")),
        (("--clutter", "cat"), ("clutter", "cat")),
    ],
)
def test_what_cannot_be_drawn_is_said_in_one_line(run, tmp_path: Path, options: tuple[str, ...], words: tuple[str, ...]) -> None:
    refused = run("frames", "--out", tmp_path / "out", *options)
    assert refused.code == 2
    assert refused.out == ""
    assert refused.err.count("\n") == 1
    assert all(word in refused.err for word in words)
    assert not (tmp_path / "out").exists()


def test_a_range_of_pitch_is_refused_for_a_folder(run, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text("pitch_deg = [20.0, 30.0]\n")
    refused = run("frames", "--out", tmp_path / "out", "--recipe", recipe)
    assert refused.code == 2
    assert "camera.toml" in refused.err


def test_frames_of_another_run_are_not_mixed_in(run, tmp_path: Path) -> None:
    run("frames", "--out", tmp_path, "--count", 3)
    before = contents(tmp_path)
    refused = run("frames", "--out", tmp_path, "--count", 2, "--seed", 1)
    assert refused.code == 2
    assert "not empty" in refused.err
    assert contents(tmp_path) == before
    assert run("frames", "--out", tmp_path, "--count", 2, "--seed", 1, "--force").code == 0
    assert not (tmp_path / "00002_depth.png").exists()


def test_an_interruption_leaves_tables_of_what_was_finished(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from treadline.plant.sensors.camera import folder

    drawn = folder.draw_view
    calls = []

    def interrupted(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return drawn(*arguments)

    monkeypatch.setattr(folder, "draw_view", interrupted)
    assert run("frames", "--out", tmp_path, "--count", 5).code == 130
    assert list(table(tmp_path / "truth.csv")) == list(table(tmp_path / "gravity.csv")) == ["00000", "00001"]
    assert len(run("see", tmp_path, "--json").values["frames"]) == 2
