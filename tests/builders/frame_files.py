"""Files of a frame: its points as a cloud, and its calibration."""

from pathlib import Path

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
