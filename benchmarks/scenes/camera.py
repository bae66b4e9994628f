"""Camera of the benchmark: the plant's camera with errors of its lens, sensor and exposure that a run does not have."""

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import cv2
import numpy as np

from scenes.bad_pixels import fill_holes, lose_pixels, mix_at_edges
from treadline.core.camera_images import DepthSensor, PinholeCamera
from treadline.plant.sensors.camera import Camera, RenderedFrame
from treadline.plant.sensors.camera.depth_sensor import (
    JUMP_PX,
    SENSOR_WIDTH_PX,
    SENSORS,
    ActiveStereo,
    StructuredLight,
    model_of,
    straddling,
)
from treadline.plant.sensors.camera.ray_camera import POOL, VIEW_M
from treadline.plant.sensors.camera.solids import SceneBox

DISPARITY_PX_M = 575.0 * 0.075
"""Product f·B of the Kinect 1 [px m]."""
CORRELATION_PX = 9
"""Width of the Kinect 1 correlation window [px of a disparity image 640 wide]: two recorded frames of a flight with open risers
have holes of 9 px (median; quartiles 6 and 19 px) across their depth jumps, along columns; rendered open flights have 11 px (9 and
19 px) with ``edge_holes``, 6 px (1 and 20 px) without."""
BANDS, SWEEP_M = 24, 0.2
"""Number of bands of rows with a pose of their own under a rolling shutter: at 30°/s and 33 ms bands differ by 0.04°, 0.2 pixels at
320×240. Largest motion during the readout [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Puddle:
    """Water on a tread, a mirror for a depth sensor."""

    centre_W: tuple[float, float, float]
    half_m: tuple[float, float]
    """Half axes of the ellipse along x and y."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Film(SceneBox):
    """Surface without depth: a mirroring metal strip, or the shadow of an edge."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Motion of the camera while a rolling shutter reads the image from the top row to the bottom row."""

    readout_s: float
    velocity_W: np.ndarray
    rate_W: np.ndarray
    """Angular velocity [rad/s]."""


class SceneCamera(Camera):
    """Camera in front of any list of solids.

    Args:
        declared: Calibration stored in the frames, if different from the true calibration.
        sigma_px: Standard deviation of the disparity noise [sensor pixels]; None: the sensor's default.
        edge_holes: Whether a Kinect 1 loses the pixels whose correlation window contains a depth jump.
        grain_px: Correlation length of the depth noise [sensor pixels]; zero is white noise.
        warp_px: Smooth, constant depth error across the image [px of Kinect 1 disparity].
        holes: Fraction of the depth image lost in blotches.
        missing: Fraction of the pixels without depth, each independent of its neighbours.
        hole_filling: How the driver fills pixels without depth: one of ``bad_pixels.HOLE_FILLINGS``.
        flying: Fraction of the pixels next to a depth jump whose depth lies between both sides.
        blur_px: Motion of the colour image to the right and down during the exposure [px].
    """

    def __init__(
        self,
        solids: list[SceneBox],
        calibration: PinholeCamera,
        *,
        kind: DepthSensor | Literal["ideal"] = "kinect1",
        declared: PinholeCamera | None = None,
        sigma_px: float | None = None,
        edge_holes: bool = False,
        grain_px: float = 0.0,
        warp_px: float = 0.0,
        holes: float = 0.0,
        missing: float = 0.0,
        hole_filling: str = "",
        flying: float = 0.0,
        blur_px: tuple[float, float] = (0.0, 0.0),
        puddles: tuple[Puddle, ...] = (),
        rng: np.random.Generator,
        **surfaces: Any,
    ) -> None:
        super().__init__(solids, calibration, kind=kind, rng=rng, **surfaces)
        self._declared = declared or calibration
        self._edge_holes = edge_holes and kind == "kinect1"
        self._holes, self._blur_px, self._puddles = holes, blur_px, puddles
        self._missing, self._hole_filling, self._flying = missing, hole_filling, flying
        if kind != "ideal":
            sensor = SENSORS[kind]
            if sigma_px is not None and isinstance(sensor, StructuredLight | ActiveStereo):
                sensor = replace(sensor, sigma_px=sigma_px)
            scale = calibration.width_px / SENSOR_WIDTH_PX
            # The noise of a stereo camera has the correlation of its matching window.
            grain_px *= 0.0 if isinstance(sensor, ActiveStereo) else scale
            normal = _alike(self._normal, calibration.width_px, grain_px)
            self._sensor = model_of(kind, calibration, normal, self._chance, sensor=sensor)
        self._warp_px = _warp(calibration, warp_px, rng) if warp_px > 0.0 else None

    def frame(self, t_s: float, R_WC: np.ndarray, p_WC: np.ndarray, sweep: Sweep | None = None) -> RenderedFrame:
        """Return a frame with sensor errors.

        Args:
            R_WC: Orientation at the time of the middle row; ``p_WC`` the position.
            sweep: Motion of a rolling shutter during the readout; None: a global shutter. Colours are those of a global shutter.
        """
        depth, face, near = self._cast(R_WC, p_WC) if sweep is None else self._cast_in_bands(R_WC, p_WC, sweep)
        place = int(self._rng.integers(POOL))
        measured = self.measured(depth, face, near)
        self._lose_depth(measured, depth, face, near, R_WC, p_WC)
        if self._warp_px is not None:
            measured = (DISPARITY_PX_M / (DISPARITY_PX_M / measured + self._warp_px)).astype(np.float32)
        if self._flying > 0.0:
            mix_at_edges(measured, self._flying, self._rng)
        if self._missing > 0.0:
            lose_pixels(measured, self._missing, self._rng)
        measured = fill_holes(measured, self._hole_filling)
        painted = partial(self._painted, depth, face, near, R_WC.copy(), p_WC.copy())
        painter = partial(self._blurred, painted, place) if any(self._blur_px) else partial(painted, self._normal, place)
        return RenderedFrame(t_s=t_s, depth_m=measured, camera=self._declared, painter=painter)

    def measured(self, exact: np.ndarray, face: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return what the sensor measures of exact depth."""
        measured = super().measured(exact, face, near)
        if self._edge_holes:
            scale = self.calibration.width_px / SENSOR_WIDTH_PX
            disparity = np.nan_to_num(DISPARITY_PX_M / exact).astype(np.float32)
            measured[straddling(disparity, round(CORRELATION_PX * scale), JUMP_PX / scale)] = np.nan
        return measured

    def _cast_in_bands(self, R_WC: np.ndarray, p_WC: np.ndarray, sweep: Sweep) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return depth and faces with the pose of each band of rows, and the solids that may be in view."""
        camera, near = self.calibration, self._in_front(R_WC, p_WC, VIEW_M + SWEEP_M)
        depth = np.empty((camera.height_px, camera.width_px))
        face = np.empty((camera.height_px, camera.width_px), dtype=np.int32)
        rows = np.linspace(0, camera.height_px, BANDS + 1).astype(int)
        for top, bottom in itertools.pairwise(rows.tolist()):
            after = (0.5 * (top + bottom) / camera.height_px - 0.5) * sweep.readout_s
            R_band = cv2.Rodrigues(after * sweep.rate_W)[0] @ R_WC
            self._cast_rows(near, R_band, p_WC + after * sweep.velocity_W, top, depth[top:bottom], face[top:bottom])
        return depth, face, near

    def _lose_depth(
        self, measured: np.ndarray, exact: np.ndarray, face: np.ndarray, near: np.ndarray, R_WC: np.ndarray, p_WC: np.ndarray
    ) -> None:
        """Apply puddles, films and the holes of sunlight; ``measured`` is changed in place."""
        if self._puddles and self._sensor is not None:
            self._soak(measured, exact, R_WC, p_WC)
        if self._sensor is not None:
            is_film = np.array([isinstance(self._solids[i], Film) for i in near])
            measured[(face >= 0) & is_film[face // 6]] = np.nan
        if self._holes > 0.0:
            blotches = self._blotches(measured.shape)
            measured[blotches < np.quantile(blotches, self._holes)] = np.nan

    def _soak(self, measured: np.ndarray, exact: np.ndarray, R_WC: np.ndarray, p_WC: np.ndarray) -> None:
        """Take depth from the middle of each puddle, and mirror parts of its rim.

        A mirror image lies below the surface: the depth is larger, here by a hand's breadth.
        """
        camera = self.calibration
        v, u = np.indices(exact.shape)
        rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(exact.shape)], axis=-1)
        points_W = p_WC + (exact[..., None] * rays) @ R_WC.T
        chance, blotches = self._rng.random(exact.shape), self._blotches(exact.shape)
        for puddle in self._puddles:
            x, y, z = np.moveaxis(points_W - puddle.centre_W, -1, 0)
            inside = 1.0 - (x / puddle.half_m[0]) ** 2 - (y / puddle.half_m[1]) ** 2
            wet = (inside > 0.0) & (np.abs(z) <= 0.004)
            measured[wet & ((inside > 0.6) | (chance < 0.3))] = np.nan
            measured[wet & (blotches > 0.5)] += 0.05

    def _blotches(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return smooth random numbers over an image."""
        coarse = self._rng.standard_normal((shape[0] // 12, shape[1] // 12)).astype(np.float32)
        return cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)

    def _blurred(self, painted: Any, place: int) -> np.ndarray:
        """Return the mean of the shifted images, with the sensor noise, which is not blurred."""
        rgb = painted(np.zeros_like(self._normal), 0)
        right, down = self._blur_px
        height, width = rgb.shape[:2]
        count = max(2, round(2.0 * float(np.hypot(right, down))))
        total = np.zeros(rgb.shape, dtype=np.float32)
        for t in np.linspace(-0.5, 0.5, count):
            shift = np.array([[1.0, 0.0, t * right], [0.0, 1.0, t * down]])
            total += cv2.warpAffine(rgb, shift, (width, height), borderMode=cv2.BORDER_REPLICATE)
        mean = total / count
        grain = self._normal[place : place + height * width].reshape(height, width, 1) * (1.5 + 0.25 * np.sqrt(mean[:, :, 1:2]))
        return np.clip(mean + grain, 0.0, 255.0).astype(np.uint8)


def _alike(normal: np.ndarray, width_px: int, sigma_px: float) -> np.ndarray:
    """Return spatially correlated normal numbers for an image, with unchanged variance."""
    if sigma_px == 0.0:
        return normal
    whole = len(normal) // width_px * width_px
    smooth = cv2.GaussianBlur(normal[:whole].reshape(-1, width_px), (0, 0), sigma_px)
    alike = normal.copy()
    alike[:whole] = (smooth / smooth.std()).ravel()
    return alike


def _warp(camera: PinholeCamera, spread_px: float, rng: np.random.Generator) -> np.ndarray:
    """Return a smooth random field over the image: Legendre terms of up to third order in both coordinates."""
    u, v = np.linspace(-1.0, 1.0, camera.width_px), np.linspace(-1.0, 1.0, camera.height_px)
    order = np.add.outer(np.arange(4), np.arange(4))
    # Low orders have larger amplitudes, because distortions of lens and projector are smooth.
    field = np.polynomial.legendre.leggrid2d(v, u, rng.standard_normal((4, 4)) / (1.0 + order))
    return spread_px * (field - field.mean()) / field.std()
