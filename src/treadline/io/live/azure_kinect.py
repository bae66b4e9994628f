"""Azure Kinect through pyk4a, in the narrow field of view without binning."""

from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.images import PinholeCamera
from treadline.io.live.depth_camera import (
    RATE_HZ,
    CameraImages,
    Undistortion,
    metres,
    no_frame,
    not_opened,
    rotation_or_none,
    vendor_package,
)

NFOV_PX = (640, 576)
"""Width and height of the depth image in the narrow field of view without binning (data sheet)."""
MOST_SAMPLES = 200
"""Largest number of IMU samples taken per frame; the IMU has 1.6 kHz, which is 53 samples at 30 Hz."""


class AzureKinectCamera:
    """Depth without lens distortion, colour in the geometry of depth, and accelerometer of the first Azure Kinect."""

    name = "k4a"
    rate_hz = float(RATE_HZ)

    def __init__(self) -> None:
        self._device: Any = None
        self._colour = False
        self._R_CI: Float[np.ndarray, "3 3"] | None = None

    def open(self, *, colour: bool) -> None:
        """Start depth, colour if wanted, and the IMU."""
        self._k4a = k4a = vendor_package("pyk4a", "k4a")
        self._colour = colour
        device = k4a.PyK4A(
            k4a.Config(
                color_resolution=k4a.ColorResolution.RES_720P if colour else k4a.ColorResolution.OFF,
                depth_mode=k4a.DepthMode.NFOV_UNBINNED,
                camera_fps=k4a.FPS.FPS_30,
                synchronized_images_only=colour,
            )
        )
        try:
            device.start()
        except k4a.K4AException as error:
            raise not_opened(self.name, error) from None
        self._device = device
        kind = k4a.CalibrationType
        self._undistort = Undistortion(self.intrinsics(), device.calibration.get_distortion_coefficients(kind.DEPTH))
        self._R_CI = rotation_or_none(device.calibration.get_extrinsic_parameters(kind.ACCEL, kind.DEPTH)[0])

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics of the depth camera."""
        K = self._device.calibration.get_camera_matrix(self._k4a.CalibrationType.DEPTH)
        width, height = NFOV_PX
        return PinholeCamera(
            width_px=width, height_px=height, fx_px=float(K[0, 0]), fy_px=float(K[1, 1]), cx_px=float(K[0, 2]), cy_px=float(K[1, 2])
        )

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next depth image."""
        try:
            capture = self._device.get_capture(timeout=int(1e3 * timeout_s))
        except self._k4a.K4AException as error:  # a timeout is one, too
            raise no_frame(self.name, timeout_s, error) from None
        if capture.depth is None:
            raise no_frame(self.name, timeout_s)
        color = capture.transformed_color if self._colour else None
        return CameraImages(
            t_s=1e-6 * capture.depth_timestamp_usec,
            depth_m=metres(self._undistort(capture.depth), 1e-3),
            rgb=None if color is None else np.ascontiguousarray(self._undistort(color)[:, :, 2::-1]),
            rgb_t_s=None if color is None else 1e-6 * capture.color_timestamp_usec,
            force_C=self._force(),
        )

    def close(self) -> None:
        """Stop the streams."""
        device, self._device = self._device, None
        if device is not None:
            device.stop()

    def _force(self) -> Float[np.ndarray, " 3"] | None:
        """Return the mean of the IMU samples that wait in the queue."""
        samples: list[tuple[float, float, float]] = []
        while self._R_CI is not None and len(samples) < MOST_SAMPLES:
            try:
                samples.append(self._device.get_imu_sample(timeout=0)["acc_sample"])
            except self._k4a.K4AException:
                break
        return self._R_CI @ np.mean(samples, axis=0) if samples and self._R_CI is not None else None
