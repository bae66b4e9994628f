"""Orbbec cameras (Gemini, Astra, Femto) through pyorbbecsdk, version 2."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import CameraError
from treadline.io.images import metres
from treadline.io.live._depth_camera import (
    HEIGHT_PX,
    RATE_HZ,
    WIDTH_PX,
    CameraImages,
    VendorCamera,
    not_opened,
    rotation_or_none,
    undistortion,
    vendor_package,
)

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Names of the distortion coefficients in OpenCV's order."""


class OrbbecCamera(VendorCamera):
    """Depth, aligned colour and accelerometer of the first Orbbec camera."""

    name = "orbbec"

    def __init__(self) -> None:
        super().__init__()
        self._align: Any = None

    def open(self, *, colour: bool) -> None:
        """Start depth, colour if wanted and possible, and the accelerometer if the camera has one."""
        self._ob = ob = vendor_package("pyorbbecsdk", "orbbec")
        # The SDK would write its log into the working folder, as Log/OrbbecSDK.log.txt; its errors arrive as exceptions.
        ob.Context.set_logger_to_file(ob.OBLogLevel.NONE, "")
        try:
            pipeline, config = ob.Pipeline(), ob.Config()
            self._depth = self._profile(pipeline, ob.OBSensorType.DEPTH_SENSOR, ob.OBFormat.Y16)
            config.enable_stream(self._depth)
            has_imu = self._has_accelerometer(pipeline)
            if has_imu:
                config.enable_accel_stream()
            if colour:
                config.enable_stream(self._profile(pipeline, ob.OBSensorType.COLOR_SENSOR, ob.OBFormat.RGB))
                self._align = ob.AlignFilter(align_to_stream=ob.OBStreamType.DEPTH_STREAM)
            config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.ANY_SITUATION)
            pipeline.start(config)
        except (ob.OBError, RuntimeError) as error:
            raise not_opened(self.name, error) from None
        self._pipeline = pipeline
        self.rate_hz = float(self._depth.get_fps())
        self._undistort = self._undistortion()

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics of the depth stream."""
        found = self._depth.get_intrinsic()
        return PinholeCamera(
            width_px=found.width, height_px=found.height, fx_px=found.fx, fy_px=found.fy, cx_px=found.cx, cy_px=found.cy
        )

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next depth image; frame sets that hold motion data only are skipped."""
        frames, depth, forces = self._next_depth(timeout_s, self._forces_in, self._ob.OBError, RuntimeError)
        counts = np.frombuffer(depth.get_data(), np.uint16).reshape(depth.get_height(), depth.get_width())
        color = self._colour(frames)
        return CameraImages(
            t_s=1e-6 * depth.get_timestamp_us(),
            depth_m=metres(counts if self._undistort is None else self._undistort(counts), 1e-3 * depth.get_depth_scale()),
            rgb=None if color is None else np.frombuffer(color.get_data(), np.uint8).reshape(*counts.shape, 3).copy(),
            rgb_t_s=None if color is None else 1e-6 * color.get_timestamp_us(),
            force_C=self._force(forces),
        )

    def _forces_in(self, frames: Any) -> list[list[float]]:
        if (motion := frames.get_accel_frame()) is None:
            return []
        if self._R_CI is None:
            with suppress(self._ob.OBError, RuntimeError):
                self._R_CI = rotation_or_none(motion.get_stream_profile().get_extrinsic_to(self._depth).rot)
        return [[motion.get_x(), motion.get_y(), motion.get_z()]]

    def _profile(self, pipeline: Any, sensor: Any, pixels: Any) -> Any:
        """Return the preferred stream of a sensor, or its default if the camera does not have that."""
        profiles = pipeline.get_stream_profile_list(sensor)
        try:
            return profiles.get_video_stream_profile(WIDTH_PX, HEIGHT_PX, pixels, RATE_HZ)
        except self._ob.OBError:
            return profiles.get_default_video_stream_profile()

    def _has_accelerometer(self, pipeline: Any) -> bool:
        try:
            return pipeline.get_device().get_sensor(self._ob.OBSensorType.ACCEL_SENSOR) is not None
        except (self._ob.OBError, RuntimeError):
            return False

    def _undistortion(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Return the map of a lens with distortion (Femto); stereo depth is rectified and has none."""
        found = self._depth.get_distortion()
        coefficients = np.array([float(getattr(found, name)) for name in COEFFICIENTS])
        if not coefficients.any():
            return None
        if "KANNALA" in str(found.model):
            raise CameraError(f"{self.name}: its lens model {found.model} is not a pinhole; choose a narrow depth mode")
        return undistortion(self.intrinsics(), coefficients)

    def _colour(self, frames: Any) -> Any | None:
        """Return the colour image in the depth camera's geometry; None if it is not in RGB of the depth image's size."""
        if self._align is None or frames.get_color_frame() is None:
            return None
        aligned = self._align.process(frames)
        color = None if aligned is None else aligned.as_frame_set().get_color_frame()
        depth = frames.get_depth_frame()
        if color is None or color.get_format() != self._ob.OBFormat.RGB:
            return None
        return color if (color.get_width(), color.get_height()) == (depth.get_width(), depth.get_height()) else None
