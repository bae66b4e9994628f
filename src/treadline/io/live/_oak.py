"""Luxonis OAK cameras with stereo depth through depthai, version 3."""

from datetime import timedelta
from typing import Any

import numpy as np

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import CameraError
from treadline.io.images import metres
from treadline.io.live._depth_camera import CameraImages, VendorCamera, no_frame, not_opened, rotation_or_none, vendor_package

SIZE_PX = (640, 400)
"""Width and height of the stereo images: half the resolution of the OV9282 sensors."""
FIRST_S = 10.0
"""Longest wait for the first image [s]: the firmware is loaded into the camera at each start."""


class OakCamera(VendorCamera):
    """Rectified stereo depth and accelerometer of the first OAK camera; no colour, which is another camera there."""

    name = "oak"

    def __init__(self) -> None:
        super().__init__()
        self._forces: Any = None
        self._first: Any = None

    def open(self, *, colour: bool) -> None:
        """Start stereo depth with subpixel disparity, and the accelerometer if it is calibrated to the cameras."""
        del colour
        self._dai = dai = vendor_package("depthai", "oak")
        try:
            pipeline = dai.Pipeline()
            stereo = pipeline.create(dai.node.StereoDepth).build(autoCreateCameras=True, size=SIZE_PX, fps=self.rate_hz)
            stereo.setSubpixel(True)
            self._images = stereo.depth.createOutputQueue(maxSize=2, blocking=False)
            self._add_imu(pipeline)
            pipeline.start()
            self._pipeline = pipeline
            self._first = self._images.get(timedelta(seconds=FIRST_S))
        except (RuntimeError, dai.MessageQueue.QueueException) as error:
            self.close()
            raise not_opened(self.name, error) from None
        if self._first is None:
            self.close()
            raise no_frame(self.name, FIRST_S)

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics that the first image carries."""
        K = np.array(self._first.getTransformation().getIntrinsicMatrix(), dtype=float)
        if K[0, 0] <= 1.0:  # an identity matrix stands for an unknown calibration
            raise CameraError(f"{self.name}: its images carry no intrinsics; calibrate the camera with its vendor's tool")
        return PinholeCamera(
            width_px=int(self._first.getWidth()),
            height_px=int(self._first.getHeight()),
            fx_px=float(K[0, 0]),
            fy_px=float(K[1, 1]),
            cx_px=float(K[0, 2]),
            cy_px=float(K[1, 2]),
        )

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next depth image."""
        try:
            image = self._images.get(timedelta(seconds=timeout_s))
        except (RuntimeError, self._dai.MessageQueue.QueueException) as error:
            raise no_frame(self.name, timeout_s, error) from None
        if image is None:
            raise no_frame(self.name, timeout_s)
        return CameraImages(
            t_s=image.getTimestampDevice().total_seconds(),
            depth_m=metres(np.asarray(image.getFrame()), 1e-3),
            force_C=self._force(self._samples()),
        )

    def _add_imu(self, pipeline: Any) -> None:
        """Add the accelerometer; most OAK cameras have no IMU extrinsics (zeros), so that its axes are unknown."""
        dai, device = self._dai, pipeline.getDefaultDevice()
        if device.getConnectedIMU() in {"", "NONE"}:
            return
        try:
            X_CI = np.array(device.readCalibration().getImuToCameraExtrinsics(dai.CameraBoardSocket.CAM_C), dtype=float)
        except RuntimeError:
            return
        self._R_CI = rotation_or_none(X_CI[:3, :3])
        if self._R_CI is not None:
            sensor = pipeline.create(dai.node.IMU)
            sensor.enableIMUSensor(dai.IMUSensor.ACCELEROMETER_RAW, 100)  # Hz
            sensor.setBatchReportThreshold(1)
            sensor.setMaxBatchReports(10)
            self._forces = sensor.out.createOutputQueue(maxSize=50, blocking=False)

    def _samples(self) -> list[list[float]]:
        """Return the accelerometer's samples since the last image."""
        packets = [packet for data in self._forces.tryGetAll() for packet in data.packets] if self._forces is not None else []
        return [[packet.acceleroMeter.x, packet.acceleroMeter.y, packet.acceleroMeter.z] for packet in packets]
