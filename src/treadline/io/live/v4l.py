"""Video devices of Linux (V4L2) whose stream is 16-bit depth, through OpenCV; they report no intrinsics."""

import time
from typing import Any

import cv2
import numpy as np

from treadline.core.errors import CameraError, SettingsError
from treadline.core.images import PinholeCamera
from treadline.io.live.depth_camera import RATE_HZ, CameraImages, metres, no_frame

FORMATS = ("Z16 ", "Y16 ")
"""Pixel formats of 16-bit depth, in order of preference."""
UNIT_M = 0.001
"""Depth per count [m]: the unit of Z16 in RealSense, Xtion and Orbbec drivers."""


class V4lCamera:
    """Depth of a video device; intrinsics come from a calibration file."""

    name = "v4l"
    rate_hz = float(RATE_HZ)

    def __init__(self, calibration: PinholeCamera | None, number: int = 0) -> None:
        """Choose a device.

        Args:
            number: Number N of /dev/videoN.

        Raises:
            SettingsError: If there is no calibration.
        """
        if calibration is None:
            raise SettingsError("--live v4l: a video device reports no intrinsics; give --camera camera.toml")
        self._calibration = calibration
        self._number = number
        self.name = f"v4l:{number}"
        self._video: Any = None

    def open(self, *, colour: bool) -> None:
        """Open the device with the calibration's size, without conversion to colour."""
        del colour
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # the error below says the same on one line
        try:
            video = cv2.VideoCapture(self._number, cv2.CAP_V4L2)
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not video.isOpened():
            raise CameraError(
                f"{self.name}: cannot be opened; is /dev/video{self._number} there, and is no other program using it?"
            )
        video.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        for pixels in FORMATS:
            if video.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*pixels)):
                break
        video.set(cv2.CAP_PROP_FRAME_WIDTH, self._calibration.width_px)
        video.set(cv2.CAP_PROP_FRAME_HEIGHT, self._calibration.height_px)
        rate_hz = float(video.get(cv2.CAP_PROP_FPS))
        self.rate_hz = rate_hz if rate_hz > 0.0 else float(RATE_HZ)
        self._video = video

    def intrinsics(self) -> PinholeCamera:
        """Return the calibration."""
        return self._calibration

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next depth image; OpenCV has its own timeout of 10 s."""
        done, image = self._video.read()
        if not done:
            raise no_frame(self.name, timeout_s)
        stamp_ms = float(self._video.get(cv2.CAP_PROP_POS_MSEC))
        return CameraImages(
            t_s=1e-3 * stamp_ms if stamp_ms > 0.0 else time.monotonic(), depth_m=metres(self._counts(np.asarray(image)), UNIT_M)
        )

    def close(self) -> None:
        """Release the device."""
        video, self._video = self._video, None
        if video is not None:
            video.release()

    def _counts(self, image: np.ndarray) -> np.ndarray:
        """Return depth counts; OpenCV gives a format that it does not know as a row of bytes."""
        if image.ndim == 2 and image.dtype == np.uint16:
            return image
        width, height = (int(self._video.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if image.dtype == np.uint8 and image.size == 2 * width * height:
            return np.ascontiguousarray(image).reshape(-1).view("<u2").reshape(height, width)
        raise CameraError(
            f"{self.name}: its images are {image.dtype} of shape {'×'.join(map(str, image.shape))}, not 16-bit depth; another "
            "device of the camera has depth: v4l2-ctl --list-formats-ext, then --live v4l:NUMBER"
        )
