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
POINTS = np.random.default_rng(1).uniform(0.5, 3.0, (WIDTH * HEIGHT, 3)).astype(np.float32)
POINTS[7] = np.nan
COLOURS = np.random.default_rng(2).integers(0, 256, (WIDTH * HEIGHT, 3), dtype=np.uint8)
GRID = f"obj_info num_cols {WIDTH}\nobj_info num_rows {HEIGHT}\n"


def body_of(rows: np.ndarray, *, is_text: bool) -> bytes:
    return "".join(" ".join(map(str, row)) + "\n" for row in rows.tolist()).encode() if is_text else rows.tobytes()


def ply(layout: str, extra: str = "") -> bytes:
    """Return a PLY file, by the format's description."""
    order = ">" if "big" in layout else "<"
    kind = np.dtype([(name, f"{order}f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")])
    rows = np.rec.fromarrays([*POINTS.T, *COLOURS.T], kind)
    properties = "".join(f"property {'float' if name in 'xyz' else 'uchar'} {name}\n" for name in kind.names or ())
    header = f"ply\nformat {layout} 1.0\ncomment made by a test\n{extra}element vertex {len(POINTS)}\n{properties}"
    faces = "element face 0\nproperty list uchar int vertex_indices\n"
    return (header + faces + "end_header\n").encode() + body_of(rows, is_text=layout == "ascii")


def pcd(layout: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> bytes:
    """Return a PCD file of version 0.7, by the format's description; its compressed data is a series of literals."""
    packed = COLOURS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    rows = np.rec.fromarrays([*POINTS.T, packed], np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")]))
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {size[0]}\nHEIGHT {size[1]}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(POINTS)}\nDATA {layout}\n"
    )
    body = body_of(rows, is_text=layout == "ascii")
    if layout == "binary_compressed":
        plain = b"".join(rows[name].tobytes() for name in ("x", "y", "z", "rgb"))
        data = b"".join(bytes([len(plain[at : at + 32]) - 1]) + plain[at : at + 32] for at in range(0, len(plain), 32))
        body = struct.pack("<II", len(data), len(plain)) + data
    return header.encode() + body


def viewport() -> bytes:
    """Return a PLY file whose grid is that of PCL's camera."""
    camera = f"element camera 1\nproperty int viewportx\nproperty int viewporty\nelement vertex {len(POINTS)}\n".encode()
    data = ply("ascii").replace(f"element vertex {len(POINTS)}\n".encode(), camera)
    return data.replace(b"end_header\n", f"end_header\n{WIDTH} {HEIGHT}\n".encode())


SOUND = {
    **{f"{layout}.ply": (ply(layout), None) for layout in ("ascii", "binary_little_endian", "binary_big_endian")},
    "grid.ply": (ply("binary_little_endian", GRID), (WIDTH, HEIGHT)),
    "viewport.ply": (viewport(), (WIDTH, HEIGHT)),
    **{f"{layout}.pcd": (pcd(layout), (WIDTH, HEIGHT)) for layout in ("ascii", "binary", "binary_compressed")},
    "row.pcd": (pcd("binary", (WIDTH * HEIGHT, 1)), None),
}
"""Files, and the size of their grid."""


@pytest.mark.parametrize("name", SOUND)
def test_a_cloud_of_any_layout_has_its_points_colours_and_size(tmp_path: Path, name: str) -> None:
    data, size = SOUND[name]
    (tmp_path / name).write_bytes(data)
    read = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(read.points, POINTS)
    np.testing.assert_array_equal(read.rgb, COLOURS)
    assert read.size_px == size


@pytest.mark.parametrize(("layout", "promised"), [("binary", 10**12), ("binary_compressed", 40_000_000), ("ascii", 40_000_000)])
def test_a_header_that_promises_more_than_the_file_holds_takes_no_memory(tmp_path: Path, layout: str, promised: int) -> None:
    whole = pcd(layout).replace(b"WIDTH 40\nHEIGHT 30", f"WIDTH {promised}\nHEIGHT 1".encode())
    (tmp_path / "a.pcd").write_bytes(whole.replace(b"POINTS 1200", f"POINTS {promised}".encode()))
    tracemalloc.start()
    with pytest.raises(ImageError, match=r"at most|declares|truncated"):
        read_cloud(tmp_path / "a.pcd")
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("binary_little_endian.ply", b"property float z", b"property float w", "no field 'z'"),
        ("binary_little_endian.ply", b"element vertex 1200", b"element vertex 99999999", "at most 50000000"),
        ("binary_little_endian.ply", b"element vertex 1200", b"element vertex 1201", "truncated: 1200 of 1201"),
        ("ascii.ply", b"element vertex 1200", b"element vertex 1201", "truncated: 1200 of 1201"),
        ("ascii.ply", b"property float z", b"property float z\nproperty float w", "6 numbers on a line; 7 are declared"),
        ("ascii.ply", b"element vertex", b"element face 1\nproperty list int int i\nelement vertex", "a list stands before"),
        ("binary.pcd", b"FIELDS x y z rgb", b"FIELDS x y w rgb", "no field 'z'"),
        ("binary.pcd", b"WIDTH 40", b"WIDTH 41", "1200 points in 41×30"),
    ],
)
def test_damaged_headers_are_named(tmp_path: Path, name: str, old: bytes, new: bytes, words: str) -> None:
    whole, _ = SOUND[name]
    assert old in whole
    (tmp_path / name).write_bytes(whole.replace(old, new, 1))
    with pytest.raises(ImageError, match=words):
        read_cloud(tmp_path / name)


def test_what_is_missing_is_named_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ImageError, match="no such file"):
        read_cloud(tmp_path / "a.ply")
    (tmp_path / "a.pcd").write_bytes(pcd("binary"))
    monkeypatch.setitem(sys.modules, "pypcd4.pypcd4", None)
    with pytest.raises(ImageError, match="pip install pypcd4"):
        read_cloud(tmp_path / "a.pcd")
