"""Point clouds: PLY files (ASCII, binary of both byte orders), PCD files (ASCII, binary, compressed) and PointCloud2 messages.

Coordinates are the fields x, y, z. A PCD file with HEIGHT > 1 is organised, and so is a PLY file whose grid size is declared: by
``obj_info num_cols`` and ``num_rows`` (range grids) or by the viewport of PCL's camera element. PCD files are read by pypcd4
(decision 0008).
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import recfunctions

from treadline.core.errors import ImageError, LogFormatError, one_line
from treadline.core.files import bytes_of
from treadline.io.frames.point_cloud import PointCloud

ENDINGS = (".ply", ".pcd")
"""File name endings of point clouds."""
MOST_POINTS = 50_000_000
"""Largest number of points: forty times that of a depth camera of 1280×960."""
HEADER_BYTES = 65536
"""Longest accepted header; usual headers have a few hundred bytes."""
PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
"""Number types of PLY properties."""
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
"""Message type of point clouds."""
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Number types of ``sensor_msgs/PointField``."""


def read_cloud(path: Path) -> PointCloud:
    """Return the cloud in a PLY or PCD file, in its own unit and axes.

    Raises:
        ImageError: If the file is missing, truncated, or not such a file.
    """
    data = bytes_of(path, "a point cloud", ImageError)
    try:
        return _ply(data) if path.suffix.lower() == ".ply" else _pcd(data)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None
    except ImportError as error:
        raise ImageError(f"{path}: PCD files need pypcd4, which does not load ({error}): pip install pypcd4") from None
    except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception in the parsers
        raise ImageError(f"{path}: damaged point cloud: {one_line(error)}; export it again") from None


def cloud_of(values: np.ndarray, size_px: tuple[int, int] | None, t_s: float = 0.0) -> PointCloud:
    """Return a cloud from a structured array with the fields x, y, z and, if present, a colour.

    Raises:
        ImageError: If a coordinate is missing.
    """
    names = values.dtype.names or ()
    missing = [name for name in "xyz" if name not in names]
    if missing:
        raise ImageError(f"no field '{missing[0]}' (there are: {', '.join(names)}); a cloud needs x, y and z")
    kind = np.result_type(np.float32, *(values.dtype[name] for name in "xyz"))  # map coordinates need double precision
    points = np.stack([values[name].astype(kind.newbyteorder("=")) for name in "xyz"], axis=1)
    return PointCloud(points=points, size_px=size_px, rgb=_colours(values, names), t_s=t_s)


def _colours(values: np.ndarray, names: Sequence[str]) -> np.ndarray | None:
    """Return separate 8-bit colours, or those that PCL packs into one number of 32 bits."""
    for split in (("red", "green", "blue"), ("r", "g", "b")):
        if set(split) <= set(names) and all(values.dtype[name] == np.uint8 for name in split):
            return np.stack([values[name] for name in split], axis=1)
    packed = next((name for name in ("rgb", "rgba") if name in names and values.dtype[name].itemsize == 4), None)
    if packed is None:
        return None
    numbers = values[packed]
    bits = np.ascontiguousarray(numbers.astype(numbers.dtype.newbyteorder("="))).view(np.uint32)
    return np.stack([(bits >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=1)


class _Element(NamedTuple):
    """Element of a PLY file: its name, number and properties."""

    name: str
    rows: int
    fields: list[tuple[str, str]]
    has_lists: bool


def _ply(data: bytes) -> PointCloud:
    if not data.startswith(b"ply"):
        raise ImageError("not a PLY file: it does not begin with 'ply'")
    head, sign, _ = data[:HEADER_BYTES].partition(b"end_header")
    if not sign:
        raise ImageError("truncated PLY file: the header has no end")
    start = data.index(b"\n", len(head)) + 1
    layout, elements, grid = _ply_header(head.decode("ascii", "replace").splitlines())
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[layout]
    found: dict[str, np.ndarray] = {}
    text = io.BytesIO(data[start:])
    for element in elements:
        if element.has_lists:
            if "vertex" in found:
                break  # faces follow the vertices, and are not needed
            raise ImageError(f"the element '{element.name}' with a list stands before the vertices; export points alone")
        if not 0 <= element.rows <= MOST_POINTS:
            raise ImageError(f"{element.rows} of the element '{element.name}'; at most {MOST_POINTS}")
        kind = np.dtype([(name, (order or "=") + number) for name, number in element.fields])
        found[element.name] = _rows(text, kind, element.rows, is_text=layout == "ascii")
    if "vertex" not in found:
        raise ImageError("no element 'vertex': a mesh or a point cloud is needed")
    camera = found.get("camera")
    if grid is None and camera is not None and len(camera) and {"viewportx", "viewporty"} <= set(camera.dtype.names or ()):
        grid = int(camera["viewportx"][0]), int(camera["viewporty"][0])
    organised = grid is not None and min(grid) > 1 and grid[0] * grid[1] == len(found["vertex"])
    return cloud_of(found["vertex"], grid if organised else None)


def _ply_header(lines: list[str]) -> tuple[str, list[_Element], tuple[int, int] | None]:
    layout, elements, grid = "", [], {}
    for words in (line.split() for line in lines[1:]):
        match words:
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as layout, *_]:
                pass
            case ["element", name, count]:
                elements.append(_Element(name, int(count), [], has_lists=False))
            case ["property", "list", *_]:
                elements[-1] = elements[-1]._replace(has_lists=True)
            case ["property", number, name]:
                elements[-1].fields.append((name, PLY_TYPES[number]))
            case ["obj_info", ("num_cols" | "num_rows") as side, count]:
                grid[side] = int(count)
            case _:
                pass
    if not layout:
        raise ImageError("damaged PLY header: no format ascii, binary_little_endian or binary_big_endian")
    return layout, elements, (grid["num_cols"], grid["num_rows"]) if len(grid) == 2 else None


def _pcd(data: bytes) -> PointCloud:
    head, sign, rest = data[:HEADER_BYTES].partition(b"\nDATA ")
    if not sign:
        raise ImageError("not a PCD file, or a truncated one: its header has no line DATA")
    layout, body = rest.split(b"\n", 1)[0].strip(), data[data.index(b"\n", len(head) + len(sign)) + 1 :]
    if layout not in {b"ascii", b"binary", b"binary_compressed"}:
        raise ImageError(f"DATA is '{layout.decode('ascii', 'replace')[:40]}'; supported: ascii, binary, binary_compressed")
    from pypcd4.pypcd4 import MetaData
    from pypcd4.pypcd4 import PointCloud as PcdFile

    header = MetaData.parse_header(head.decode("ascii", "replace").splitlines())
    count, size = header.points, (header.width, header.height)
    if count != size[0] * size[1] or count > MOST_POINTS:
        raise ImageError(f"{count} points in {size[0]}×{size[1]}; at most {MOST_POINTS}, as many as width × height")
    plain = count * header.build_dtype().itemsize
    if layout == b"binary_compressed" and int.from_bytes(body[4:8], "little") != plain:
        raise ImageError(f"declares {int.from_bytes(body[4:8], 'little')} bytes for {count} points of {plain} bytes in all")
    values = np.atleast_1d(PcdFile.from_fileobj(io.BufferedReader(io.BytesIO(data))).pc_data)
    if len(values) < count:
        raise ImageError(f"truncated: {len(values)} of {count} points")
    return cloud_of(values, size if min(size) > 1 else None)


def _rows(stream: io.BytesIO, kind: np.dtype, count: int, *, is_text: bool) -> np.ndarray:
    """Return the next rows of a stream, as text or binary."""
    if not is_text:
        data = stream.read(count * kind.itemsize)
        if len(data) < count * kind.itemsize:
            raise ImageError(f"truncated: {len(data) // max(kind.itemsize, 1)} of {count} points")
        return np.frombuffer(data, kind)
    if count == 0:
        return np.zeros(0, kind)
    lines = [line for _ in range(count) if (line := stream.readline())]
    if len(lines) < count:
        raise ImageError(f"truncated: {len(lines)} of {count} points")
    table = np.loadtxt(lines, dtype=float, ndmin=2)
    columns = sum(int(np.prod(kind[name].shape)) for name in kind.names or ())
    if table.shape[1] < columns:
        raise ImageError(f"{table.shape[1]} numbers on a line; {columns} are declared")
    with np.errstate(invalid="ignore", over="ignore"):
        return recfunctions.unstructured_to_structured(table[:, :columns], kind, casting="unsafe")


def point_cloud(message: Any) -> np.ndarray:
    """Return the points of a sensor_msgs/PointCloud2 as a structured array with its fields.

    Raises:
        LogFormatError: If the declared sizes contradict each other.
    """
    height, width, step, row_step, data = message.height, message.width, message.point_step, message.row_step, message.data
    order = ">" if message.is_bigendian else "<"
    fields = [(item.name, item.offset, item.datatype, item.count) for item in message.fields]
    usable = [(name, offset, NUMBERS[kind]) for name, offset, kind, number in fields if number == 1 and kind in NUMBERS]
    if any(offset + np.dtype(number).itemsize > step for _, offset, number in usable):
        raise LogFormatError(f"a field of the cloud ends beyond its point of {step} bytes")
    if row_step < width * step or len(data) != height * row_step:
        raise LogFormatError(f"a cloud of {width}×{height} points of {step} bytes holds {len(data)} bytes in rows of {row_step}")
    kind = np.dtype(
        {
            "names": [name for name, _, _ in usable],
            "formats": [order + number for _, _, number in usable],
            "offsets": [offset for _, offset, _ in usable],
            "itemsize": step,
        }
    )
    rows = data.reshape(height, row_step)[:, : width * step]
    return np.ascontiguousarray(rows).reshape(-1).view(kind) if width * height else np.zeros(0, kind)
