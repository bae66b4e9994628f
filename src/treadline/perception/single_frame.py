"""The stair in one frame, whatever it is given as: a frame with a name, a frame, or a depth image with its calibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from treadline.core.arrays import real, shaped
from treadline.core.camera_images import FrameSource, NamedFrame, PinholeCamera, RgbdFrame, black
from treadline.core.errors import ImageError, SettingsError
from treadline.perception.detection import StairDetection
from treadline.perception.detector import StairDetector


def look_once(
    given: NamedFrame | RgbdFrame | ArrayLike, camera: PinholeCamera | None = None, gravity_C: ArrayLike | None = None
) -> StairDetection:
    """Return the heading and the geometry of the stair in one frame.

    Args:
        given: Frame, or depth image [m].
        camera: Calibration in place of the frame's; a depth image needs one.
        gravity_C: Vector that points down, in place of the frame's.

    Raises:
        ImageError: If there is no image, or none in metres.
        SettingsError: If a depth image comes without a calibration.
        RecordError: If gravity is not three numbers.
    """
    if isinstance(given, NamedFrame):
        if given.frame is None:
            raise ImageError(f"{given.name}: {given.reason}")
        return look_once(given.frame, camera, given.gravity_C if gravity_C is None else gravity_C)
    if not isinstance(given, RgbdFrame):
        frame = _depth_frame(given, camera)
    else:
        frame = given if camera is None else replace(given, camera=camera)
    down = None if gravity_C is None else shaped("gravity", gravity_C, (3,), "three numbers x, y, z")
    return StairDetector().look(frame, down)


def _depth_frame(depth_m: ArrayLike, camera: PinholeCamera | None) -> RgbdFrame:
    """Return the frame of a depth image without colour."""
    if isinstance(depth_m, str | Path | FrameSource):
        path = repr(str(depth_m)) if isinstance(depth_m, str | Path) else "path"
        raise ImageError(f"give one frame at a time: for frame in tl.read_frames({path}): tl.detect_stair(frame)")
    depth = real("depth_m", depth_m, "a frame of tl.read_frames, or a depth image in metres")
    if depth.ndim != 2:
        raise ImageError(f"depth_m has {depth.ndim} dimensions; give one row per image row and one column per image column")
    if np.asarray(depth_m).dtype.kind in "iu":
        raise ImageError("depth_m holds whole numbers, counts instead of metres; multiply them by the unit of a count, often 0.001")
    if camera is None:
        raise SettingsError(
            "a depth image needs its calibration: tl.detect_stair(depth_m, camera), a PinholeCamera or a camera.toml"
        )
    # The robust method reads depth alone; the frame type asks for a colour image of the same size.
    known = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan).astype(np.float32)
    return RgbdFrame(t_s=0.0, rgb=black(*depth.shape), depth_m=known, camera=camera)
