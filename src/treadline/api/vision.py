"""``tl.detect_stair``: heading and geometry of the stair in one depth image."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from treadline.core.errors import ImageError
from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.perception import StairDetector
from treadline.perception.detection import StairDetection
from treadline.scenario.camera_file import read_camera


def detect_stair(
    depth_m: ArrayLike,
    camera: PinholeCamera | str | Path,
    gravity: ArrayLike | Sequence[float] | None = None,
) -> StairDetection:
    """Return the heading and the geometry of the stair in one depth image.

    Args:
        depth_m: Distance along the optical axis [m], one row per image row; 0, NaN and infinity mean no return.
        camera: Calibration, or a calibration file (TOML).
        gravity: Vector that points down in the camera's frame (x right, y down, z forward); estimated from the treads when left
            out.

    Returns:
        ``.accepted``, ``.reason`` (None if accepted), ``.heading_rad``, ``.sigma_rad``, ``.shape`` and ``.stair_map``.

    Raises:
        ImageError: If the image is not of the calibration's size.
        SettingsError: If the calibration file cannot be read.
        RecordError: If gravity is not three numbers.
    """
    pinhole = camera if isinstance(camera, PinholeCamera) else read_camera(Path(camera)).camera
    depth = np.array(depth_m, dtype=np.float32)
    if depth.ndim != 2:
        raise ImageError(f"depth_m has {depth.ndim} dimensions; give one row per image row and one column per image column")
    depth[~(np.isfinite(depth) & (depth > 0.0))] = np.nan
    # The robust method reads depth alone; the frame type asks for a colour image of the same size.
    frame = RgbdFrame(t_s=0.0, rgb=np.zeros((*depth.shape, 3), dtype=np.uint8), depth_m=depth, camera=pinhole)
    down = None if gravity is None else np.asarray(gravity, dtype=float)
    return StairDetector().look(frame, down)
