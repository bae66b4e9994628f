"""RGB-D camera without OpenGL: exact depth by ray casting on boxes, then colour and sensor errors."""

import copy
import itertools
from collections.abc import Sequence
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.plant.sensors.camera import ray_kernels as kernels
from treadline.plant.sensors.camera.depth_errors import DISPARITY_PX_M, warp
from treadline.plant.sensors.camera.depth_sensor import sensor_model
from treadline.plant.sensors.camera.rendered_frame import ExactView, RenderedFrame, Sweep
from treadline.plant.sensors.camera.solids import Puddle, SceneBox, Shadow, solids_of
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase

VIEW_M = 7.0
"""Distance beyond which boxes are not rendered [m]; the sensor range is 6 m."""
TEXTURES = ("wood", "concrete", "carpet", "terrazzo", "dark")
"""Names of the surface patterns."""
COLOURS = {
    "wood": (150.0, 105.0, 62.0),
    "concrete": (140.0, 140.0, 136.0),
    "carpet": (96.0, 60.0, 60.0),
    "terrazzo": (165.0, 160.0, 150.0),
    "dark": (45.0, 43.0, 42.0),
}
"""Colour of each surface pattern (red, green, blue)."""
WALL_COLOUR = (185.0, 182.0, 175.0)
"""Colour of walls (red, green, blue)."""
FLOOR_COLOUR = (120.0, 118.0, 115.0)
"""Colour of floors (red, green, blue)."""
POOL = 1_000_000
"""Number of start positions in the stored random numbers of a camera."""
SHADES = (0.72, 0.72, 0.85, 0.8, 0.4, 1.15)
"""Brightness of the sides -x, +x, -y, +y, -z, +z with light from above: risers are darker than treads."""
BANDS, SWEEP_M = 24, 0.2
"""Number of bands of rows with a pose of their own under a rolling shutter: at 30°/s and 33 ms bands differ by 0.04°, 0.2 pixels at
320×240. Largest motion during the readout [m]."""
SQUARE = 0.99
"""Cosine above which a box counts as aligned with the world axes and has the six brightness values unchanged."""


class Camera:
    """Camera in front of a staircase or of any list of solids.

    Args:
        declared: Calibration stored in the frames, if different from the true calibration.
        sigma_px: Standard deviation of the disparity noise [sensor pixels]; None: the sensor's default.
        edge_holes: Whether a Kinect 1 loses the pixels whose correlation window contains a depth jump.
        grain_px: Correlation length of the depth noise [sensor pixels]; zero is white noise.
        warp_px: Smooth, constant depth error across the image [px of Kinect 1 disparity].
        holes: Fraction of the depth image lost in blotches.
        blur_px: Motion of the colour image to the right and down during the exposure [px].
    """

    def __init__(
        self,
        scene: Staircase | Sequence[SceneBox],
        calibration: PinholeCamera,
        *,
        declared: PinholeCamera | None = None,
        kind: str = "kinect1",
        texture: str = "wood",
        light: float = 1.0,
        sigma_px: float | None = None,
        edge_holes: bool = False,
        grain_px: float = 0.0,
        warp_px: float = 0.0,
        holes: float = 0.0,
        blur_px: tuple[float, float] = (0.0, 0.0),
        shadows: Sequence[Shadow] = (),
        puddles: Sequence[Puddle] = (),
        rng: np.random.Generator,
    ) -> None:
        solids = solids_of(stair_boxes(scene)) if isinstance(scene, Staircase) else tuple(scene)
        self.calibration = calibration
        self._declared = declared or calibration
        self._texture = texture
        self._light = light
        self._blur_px = blur_px
        self._holes = holes
        self._shadows = _bands(shadows)
        self._puddles = np.array([[*pool.centre_W, *pool.half_m] for pool in puddles]).reshape(-1, 5)
        self._rng = rng
        # Drawn once; each frame reads its streams from places of its own. Fresh numbers would cost as much as the rest.
        pixels = calibration.width_px * calibration.height_px
        self._normal = rng.standard_normal(POOL + pixels, dtype=np.float32)
        self._chance = rng.random(POOL + pixels, dtype=np.float32)
        self._sensor = sensor_model(
            kind, calibration, self._normal, self._chance, grain_px=grain_px, sigma_px=sigma_px, edge_holes=edge_holes
        )
        self._warp_px = warp(calibration, warp_px, rng) if warp_px > 0.0 else None
        self._face(solids)

    def facing(self, solids: Sequence[SceneBox], shadows: Sequence[Shadow] = ()) -> "Camera":
        """Return a copy of this camera with additional solids; both use the same stream of random numbers."""
        other = self.showing((*self._solids, *solids))
        other._shadows = np.concatenate([self._shadows, _bands(shadows)])  # noqa: SLF001 - as above
        return other

    def showing(self, solids: Sequence[SceneBox]) -> "Camera":
        """Return a copy of this camera before other solids; both use the same stream of random numbers."""
        other = copy.copy(self)
        other._face(solids)  # noqa: SLF001 - its own copy
        return other

    def _face(self, solids: Sequence[SceneBox]) -> None:
        """Convert the scene to arrays for the compiled loops."""
        self._solids = tuple(solids)
        self._patterns = np.array([TEXTURES.index(solid.texture or self._texture) for solid in solids])
        self._centres = np.array([solid.centre_W for solid in solids])
        self._halves = np.array([solid.half_m for solid in solids])
        self._turns = np.array([solid.R_WK for solid in solids])
        colours = {"wall": WALL_COLOUR, "floor": FLOOR_COLOUR}
        self._colours = np.array([solid.colour or colours.get(solid.kind, COLOURS[self._texture]) for solid in solids])
        # Near infrared: what is dark to the eye is less so to the sensor.
        self._albedos = 0.35 + 0.5 * self._colours.mean(axis=1) / 255.0
        self._returns = np.array([solid.returns for solid in solids])
        self._radii = np.linalg.norm(self._halves, axis=1)
        self._large = np.array([solid.kind in ("wall", "floor", "landing") for solid in solids])
        self._shades = np.array([_shades(solid) for solid in solids])
        self._axes = np.array([np.repeat(np.argmax(np.abs(solid.R_WK), axis=0), 2) for solid in solids])

    def exact(self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> ExactView:
        """Return depth and faces without sensor errors."""
        depth, face, near = self._cast(R_WC, p_WC)
        return ExactView(depth_m=depth, face=np.where(face >= 0, 6 * near[face // 6] + face % 6, -1))

    def frame(
        self, t_s: float, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], sweep: Sweep | None = None
    ) -> RgbdFrame:
        """Return a frame with sensor errors; its colours are rendered on first access.

        Args:
            R_WC: Orientation at the time of the middle row.
            p_WC: Position at the time of the middle row.
            sweep: Motion of a rolling shutter during the readout; None: a global shutter. Colours are those of a global shutter.
        """
        depth, face, near = self._cast(R_WC, p_WC) if sweep is None else self._cast_in_bands(R_WC, p_WC, sweep)
        place = int(self._rng.integers(POOL))
        return RenderedFrame(
            t_s=t_s,
            depth_m=self._spoilt(self._measured(depth, face, near), depth, face, near, R_WC, p_WC),
            camera=self._declared,
            painter=partial(self._painted, depth, face, near, R_WC.copy(), p_WC.copy(), place),
        )

    def _painted(
        self,
        depth: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        near: Int[np.ndarray, " b"],
        R_WC: Float[np.ndarray, "3 3"],
        p_WC: Float[np.ndarray, " 3"],
        place: int,
    ) -> UInt8[np.ndarray, "h w 3"]:
        camera = self.calibration
        rgb = np.empty((*depth.shape, 3), dtype=np.uint8)
        kernels.paint(
            depth,
            face,
            R_WC,
            p_WC,
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px,
            self._shades[near],
            self._axes[near],
            self._colours[near],
            self._patterns[near],
            self._light,
            self._shadows,
            self._puddles,
            np.zeros(depth.size, dtype=np.float32) if any(self._blur_px) else self._normal,
            0 if any(self._blur_px) else place,
            rgb,
        )
        return self._blurred(rgb, place) if any(self._blur_px) else rgb

    def _blurred(self, rgb: UInt8[np.ndarray, "h w 3"], place: int) -> UInt8[np.ndarray, "h w 3"]:
        """Return the mean of the shifted images, with the sensor noise, which is not blurred."""
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

    def _cast(
        self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]
    ) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Int[np.ndarray, " b"]]:
        camera, near = self.calibration, self._in_front(R_WC, p_WC, VIEW_M)
        depth = np.empty((camera.height_px, camera.width_px))
        face = np.empty((camera.height_px, camera.width_px), dtype=np.int32)
        self._cast_rows(near, R_WC, p_WC, 0, depth, face)
        return depth, face, near

    def _cast_in_bands(
        self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], sweep: Sweep
    ) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Int[np.ndarray, " b"]]:
        """Return depth and faces with the pose of each band of rows."""
        camera, near = self.calibration, self._in_front(R_WC, p_WC, VIEW_M + SWEEP_M)
        depth = np.empty((camera.height_px, camera.width_px))
        face = np.empty((camera.height_px, camera.width_px), dtype=np.int32)
        rows = np.linspace(0, camera.height_px, BANDS + 1).astype(int)
        for top, bottom in itertools.pairwise(rows.tolist()):
            after = (0.5 * (top + bottom) / camera.height_px - 0.5) * sweep.readout_s
            R_band = cv2.Rodrigues(after * sweep.rate_W)[0] @ R_WC
            self._cast_rows(near, R_band, p_WC + after * sweep.velocity_W, top, depth[top:bottom], face[top:bottom])
        return depth, face, near

    def _in_front(self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], range_m: float) -> Int[np.ndarray, " b"]:
        """Return the indices of the solids that may be in view."""
        towards = self._centres - p_WC
        ahead = towards @ R_WC[:, 2] > -self._radii
        return np.flatnonzero(((np.linalg.norm(towards, axis=1) < self._radii + range_m) & ahead) | self._large)

    def _cast_rows(
        self,
        near: Int[np.ndarray, " b"],
        R_WC: Float[np.ndarray, "3 3"],
        p_WC: Float[np.ndarray, " 3"],
        top: int,
        depth: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
    ) -> None:
        """Fill consecutive rows of the image, from the row ``top`` on."""
        camera = self.calibration
        kernels.cast(
            self._centres[near],
            self._halves[near],
            self._turns[near],
            np.ascontiguousarray(R_WC),
            np.ascontiguousarray(p_WC),
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px - top,
            2.0 * VIEW_M,
            depth,
            face,
        )

    def _spoilt(
        self,
        measured: Float32[np.ndarray, "h w"],
        exact: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        near: Int[np.ndarray, " b"],
        R_WC: Float[np.ndarray, "3 3"],
        p_WC: Float[np.ndarray, " 3"],
    ) -> Float32[np.ndarray, "h w"]:
        """Return measured depth with the errors of puddles, absorbing surfaces, sunlight and sensor warp."""
        if len(self._puddles) and self._sensor is not None:
            c, place = self.calibration, int(self._rng.integers(POOL))
            kernels.soak(measured, exact, R_WC, p_WC, c.fx_px, c.fy_px, c.cx_px, c.cy_px, self._puddles, self._chance, place)
        if self._returns[near].min() < 1.0 and self._sensor is not None:
            place = int(self._rng.integers(POOL))
            chance = self._chance[place : place + measured.size].reshape(measured.shape)
            measured[(face >= 0) & (chance >= self._returns[near][face // 6])] = np.nan
        if self._holes > 0.0:
            coarse = self._rng.standard_normal((measured.shape[0] // 12, measured.shape[1] // 12)).astype(np.float32)
            blotches = cv2.resize(coarse, measured.shape[::-1], interpolation=cv2.INTER_CUBIC)
            measured[blotches < np.quantile(blotches, self._holes)] = np.nan
        if self._warp_px is not None:
            measured = (DISPARITY_PX_M / (DISPARITY_PX_M / measured + self._warp_px)).astype(np.float32)
        return measured

    def _measured(
        self, exact: Float[np.ndarray, "h w"], face: Int[np.ndarray, "h w"], near: Int[np.ndarray, " b"]
    ) -> Float32[np.ndarray, "h w"]:
        """Return what the sensor measures of exact depth."""
        if self._sensor is None:
            return exact.astype(np.float32)
        return self._sensor.measure(exact, face, self._albedos[near], self._rng.integers(POOL, size=4))


def _bands(shadows: Sequence[Shadow]) -> Float[np.ndarray, "n 5"]:
    return np.array([[*band.normal_W, band.level_m, band.half_m] for band in shadows]).reshape(-1, 5)


def _shades(solid: SceneBox) -> Float[np.ndarray, " 6"]:
    """Return the brightness of each side of a solid: the six values weighted by the direction of the side."""
    if np.abs(solid.R_WK).max(axis=0).min() > SQUARE and np.argmax(np.abs(solid.R_WK), axis=0).tolist() == [0, 1, 2]:
        return np.array(SHADES)
    low, high = np.array(SHADES[::2]), np.array(SHADES[1::2])
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = sign * solid.R_WK[:, axis]
            sides.append(float(np.sum(normal**2 * np.where(normal > 0.0, high, low))))
    return np.array(sides)
