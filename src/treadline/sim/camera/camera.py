"""An RGB-D camera without GL: exact depth by casting rays on the staircase's boxes, colour and noise on top.

Kinect 1: structured light, disparity d = f·B/Z with f = 575 px and B = 75 mm, noise of 0.05 px and steps of 1/8 px
(σ_Z about 1.4 mm at 1 m, 5.7 at 2, 12.8 at 3), 0.8 px of lateral jitter at edges, a shadow beside each edge, drop-outs at grazing
angles. The noise is the sensor's: an image of 320×240 has the same as one of 640×480.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from treadline.errors import ImageError
from treadline.mechanics.staircase import Staircase
from treadline.signals import PinholeCamera, RgbdFrame
from treadline.sim.camera import kernels
from treadline.sim.camera.solids import Solid, solids_of

SENSOR_WIDTH_PX = 640
VIEW_M = 7.0
"""Boxes further away than this are not drawn: the sensor ends at 6 m."""
TEXTURES = ("wood", "concrete", "carpet", "terrazzo", "dark")
COLOURS = {
    "wood": (150.0, 105.0, 62.0),
    "concrete": (140.0, 140.0, 136.0),
    "carpet": (96.0, 60.0, 60.0),
    "terrazzo": (165.0, 160.0, 150.0),
    "dark": (45.0, 43.0, 42.0),
}
WALL_COLOUR = (185.0, 182.0, 175.0)
FLOOR_COLOUR = (120.0, 118.0, 115.0)
POOL = 1_000_000
"""Places in the held random numbers at which a frame's streams may start."""
SHADES = (0.72, 0.72, 0.85, 0.8, 0.4, 1.15)
"""Light falls from above: risers are darker than treads."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSensor:
    """One kind of depth sensor."""

    focal_px: float
    """Of the sensor's own disparity image, 640 pixels wide."""
    baseline_m: float
    sigma_px: float
    step_px: float
    lateral_px: float
    near_m: float
    far_m: float


SENSORS = {
    "kinect1": DepthSensor(focal_px=575.0, baseline_m=0.075, sigma_px=0.05, step_px=0.125, lateral_px=0.8, near_m=0.45, far_m=6.0),
    # Time of flight: about 2 mm at 2 m, no steps and no projector's shadow to speak of.
    "kinect2": DepthSensor(focal_px=575.0, baseline_m=0.075, sigma_px=0.02, step_px=0.001, lateral_px=0.5, near_m=0.5, far_m=4.5),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactView:
    """What a perfect sensor would see."""

    depth_m: Float[np.ndarray, "h w"]
    face: Int[np.ndarray, "h w"]
    """6 · solid + side with the place of the solid in the scene; -1 where nothing is hit."""


class RenderedFrame(RgbdFrame):
    """A frame whose colours are painted at the first look: the estimator that drives reads depth alone.

    Every random number it needs is drawn when the frame is taken, so that looking or not changes no other frame.
    """

    __slots__ = ("_painter", "_rgb")
    _painter: Callable[[], UInt8[np.ndarray, "h w 3"]] | None
    _rgb: UInt8[np.ndarray, "h w 3"] | None

    def __init__(
        self,
        *,
        t_s: float,
        depth_m: Float32[np.ndarray, "h w"],
        camera: PinholeCamera,
        rgb: UInt8[np.ndarray, "h w 3"] | None = None,
        painter: Callable[[], UInt8[np.ndarray, "h w 3"]] | None = None,
    ) -> None:
        # Frozen like its base; ``rgb`` is there for ``dataclasses.replace``, which knows the base's fields.
        values = {"t_s": t_s, "depth_m": depth_m, "camera": camera, "_painter": painter, "_rgb": rgb}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def rgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, painted once."""
        if self._rgb is None:
            if self._painter is None:
                raise ImageError("a rendered frame has neither colours nor a painter")
            object.__setattr__(self, "_rgb", self._painter())
        assert self._rgb is not None  # noqa: S101 - for the type checker
        return self._rgb


class Camera:
    """One camera in front of one staircase, or of any solids.

    ``told`` is the calibration its frames carry, where that is not quite true.
    """

    def __init__(
        self,
        scene: Staircase | Sequence[Solid],
        calibration: PinholeCamera,
        *,
        told: PinholeCamera | None = None,
        kind: str = "kinect1",
        texture: str = "wood",
        light: float = 1.0,
        rng: np.random.Generator,
    ) -> None:
        solids = solids_of(scene.boxes()) if isinstance(scene, Staircase) else tuple(scene)
        self.calibration = calibration
        self._told = told or calibration
        self._sensor = SENSORS.get(kind)
        self._pattern = TEXTURES.index(texture)
        self._light = light
        self._rng = rng
        self._centres = np.array([solid.centre_W for solid in solids])
        self._halves = np.array([solid.half_m for solid in solids])
        self._turns = np.array([solid.R_WK for solid in solids])
        colours = {"wall": WALL_COLOUR, "floor": FLOOR_COLOUR}
        self._colours = np.array([solid.colour or colours.get(solid.kind, COLOURS[texture]) for solid in solids])
        self._reach = np.linalg.norm(self._halves, axis=1) + VIEW_M
        self._large = np.array([solid.kind in ("wall", "floor", "landing") for solid in solids])
        # Drawn once; each frame reads its streams from places of its own. Fresh numbers would cost as much as the rest.
        pixels = calibration.width_px * calibration.height_px
        self._normal = rng.standard_normal(POOL + pixels, dtype=np.float32)
        self._chance = rng.random(POOL + pixels, dtype=np.float32)
        self._shades = np.tile(np.array(SHADES), (len(solids), 1))

    def exact(self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> ExactView:
        """Return depth and faces as they are."""
        depth, face, near = self._cast(R_WC, p_WC)
        return ExactView(depth_m=depth, face=np.where(face >= 0, 6 * near[face // 6] + face % 6, -1))

    def frame(self, t_s: float, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> RgbdFrame:
        """Return a frame as the sensor delivers it; its colours are painted when somebody looks at them."""
        depth, face, near = self._cast(R_WC, p_WC)
        place = int(self._rng.integers(POOL))
        return RenderedFrame(
            t_s=t_s,
            depth_m=self._measured(depth, face),
            camera=self._told,
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
            self._colours[near],
            self._pattern,
            self._light,
            self._normal,
            place,
            rgb,
        )
        return rgb

    def _cast(
        self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]
    ) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Int[np.ndarray, " b"]]:
        camera = self.calibration
        towards = self._centres - p_WC
        ahead = towards @ R_WC[:, 2] > -np.linalg.norm(self._halves, axis=1)
        near = np.flatnonzero(((np.linalg.norm(towards, axis=1) < self._reach) & ahead) | self._large)
        depth = np.empty((camera.height_px, camera.width_px))
        face = np.empty((camera.height_px, camera.width_px), dtype=np.int64)
        kernels.cast(
            self._centres[near],
            self._halves[near],
            self._turns[near],
            np.ascontiguousarray(R_WC),
            np.ascontiguousarray(p_WC),
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px,
            2.0 * VIEW_M,
            depth,
            face,
        )
        return depth, face, near

    def _measured(self, exact: Float[np.ndarray, "h w"], face: Int[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        sensor = self._sensor
        if sensor is None:
            return exact.astype(np.float32)
        scale = self.calibration.width_px / SENSOR_WIDTH_PX
        measured = np.empty(exact.shape, dtype=np.float32)
        kernels.kinect(
            exact,
            face,
            sensor.focal_px,
            sensor.baseline_m,
            self.calibration.fx_px * sensor.baseline_m,
            sensor.sigma_px,
            sensor.step_px,
            sensor.lateral_px * scale,
            sensor.near_m,
            sensor.far_m,
            self._normal,
            self._chance,
            self._rng.integers(POOL, size=4),
            measured,
        )
        return measured
