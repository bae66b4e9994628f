"""Elevation maps as views along their axes: heading, rise and run of a known stair, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from treadline.cli import main
from treadline.core.angles import DEG
from treadline.core.errors import ImageError, SettingsError
from treadline.io.frames import read_frames
from treadline.perception import StairDetector

RISE_M, RUN_M = 0.17, 0.29


def heights(cell_m: float, turn_rad: float) -> Float[np.ndarray, "h w"]:
    """Return a map of 5 × 4 m with a flight of seven steps, 1.2 m wide, that ascends at an angle from +x towards +y."""
    x, y = cell_m * (np.arange(round(5.0 / cell_m)) + 0.5) - 1.9, 2.0 - cell_m * (np.arange(round(4.0 / cell_m)) + 0.5)
    X, Y = np.meshgrid(x, y)
    along, across = X * np.cos(turn_rad) + Y * np.sin(turn_rad), Y * np.cos(turn_rad) - X * np.sin(turn_rad)
    return np.where(np.abs(across) < 0.6, RISE_M * np.clip(np.floor(along / RUN_M) + 1.0, 0.0, 7.0), 0.0)


def seen(path: Path, grid: float) -> dict:
    frames = read_frames(path, grid=grid)
    return {named.name.removeprefix(path.stem): StairDetector().look(named.frame, named.gravity_C) for named in frames}


@pytest.mark.parametrize("cell_m", [0.02, 0.05])
@pytest.mark.parametrize("turn_deg", [0.0, 10.0, -25.0, 35.0])
def test_a_known_stair_is_seen_from_its_foot_and_from_its_top(tmp_path: Path, cell_m: float, turn_deg: float) -> None:
    np.save(tmp_path / "map.npy", heights(cell_m, turn_deg * DEG))
    found = seen(tmp_path / "map.npy", cell_m)
    for axis, direction in (("+x", "up"), ("-x", "down")):
        assert found[axis].accepted, found[axis].reason
        assert found[axis].shape.direction == direction
        # A map leaves a nosing as stairs of cells: 0.44° at most at 5 cm.
        assert found[axis].heading_rad / DEG == pytest.approx(-turn_deg, abs=0.6)
        assert found[axis].shape.rise_m == pytest.approx(RISE_M, abs=0.006)
        assert found[axis].shape.run_m == pytest.approx(RUN_M, abs=0.008)


@pytest.mark.parametrize(("turns", "axis"), [(0, "+x"), (1, "+y"), (2, "-x"), (3, "-y")])
def test_each_axis_of_the_picture_from_above_has_its_view(tmp_path: Path, turns: int, axis: str) -> None:
    np.savez(tmp_path / "map.npz", heights=np.rot90(heights(0.05, 10.0 * DEG), turns))
    found = seen(tmp_path / "map.npz", 0.05)
    (up,) = (name for name, sight in found.items() if sight.accepted and sight.shape.direction == "up")
    assert up == axis
    assert found[up].heading_rad / DEG == pytest.approx(-10.0, abs=0.6)
    # The chair frame is that of the middle of the map: the first nosing is 0.6 m before it.
    assert found[up].stair_map.nosings_B[0][0] == pytest.approx(-0.6, abs=0.05)


def test_level_ground_has_its_depth_and_unknown_cells_have_none(tmp_path: Path) -> None:
    level = np.full((100, 100), 0.3)
    level[60:, :] = np.nan
    np.savetxt(tmp_path / "map.csv", 1e3 * level, delimiter=",")
    frame = next(iter(read_frames(tmp_path / "map.csv", grid=0.05, unit="mm"))).frame
    v, u = np.indices(frame.depth_m.shape)
    points_B = frame.camera.pixel_to_point(u, v, frame.depth_m) @ frame.camera.R_BC.T + frame.camera.mount_m
    known = np.isfinite(frame.depth_m)
    np.testing.assert_allclose(points_B[known][:, 2], 0.0, atol=1e-5)
    # Rows from the 60th on are those at the lowest y, on the right.
    assert points_B[known][:, 1].min() == pytest.approx(-0.5, abs=0.02)
    assert points_B[known][:, 1].max() == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize(
    ("content", "grid", "words"),
    [
        (heights(0.05, 0.0), 0.0, "--grid is 0; it is the side of a cell"),
        (heights(0.05, 0.0), -0.05, "--grid is -0.05"),
        (heights(0.05, 0.0), float("nan"), "--grid is nan"),
        (np.zeros((1, 1)), 0.05, "1 cells with a height"),
        (np.full((80, 80), np.nan), 0.05, "0 cells with a height"),
        (np.zeros((3, 40, 40)), 0.05, "3 dimensions"),
        (np.zeros((40, 40), complex), 0.05, "no grid of heights"),
        (1e3 * heights(0.05, 0.0), 0.05, "in millimetres"),
    ],
)
def test_what_is_no_map_is_named(tmp_path: Path, content: np.ndarray, grid: float, words: str) -> None:
    np.save(tmp_path / "map.npy", content)
    with pytest.raises((ImageError, SettingsError), match=words):
        read_frames(tmp_path / "map.npy", grid=grid)


@pytest.mark.parametrize(("name", "text"), [("a.csv", "1,2\n3,x\n"), ("b.csv", "1,2\n3\n"), ("c.npy", "no array"), ("d.npz", "PK")])
def test_damaged_files_are_one_line(tmp_path: Path, name: str, text: str, capsys) -> None:
    (tmp_path / name).write_text(text)
    for words in ([str(tmp_path / name)], [str(tmp_path / "none.npy")]):
        assert main(["see", *words, "--grid", "0.05"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert main(["see", str(tmp_path / name), "--grid", "0.05", "--axes", "ros"]) == 2
    assert "--grid goes with --unit alone" in capsys.readouterr().err
