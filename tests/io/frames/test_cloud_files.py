"""PLY and PCD files: all layouts give the same points; damaged files are one line."""

import struct
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import ImageError
from treadline.io.frames._cloud_files import read_cloud

WIDTH, HEIGHT = 40, 30


@pytest.fixture
def cloud() -> np.ndarray:
    """Return points with one hole and 8-bit colours."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0.5, 3.0, (WIDTH * HEIGHT, 3)).astype(np.float32)
    points[7] = np.nan
    return points


@pytest.fixture
def colours() -> np.ndarray:
    """Return a colour per point."""
    return np.random.default_rng(2).integers(0, 256, (WIDTH * HEIGHT, 3), dtype=np.uint8)


def ply(points: np.ndarray, colours: np.ndarray, layout: str, extra: str = "") -> bytes:
    """Return a PLY file, by the format's description."""
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(layout, "=")
    kind = np.dtype([(name, order + "f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")])
    rows = np.zeros(len(points), kind)
    for j in range(3):
        rows["xyz"[j]], rows[("red", "green", "blue")[j]] = points[:, j], colours[:, j]
    properties = "".join(f"property {'float' if name in 'xyz' else 'uchar'} {name}\n" for name in kind.names or ())
    header = f"ply\nformat {layout} 1.0\ncomment made by a test\n{extra}element vertex {len(points)}\n{properties}"
    body = rows.tobytes()
    if layout == "ascii":
        body = "".join(" ".join(str(cell) for cell in row) + "\n" for row in rows.tolist()).encode()
    faces = "element face 0\nproperty list uchar int vertex_indices\n"
    return (header + faces + "end_header\n").encode() + body


def pcd(points: np.ndarray, colours: np.ndarray, layout: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> bytes:
    """Return a PCD file of version 0.7, by the format's description; its compressed data is a series of literals."""
    packed = (colours.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)).astype(np.uint32)
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
    rows = np.zeros(len(points), kind)
    rows["x"], rows["y"], rows["z"], rows["rgb"] = *points.T, packed
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {size[0]}\nHEIGHT {size[1]}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {layout}\n"
    )
    body = rows.tobytes()
    if layout == "ascii":
        body = "".join(" ".join(str(cell) for cell in row) + "\n" for row in rows.tolist()).encode()
    elif layout == "binary_compressed":
        plain = b"".join(rows[name].tobytes() for name in kind.names or ())
        pieces = [plain[at : at + 32] for at in range(0, len(plain), 32)]
        data = b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)
        body = struct.pack("<II", len(data), len(plain)) + data
    return header.encode() + body


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_file_has_its_points_and_colours(tmp_path: Path, cloud, colours, layout: str) -> None:
    (tmp_path / "a.ply").write_bytes(ply(cloud, colours, layout))
    read = read_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.points, cloud)
    np.testing.assert_array_equal(read.rgb, colours)
    assert read.size_px is None


def test_a_ply_file_can_declare_its_grid(tmp_path: Path, cloud, colours) -> None:
    grid = f"obj_info num_cols {WIDTH}\nobj_info num_rows {HEIGHT}\n"
    (tmp_path / "a.ply").write_bytes(ply(cloud, colours, "binary_little_endian", grid))
    assert read_cloud(tmp_path / "a.ply").size_px == (WIDTH, HEIGHT)
    camera = f"element camera 1\nproperty int viewportx\nproperty int viewporty\nelement vertex {len(cloud)}\n"
    data = ply(cloud, colours, "ascii").replace(f"element vertex {len(cloud)}\n".encode(), camera.encode())
    (tmp_path / "a.ply").write_bytes(data.replace(b"end_header\n", f"end_header\n{WIDTH} {HEIGHT}\n".encode()))
    assert read_cloud(tmp_path / "a.ply").size_px == (WIDTH, HEIGHT)


@pytest.mark.parametrize("layout", ["ascii", "binary", "binary_compressed"])
def test_a_pcd_file_has_its_points_colours_and_size(tmp_path: Path, cloud, colours, layout: str) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd(cloud, colours, layout))
    read = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(read.points, cloud)
    np.testing.assert_array_equal(read.rgb, colours)
    assert read.size_px == (WIDTH, HEIGHT)
    (tmp_path / "a.pcd").write_bytes(pcd(cloud, colours, layout, (WIDTH * HEIGHT, 1)))
    assert read_cloud(tmp_path / "a.pcd").size_px is None


def test_a_header_that_promises_more_than_the_file_holds_takes_no_memory(tmp_path: Path, cloud, colours) -> None:
    for layout, promised in (("binary", 10**12), ("binary_compressed", 40_000_000), ("ascii", 40_000_000)):
        whole = pcd(cloud, colours, layout).replace(b"WIDTH 40\nHEIGHT 30", f"WIDTH {promised}\nHEIGHT 1".encode())
        (tmp_path / "a.pcd").write_bytes(whole.replace(b"POINTS 1200", f"POINTS {promised}".encode()))
        tracemalloc.start()
        with pytest.raises(ImageError, match=r"at most|declares|truncated"):
            read_cloud(tmp_path / "a.pcd")
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "old", "new", "word"),
    [
        ("a.ply", b"property float z", b"property float w", "no field 'z'"),
        ("a.ply", b"element vertex 1200", b"element vertex 99999999", "truncated|at most"),
        ("a.ply", b"format binary_little_endian", b"format text", "format"),
        ("a.ply", b"property uchar red", b"property colour red", "damaged"),
        ("a.pcd", b"FIELDS x y z rgb", b"FIELDS x y w rgb", "no field 'z'"),
        ("a.pcd", b"WIDTH 40", b"WIDTH 41", "1200 points in 41×30"),
        ("a.pcd", b"DATA binary", b"DATA zipped", "supported: ascii"),
        ("a.pcd", b"SIZE 4 4 4 4", b"SIZE 4 4 4", "damaged"),
    ],
)
def test_damaged_headers_are_named(tmp_path: Path, cloud, colours, name: str, old: bytes, new: bytes, word: str) -> None:
    whole = ply(cloud, colours, "binary_little_endian") if name.endswith("ply") else pcd(cloud, colours, "binary")
    assert old in whole
    (tmp_path / name).write_bytes(whole.replace(old, new))
    with pytest.raises(ImageError, match=word):
        read_cloud(tmp_path / name)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="no such file"):
        read_cloud(tmp_path / "a.ply")


def test_a_missing_reader_of_pcd_files_is_named_with_its_remedy(
    tmp_path: Path, cloud, colours, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd(cloud, colours, "binary"))
    monkeypatch.setitem(sys.modules, "pypcd4.pypcd4", None)
    with pytest.raises(ImageError, match="pip install pypcd4"):
        read_cloud(tmp_path / "a.pcd")
