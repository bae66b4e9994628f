"""Intel RealSense D400 series through pyrealsense2."""

from typing import Any

import numpy as np

from treadline.core.camera_images import PinholeCamera
from treadline.io.images import metres
from treadline.io.live._depth_camera import HEIGHT_PX, RATE_HZ, WIDTH_PX, CameraImages, VendorCamera, not_opened, vendor_package


class RealSenseCamera(VendorCamera):
    """Depth, aligned colour and accelerometer of the first RealSense camera. Its depth images are rectified."""

    name = "realsense"

    def open(self, *, colour: bool) -> None:
        """Start depth, colour if wanted, and the accelerometer if the camera has one."""
        self._rs = rs = vendor_package("pyrealsense2", "realsense")
        pipeline = rs.pipeline()
        config, has_imu = self._config(pipeline, colour=colour)
        try:
            profile = pipeline.start(config)
        except RuntimeError as error:
            raise not_opened(self.name, error) from None
        self._pipeline = pipeline
        self._unit_m = float(profile.get_device().first_depth_sensor().get_depth_scale())
        self._depth = profile.get_stream(rs.stream.depth).as_video_stream_profile()
        self._align = rs.align(rs.stream.depth) if colour else None
        if has_imu:
            extrinsics = profile.get_stream(rs.stream.accel).get_extrinsics_to(self._depth)
            self._R_CI = np.array(extrinsics.rotation, dtype=float).reshape(3, 3).T  # librealsense stores columns

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics of the depth stream."""
        found = self._depth.get_intrinsics()
        return PinholeCamera(
            width_px=found.width, height_px=found.height, fx_px=found.fx, fy_px=found.fy, cx_px=found.ppx, cy_px=found.ppy
        )

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next depth image; frame sets that hold motion data only are skipped."""
        frames, depth, forces = self._next_depth(timeout_s, self._forces_in, RuntimeError)
        color = self._align.process(frames).get_color_frame() if self._align is not None else None
        return CameraImages(
            t_s=1e-3 * depth.get_timestamp(),
            depth_m=metres(np.asanyarray(depth.get_data()), self._unit_m),
            rgb=np.array(color.get_data()) if color else None,
            rgb_t_s=1e-3 * color.get_timestamp() if color else None,
            force_C=self._force(forces),
        )

    def _forces_in(self, frames: Any) -> list[list[float]]:
        motion = frames.first_or_default(self._rs.stream.accel) if self._R_CI is not None else None
        if not motion:
            return []
        sample = motion.as_motion_frame().get_motion_data()
        return [[sample.x, sample.y, sample.z]]

    def _config(self, pipeline: Any, *, colour: bool) -> tuple[Any, bool]:
        """Return the streams to start, with the accelerometer if the device can resolve it."""
        rs = self._rs
        for with_imu in (True, False):
            config = rs.config()
            config.enable_stream(rs.stream.depth, WIDTH_PX, HEIGHT_PX, rs.format.z16, RATE_HZ)
            if colour:
                config.enable_stream(rs.stream.color, WIDTH_PX, HEIGHT_PX, rs.format.rgb8, RATE_HZ)
            if with_imu:
                config.enable_stream(rs.stream.accel)
                if config.can_resolve(rs.pipeline_wrapper(pipeline)):
                    break
        return config, with_imu
