"""Depth sensor of a camera: exact depth in, measured depth out.

Kinect 1: structured light, disparity d = f·B/Z with f = 575 px and B = 75 mm, noise of 0.05 px and steps of 1/8 px (σ_Z about 1.4
mm at 1 m, 5.7 mm at 2 m, 12.8 mm at 3 m), 0.8 px of lateral jitter at edges, a shadow next to each edge, dropouts at grazing
angles. The noise belongs to the sensor: an image of 320×240 has the same noise as one of 640×480.

Kinect 2: time of flight, 1 to 2 mm at 1 m and more at low signal, correlated between neighbouring pixels, mixed pixels at edges, no
shadow.

tof: as the Kinect 2, without a filter of mixed pixels (Wasenmüller and Stricker, ACCV workshops 2016: flying pixels fill the gap
between object and background) and with multipath, which rounds concave corners.

D435, D455: active stereo, disparity d = f·B/Z with B = 50 or 95 mm and f = 387 px at 640×480 (librealsense issue 11511: field of
view of 79.2°). The noise of Z is Z²·σ_d/(f·B) with σ_d of 0.05 to 0.12 px (Keselman et al., CVPR workshops 2017, eq. 2; Intel,
"Tuning depth cameras for best performance"), in steps of 1/32 px (Intel, "Subpixel linearity improvement"), alike over the matching
window of 7×7 px (Keselman et al.: Census cost, aggregated by a box of 7×7). The left imager is the reference: background left of an
object is hidden from the right imager, and a band of f·B/Z columns at the left border has no depth (D400 data sheet, section 4.5).
The search covers 128 disparities, which gives the nearest depth f·B/126. Objects are wider by half of the matching window.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8

from treadline.core.camera_images import BASELINES_M, DepthSensor, PinholeCamera
from treadline.plant.sensors.camera import _depth_kernels as kernels
from treadline.scenario.camera_file import CameraFile, read_camera

SENSOR_WIDTH_PX, TIME_OF_FLIGHT_WIDTH_PX = 640, 512
"""Width of the Kinect 1 disparity image and of the Kinect 2 depth image [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StructuredLight:
    """Parameters of a structured-light sensor: a projector and a camera that measures the disparity of its pattern."""

    sigma_px: float
    step_px: float
    lateral_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOfFlight:
    """Parameters of a time-of-flight sensor, which measures the travel time of its own light."""

    floor_m: float
    gain_m: float
    ripple_m: float
    mixed_dropped: float = 0.7
    """Fraction of the mixed pixels at depth edges that the driver removes."""
    multipath: bool = False
    """Whether light that takes a detour over another surface adds to the depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveStereo:
    """Parameters of a stereo camera with a projector of texture."""

    sigma_px: float = 0.08
    """Standard deviation of the disparity noise of an image 640 pixels wide [px]."""
    step_px: float = 1.0 / 32.0
    window_px: int = 7
    """Width of the matching window [px]: the correlation length of the noise; objects grow by half of it on each side."""
    disparities: int = 126
    """Largest disparity of the search [px]."""
    fill_m: float
    """Distance at which half of a white wall facing the camera has no depth [m]. Assumption: twice the manufacturer's ideal range
    of 3 m (D435) and 6 m (D455), at which the projector's light has a quarter of the irradiance."""


FILL_SPREAD = 0.94
"""Standard deviation of the logarithm of the light needed for a match. Assumption: with ``fill_m`` = 6 m, 99 % of a white wall have
depth at 2 m (log(6² / 2²) / 2.33)."""
Sensor = StructuredLight | TimeOfFlight | ActiveStereo
"""Parameters of any depth sensor."""
SENSORS: dict[DepthSensor, Sensor] = {
    "kinect1": StructuredLight(sigma_px=0.05, step_px=0.125, lateral_px=0.8),
    # Fitted to recorded frames: plane-fit residuals of 1.4 to 2.1 mm in blocks of 16×16 between 0.6 and 1.2 m, three
    # quarters of them alike from one pixel to the next.
    "kinect2": TimeOfFlight(floor_m=0.00115, gain_m=0.00035, ripple_m=0.006),
    # Azure Kinect, narrow field of view: standard deviation of at most 17 mm (Tölgyessy et al., Sensors 21, 2021, confirm the
    # manufacturer's figure), assumed to be reached by a reflectance of 15 % at the end of the range: 0.017 · 0.15 / 3.86².
    # Floor and pattern are those of the Kinect 2.
    "tof": TimeOfFlight(floor_m=0.00115, gain_m=0.00017, ripple_m=0.006, mixed_dropped=0.0, multipath=True),
    "d435": ActiveStereo(fill_m=6.0),
    "d455": ActiveStereo(fill_m=12.0),
}
"""Parameters by sensor name."""
FILES = {kind: read_camera(Path(kind)) for kind in BASELINES_M}
"""Shipped camera file of each sensor: lens and range."""
JUMP_PX = 1.0
"""Smallest disparity difference between neighbouring sensor pixels that counts as a jump [px]: both sides of a smaller one match
together. On the steepest surface in range, a tread 0.3 m below a Kinect 1, neighbours differ by B/h = 0.25 px."""
CELLS = 32
"""Number of patches along the width of the image: at 1 m a patch is 5 cm wide, a third of a rise."""

_Shot = tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Float[np.ndarray, " b"], Int[np.ndarray, " 4"]]
"""Exact depth, faces, albedos, and start positions of the frame's random numbers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorModel:
    """Sensor with its stored random numbers."""

    kind: DepthSensor
    sensor: Sensor
    camera: PinholeCamera
    range_m: tuple[float, float]
    sigma_m: tuple[float, float, float] | None
    """Noise law of a camera file, in place of the noise of the sensor's kind."""
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
        shot, measured = (exact_m, face, albedos, places), np.empty(exact_m.shape, dtype=np.float32)
        if isinstance(self.sensor, ActiveStereo):
            self._stereo(self.sensor, shot, measured)
        elif isinstance(self.sensor, TimeOfFlight):
            self._time_of_flight(self.sensor, shot, measured)
        else:
            self._structured_light(self.sensor, shot, measured)
        if self.sigma_m is not None:
            floor_m, gain, exponent = self.sigma_m
            noise = self.normal[places[3] : places[3] + measured.size].reshape(measured.shape)
            measured += (floor_m + gain * measured**exponent) * noise
        return measured

    def _time_of_flight(self, sensor: TimeOfFlight, shot: _Shot, measured: Float32[np.ndarray, "h w"]) -> None:
        exact_m, face, albedos, places = shot
        camera = self.camera
        kernels.time_of_flight(
            exact_m,
            face,
            *camera.pinhole,
            albedos,
            sensor.floor_m,
            sensor.gain_m,
            sensor.ripple_m,
            camera.width_px / TIME_OF_FLIGHT_WIDTH_PX,
            *self.range_m,
            sensor.mixed_dropped,
            self.normal if self.sigma_m is None else np.zeros_like(self.normal),
            self.chance,
            places,
            measured,
        )
        if sensor.multipath:
            measured += multipath_bias(camera, exact_m, face, albedos).astype(np.float32)

    def _structured_light(self, sensor: StructuredLight, shot: _Shot, measured: Float32[np.ndarray, "h w"]) -> None:
        exact_m, face, _, places = shot
        kernels.kinect(
            exact_m,
            face,
            FILES[self.kind].fx_px,
            BASELINES_M[self.kind],
            self.camera.fx_px * BASELINES_M[self.kind],
            *self._disparity_errors(sensor),
            *self.range_m,
            self.jitter_px,
            self.normal,
            self.chance,
            places,
            measured,
        )

    def _stereo(self, sensor: ActiveStereo, shot: _Shot, measured: Float32[np.ndarray, "h w"]) -> None:
        exact_m, face, albedos, places = shot
        scale = self.camera.fx_px / FILES[self.kind].fx_px
        strength_px_m = FILES[self.kind].fx_px * BASELINES_M[self.kind]
        disparity = np.nan_to_num(strength_px_m / exact_m).astype(np.float32)
        size = 2 * round(0.5 * (sensor.window_px - 1) * scale) + 1
        near = cv2.dilate(disparity, np.ones((size, size), dtype=np.uint8)) if size > 1 else disparity
        # On a plane the largest disparity of a window differs as well: only an edge between two pixels makes a window fail.
        fattened = straddling(disparity, size + 1, JUMP_PX / scale) & (near - disparity > JUMP_PX / scale)
        kernels.stereo(
            exact_m,
            face,
            disparity,
            np.where(fattened, near, np.float32(-1.0)),
            scale,
            *self.camera.pinhole,
            albedos,
            strength_px_m,
            *self._disparity_errors(sensor),
            max(self.range_m[0], strength_px_m / sensor.disparities),
            self.range_m[1],
            1.0 / sensor.fill_m**2,
            FILL_SPREAD,
            self.normal,
            places,
            measured,
        )

    def _disparity_errors(self, sensor: StructuredLight | ActiveStereo) -> tuple[float, float]:
        """Return standard deviation and steps of the disparity [px]; next to none where a noise law includes both."""
        return (sensor.sigma_px, sensor.step_px) if self.sigma_m is None else (0.0, 1e-6)


def model_of(
    kind: DepthSensor,
    camera: PinholeCamera,
    normal: Float32[np.ndarray, " n"],
    chance: Float32[np.ndarray, " n"],
    device: CameraFile | None = None,
    sensor: Sensor | None = None,
) -> SensorModel:
    """Return the model of a kind of sensor.

    Args:
        normal: Normal numbers of the depth noise; those of a stereo camera get the correlation of its matching window here.
        device: Camera file whose range and noise law replace those of the kind.
        sensor: Parameters in place of those of the kind.
    """
    device, sensor = device or FILES[kind], sensor or SENSORS[kind]
    range_m = (device if "range_m" in device.model_fields_set else FILES[kind]).range_m
    scale = camera.width_px / SENSOR_WIDTH_PX
    jitter_px = np.empty(0, dtype=np.int8)
    if isinstance(sensor, ActiveStereo):
        normal = _windowed(normal, camera.width_px, max(round(sensor.window_px * scale), 1))
    if isinstance(sensor, StructuredLight):
        jitter_px = np.rint(sensor.lateral_px * scale * normal.astype(np.float64)).astype(np.int8)
    return SensorModel(
        kind=kind,
        sensor=sensor,
        camera=camera,
        range_m=range_m,
        sigma_m=device.sigma_m,
        normal=normal,
        chance=chance,
        jitter_px=jitter_px,
    )


def _windowed(normal: Float32[np.ndarray, " n"], width_px: int, window_px: int) -> Float32[np.ndarray, " n"]:
    """Return normal numbers averaged over a window of an image and scaled to unit variance: matches of neighbours share pixels."""
    rows = len(normal) // width_px
    smooth = cv2.blur(normal[: rows * width_px].reshape(rows, width_px), (window_px, window_px))
    # The mean of n white numbers has a standard deviation of 1/√n.
    smooth *= window_px
    return np.concatenate([smooth.ravel(), normal[rows * width_px :]])


def straddling(disparity: Float32[np.ndarray, "h w"], width_px: int, jump_px: float) -> Bool[np.ndarray, "h w"]:
    """Return the mask of pixels whose window contains a depth jump: a window of w pixels straddles a jump at w - 1 places.

    Args:
        width_px: Width of the window [px of this image].
        jump_px: Smallest disparity difference between neighbouring pixels that counts as a jump.
    """
    # A jump is marked at the first pixel of the pair, or at the lower index.
    jump = np.zeros(disparity.shape, dtype=np.uint8)
    jump[:, :-1] |= np.abs(np.diff(disparity, axis=1)) > jump_px
    jump[:-1] |= np.abs(np.diff(disparity, axis=0)) > jump_px
    size = max(width_px - 1, 1)
    return np.asarray(cv2.dilate(jump, np.ones((size, size), dtype=np.uint8), anchor=(size // 2, size // 2)) > 0)


def multipath_bias(
    camera: PinholeCamera, exact_m: Float[np.ndarray, "h w"], face: Int[np.ndarray, "h w"], albedos: Float[np.ndarray, " b"]
) -> Float[np.ndarray, "h w"]:
    """Return the depth bias of each pixel [m]: interpolated between patches, zero away from concave corners."""
    height, width = exact_m.shape
    cell = max(round(width / CELLS), 1)
    coarse = np.empty((-(-height // cell), -(-width // cell)))
    kernels.bounce(exact_m, face, albedos, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, cell, coarse)
    known = np.isfinite(coarse)
    # Patches without a surface take the mean of their neighbours.
    weight = cv2.blur(known.astype(np.float64), (3, 3))
    mean = cv2.blur(np.where(known, coarse, 0.0), (3, 3)) / np.maximum(weight, 1e-9)
    filled = np.where(known, coarse, np.where(weight > 0.0, mean, 0.0))
    size = (filled.shape[1] * cell, filled.shape[0] * cell)
    range_bias = cv2.resize(filled, size, interpolation=cv2.INTER_LINEAR)[:height, :width]
    x = (np.arange(width) - camera.cx_px) / camera.fx_px
    y = (np.arange(height) - camera.cy_px) / camera.fy_px
    return np.asarray(range_bias / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2))
