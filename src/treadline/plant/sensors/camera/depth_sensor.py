"""Depth sensor of a camera: exact depth in, measured depth out."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int, Int8

from treadline.core.images import PinholeCamera
from treadline.plant.sensors.camera import ray_kernels as kernels
from treadline.plant.sensors.camera.depth_errors import (
    CORRELATION_PX,
    SENSOR_WIDTH_PX,
    SENSORS,
    TIME_OF_FLIGHT_WIDTH_PX,
    ActiveStereo,
    Sensor,
    StructuredLight,
    TimeOfFlight,
    alike,
    windowed,
)
from treadline.plant.sensors.camera.matching import JUMP_PX, stereo_depth, straddling
from treadline.plant.sensors.camera.multipath import multipath_bias


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorModel:
    """Sensor with its stored random numbers."""

    sensor: Sensor
    camera: PinholeCamera
    edge_holes: bool
    normal: Float32[np.ndarray, " n"]
    """Normal numbers with the spatial correlation of the depth noise."""
    chance: Float32[np.ndarray, " n"]
    jitter_px: Int8[np.ndarray, " j"]
    """Lateral jitter of structured light; empty for other sensors."""

    def measure(
        self,
        exact_m: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        albedos: Float[np.ndarray, " b"],
        places: Int[np.ndarray, " 4"],
    ) -> Float32[np.ndarray, "h w"]:
        """Return the measured depth; ``places`` are the start positions of this frame's random numbers."""
        if isinstance(self.sensor, ActiveStereo):
            return stereo_depth(self.sensor, self.camera, exact_m, face, albedos, self.normal, places)
        if isinstance(self.sensor, TimeOfFlight):
            return self._time_of_flight(self.sensor, exact_m, face, albedos, places)
        return self._structured_light(self.sensor, exact_m, face, places)

    def _time_of_flight(
        self,
        sensor: TimeOfFlight,
        exact_m: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        albedos: Float[np.ndarray, " b"],
        places: Int[np.ndarray, " 4"],
    ) -> Float32[np.ndarray, "h w"]:
        camera, measured = self.camera, np.empty(exact_m.shape, dtype=np.float32)
        kernels.time_of_flight(
            exact_m,
            face,
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px,
            albedos,
            sensor.floor_m,
            sensor.gain_m,
            sensor.ripple_m,
            camera.width_px / TIME_OF_FLIGHT_WIDTH_PX,
            sensor.near_m,
            sensor.far_m,
            sensor.mixed_dropped,
            self.normal,
            self.chance,
            places,
            measured,
        )
        if sensor.multipath:
            measured += multipath_bias(camera, exact_m, face, albedos).astype(np.float32)
        return measured

    def _structured_light(
        self,
        sensor: StructuredLight,
        exact_m: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        places: Int[np.ndarray, " 4"],
    ) -> Float32[np.ndarray, "h w"]:
        measured = np.empty(exact_m.shape, dtype=np.float32)
        kernels.kinect(
            exact_m,
            face,
            sensor.focal_px,
            sensor.baseline_m,
            self.camera.fx_px * sensor.baseline_m,
            sensor.sigma_px,
            sensor.step_px,
            sensor.near_m,
            sensor.far_m,
            self.jitter_px,
            self.normal,
            self.chance,
            places,
            measured,
        )
        if self.edge_holes:
            scale = self.camera.width_px / SENSOR_WIDTH_PX
            disparity = np.nan_to_num(sensor.focal_px * sensor.baseline_m / exact_m).astype(np.float32)
            measured[straddling(disparity, round(CORRELATION_PX * scale), JUMP_PX / scale)] = np.nan
        return measured


def sensor_model(
    kind: str,
    camera: PinholeCamera,
    normal: Float32[np.ndarray, " n"],
    chance: Float32[np.ndarray, " n"],
    *,
    grain_px: float,
    sigma_px: float | None,
    edge_holes: bool,
) -> SensorModel | None:
    """Return the model of a named sensor; None for one without errors.

    Args:
        normal: White normal numbers.
        grain_px: Correlation length of the depth noise [sensor px]; a stereo camera has that of its matching window.
        sigma_px: Disparity noise; None: the sensor's default.
    """
    sensor = SENSORS.get(kind)
    if sensor is None:
        return None
    if sigma_px is not None and isinstance(sensor, StructuredLight | ActiveStereo):
        sensor = replace(sensor, sigma_px=sigma_px)
    scale = camera.width_px / SENSOR_WIDTH_PX
    jitter_px = np.empty(0, dtype=np.int8)
    if isinstance(sensor, ActiveStereo):
        depth_normal = windowed(normal, camera.width_px, max(round(sensor.window_px * scale), 1))
    else:
        depth_normal = alike(normal, camera.width_px, grain_px * scale)
    if isinstance(sensor, StructuredLight):
        jitter_px = np.rint(sensor.lateral_px * scale * depth_normal.astype(np.float64)).astype(np.int8)
    return SensorModel(sensor=sensor, camera=camera, edge_holes=edge_holes, normal=depth_normal, chance=chance, jitter_px=jitter_px)
