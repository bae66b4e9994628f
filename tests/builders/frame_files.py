"""Files of a frame: its points as a cloud, and its calibration."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import PinholeCamera, RgbdFrame


def points_of_frame(frame: RgbdFrame) -> Float[np.ndarray, "n 3"]:
    """Return the point of each pixel, row by row; NaN without a return."""
    camera, z = frame.camera, frame.depth_m.astype(float)
    v, u = np.indices(z.shape)
    x, y = (u - camera.cx_px) / camera.fx_px * z, (v - camera.cy_px) / camera.fy_px * z
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def write_pcd(path: Path, points: Float[np.ndarray, "n 3"], size: tuple[int, int], scale: float = 1.0) -> Path:
    header = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {size[0]}\nHEIGHT {size[1]}\n"
    body = (scale * points).astype("<f4").tobytes()
    path.write_bytes(f"{header}POINTS {len(points)}\nDATA binary\n".encode() + body)
    return path


def write_calibration(path: Path, camera: PinholeCamera, mount: str = "mount_pitch_deg = 40.0\n") -> Path:
    path.write_text(
        f"width = {camera.width_px}\nheight = {camera.height_px}\nfx_px = {camera.fx_px}\nfy_px = {camera.fy_px}\n"
        f"cx_px = {camera.cx_px}\ncy_px = {camera.cy_px}\n{mount}"
    )
    return path


def add_cloud(log: Any, topic: str, t_s: float, points: np.ndarray, size: tuple[int, int]) -> None:
    """Add a PointCloud2 with padding between the coordinates and a packed colour, as depth cameras publish it."""
    kind = np.dtype({"names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 3 + ["<u4"], "offsets": [0, 4, 8, 16], "itemsize": 32})
    rows = np.zeros(len(points), kind)
    rows["x"], rows["y"], rows["z"] = points.T
    rows["rgb"] = 0x808080
    Field = log._type("sensor_msgs/msg/PointField")
    fields = [Field(name, offset, number, 1) for name, offset, number in (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 16, 7))]
    data = np.frombuffer(rows.tobytes(), np.uint8)
    log._add(topic, "sensor_msgs/msg/PointCloud2", t_s, (size[1], size[0], fields, False, 32, 32 * size[0], data, False))
