"""RGB-D camera without OpenGL: exact depth by ray casting on boxes, then colour and the errors of a depth sensor."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from treadline.core.camera_images import DepthSensor, PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.rotations import Rotation, Vector3
from treadline.plant.sensors.camera import _ray_kernels as kernels
from treadline.plant.sensors.camera.depth_sensor import model_of
from treadline.plant.sensors.camera.solids import SceneBox, Shadow, solids_of
from treadline.scenario.camera_file import CameraFile
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
SQUARE = 0.99
"""Cosine above which a box counts as aligned with the world axes and has the six brightness values unchanged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactView:
    """Depth and visible faces without sensor errors."""

    depth_m: Float[np.ndarray, "h w"]
    face: Int[np.ndarray, "h w"]
    """Visible face: 6 · solid + side, with the index of the solid in the scene; -1 without a hit."""


class RenderedFrame(RgbdFrame):
    """Frame whose colours are rendered on first access, because the default detector uses depth only.

    All random numbers of the colours are drawn with the frame, so that access to the colours does not affect other frames.
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
        """Colour image, rendered once."""
        if self._rgb is None:
            if self._painter is None:
                raise ImageError("a rendered frame has neither colours nor a painter")
            object.__setattr__(self, "_rgb", self._painter())
        assert self._rgb is not None  # noqa: S101 - for the type checker
        return self._rgb


class Camera:
    """Camera in front of a staircase or of any list of solids.

    Args:
        kind: Depth sensor, a name of ``SENSORS`` in ``depth_sensor``; ``ideal`` measures exact depth.
        device: Camera file whose range and noise law replace those of the kind.
    """

    def __init__(
        self,
        scene: Staircase | Sequence[SceneBox],
        calibration: PinholeCamera,
        *,
        kind: DepthSensor | Literal["ideal"] = "kinect1",
        device: CameraFile | None = None,
        texture: str = "wood",
        light: float = 1.0,
        rng: np.random.Generator,
    ) -> None:
        self.calibration = calibration
        self._texture = texture
        self._light = light
        self._shadows = _bands(())
        self._rng = rng
        # Drawn once; each frame reads its streams from places of its own. Fresh numbers would cost as much as the rest.
        pixels = calibration.width_px * calibration.height_px
        self._normal = rng.standard_normal(POOL + pixels, dtype=np.float32)
        self._chance = rng.random(POOL + pixels, dtype=np.float32)
        self._sensor = None if kind == "ideal" else model_of(kind, calibration, self._normal, self._chance, device)
        self._face(solids_of(stair_boxes(scene)) if isinstance(scene, Staircase) else tuple(scene))

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
        self._radii = np.linalg.norm(self._halves, axis=1)
        self._large = np.array([solid.kind in ("wall", "floor", "landing", "sill") for solid in solids])
        self._shades = np.array([_shades(solid) for solid in solids])
        self._axes = np.array([np.repeat(np.argmax(np.abs(solid.R_WK), axis=0), 2) for solid in solids])

    def exact(self, R_WC: Rotation, p_WC: Vector3) -> ExactView:
        """Return depth and faces without sensor errors."""
        depth, face, near = self._cast(R_WC, p_WC)
        return ExactView(depth_m=depth, face=np.where(face >= 0, 6 * near[face // 6] + face % 6, -1))

    def frame(self, t_s: float, R_WC: Rotation, p_WC: Vector3) -> RgbdFrame:
        """Return a frame with sensor errors; its colours are rendered on first access."""
        depth, face, near = self._cast(R_WC, p_WC)
        place = int(self._rng.integers(POOL))
        return RenderedFrame(
            t_s=t_s,
            depth_m=self.measured(depth, face, near),
            camera=self.calibration,
            painter=partial(self._painted, depth, face, near, R_WC.copy(), p_WC.copy(), self._normal, place),
        )

    def _painted(
        self,
        depth: Float[np.ndarray, "h w"],
        face: Int[np.ndarray, "h w"],
        near: Int[np.ndarray, " b"],
        R_WC: Rotation,
        p_WC: Vector3,
        noise: Float32[np.ndarray, " n"],
        place: int,
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Return the colours; the sensor noise is read from ``noise``, from ``place`` on."""
        camera = self.calibration
        rgb = np.empty((*depth.shape, 3), dtype=np.uint8)
        kernels.paint(
            depth,
            face,
            R_WC,
            p_WC,
            *camera.pinhole,
            self._shades[near],
            self._axes[near],
            self._colours[near],
            self._patterns[near],
            self._light,
            self._shadows,
            noise,
            place,
            rgb,
        )
        return rgb

    def _cast(
        self, R_WC: Rotation, p_WC: Vector3
    ) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"], Int[np.ndarray, " b"]]:
        camera, near = self.calibration, self._in_front(R_WC, p_WC, VIEW_M)
        depth = np.empty((camera.height_px, camera.width_px))
        face = np.empty((camera.height_px, camera.width_px), dtype=np.int32)
        self._cast_rows(near, R_WC, p_WC, 0, depth, face)
        return depth, face, near

    def _in_front(self, R_WC: Rotation, p_WC: Vector3, range_m: float) -> Int[np.ndarray, " b"]:
        """Return the indices of the solids that may be in view."""
        towards = self._centres - p_WC
        ahead = towards @ R_WC[:, 2] > -self._radii
        return np.flatnonzero(((np.linalg.norm(towards, axis=1) < self._radii + range_m) & ahead) | self._large)

    def _cast_rows(
        self,
        near: Int[np.ndarray, " b"],
        R_WC: Rotation,
        p_WC: Vector3,
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

    def measured(
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
