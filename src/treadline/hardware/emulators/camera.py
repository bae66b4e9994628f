"""Camera of an emulated chair: the emulator writes each frame to a file, and a driver of the host reads it as a live camera.

Robot file: ``[camera]`` with ``source = "treadline.hardware.emulators.camera:EmulatedCamera"``, ``port`` (the emulator's, with
``.frame`` added) and ``calibration`` (the same with ``.camera.toml``).
"""

import io
import time
from pathlib import Path

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import CameraError
from treadline.core.files import write_whole
from treadline.io.live import CameraImages
from treadline.scenario.camera_file import CameraFile

POLL_S = 0.005
"""Interval at which the host looks for a new frame [s]."""


class FrameFile:
    """Newest frame of an emulated camera, and its calibration.

    Args:
        port: Port of the emulator, whose name the files extend.
    """

    def __init__(self, port: Path) -> None:
        self._path, self._calibration = port.with_name(port.name + ".frame"), port.with_name(port.name + ".camera.toml")
        for left in (self._path, self._calibration):
            left.unlink(missing_ok=True)  # of another chair

    def write(self, frame: RgbdFrame) -> None:
        """Replace the frame, stamped now; a reader never sees half of one.

        A camera's clock runs evenly, while that of the emulator slows down on a busy computer.
        """
        t_s = time.monotonic()
        if not self._calibration.exists():
            self._calibration.write_text(CameraFile.of(frame.camera, "the emulated camera").text, encoding="utf-8")
        data = io.BytesIO()
        np.savez(data, t_s=t_s, depth_m=frame.depth_m, rgb=frame.rgb, lens=frame.camera.pinhole)
        write_whole(self._path, data.getvalue())


class EmulatedCamera:
    """Live camera of an emulated chair, as ``treadline see --live`` knows cameras.

    Args:
        port: File of the frames.
    """

    name = "emulated camera"
    rate_hz = 10.0

    def __init__(self, port: str) -> None:
        self._path = Path(port)
        self._seen = 0

    def open(self, *, colour: bool) -> None:
        """Check that the emulator runs.

        Raises:
            CameraError: If there is no frame.
        """
        del colour
        if not self._path.exists():
            raise CameraError(f"{self._path}: no frame of an emulated camera; start the emulator first")

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics of the frames."""
        with np.load(self._path) as held:
            height_px, width_px = held["depth_m"].shape
            fx_px, fy_px, cx_px, cy_px = (float(value) for value in held["lens"])
        return PinholeCamera(width_px=width_px, height_px=height_px, fx_px=fx_px, fy_px=fy_px, cx_px=cx_px, cy_px=cy_px)

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next frame.

        Raises:
            CameraError: If none arrives in time.
        """
        end_s = time.monotonic() + timeout_s
        while (written := self._path.stat().st_mtime_ns) == self._seen:
            if time.monotonic() > end_s:
                raise CameraError(f"{self.name}: no depth image for {timeout_s:g} s; does the emulator still run?")
            time.sleep(POLL_S)
        self._seen = written
        with np.load(self._path) as held:
            t_s = float(held["t_s"])
            return CameraImages(t_s=t_s, depth_m=held["depth_m"], rgb=held["rgb"], rgb_t_s=t_s)

    def close(self) -> None:
        """Do nothing: the frames belong to the emulator."""
