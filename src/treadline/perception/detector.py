"""The block: a frame in, a heading out, or nothing.

``RgbdFrame -> HeadingMeasurement | None``; ``see`` gives the map of the stair as well, ``look`` the whole answer, with the
reason of a refusal.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.arrays import shaped
from treadline.errors import ImageError
from treadline.perception.paper import PaperConfig, look_as_printed
from treadline.perception.robust import look_robust
from treadline.perception.sight import SWEPT_HALF_M, Sight
from treadline.perception.stopwatch import Stopwatch
from treadline.signals import HeadingMeasurement, RgbdFrame, StairMap

PAPER_SIGMA_RAD = 2.0 * DEG
"""Declared uncertainty of Algorithm 1: the printed method has none, its RMSE on frames it does not fail on is 2.2°."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """Which way to look."""

    method: Literal["paper", "robust"] = "robust"
    paper: PaperConfig = field(default_factory=PaperConfig)
    swept_half_m: float = SWEPT_HALF_M
    """What the chair sweeps to either side: what stands there is in its way."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """What one frame says to a mission."""

    measurement: HeadingMeasurement | None
    sight: Sight | None
    """The whole answer; None for a frame that cannot be looked at."""

    @property
    def stair_map(self) -> StairMap | None:
        """The stair where the camera looks, made when it is first asked for; None without a heading."""
        return None if self.sight is None else self.sight.stair_map


class StairDetector:
    """Looks at one frame at a time and remembers nothing but how long it took."""

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self._config = config or DetectorConfig()
        self.timings: dict[str, float] = {}
        """Milliseconds by stage of the last look, with its map once that is made; the robust method's only."""

    def step(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> HeadingMeasurement | None:
        """Return the heading seen in a frame, or None; ``look`` tells why there is none.

        Args:
            gravity_C: Vector that points down, in the camera's frame; without it the robust method takes it from the treads.

        Raises:
            RecordError: If gravity is no three numbers.
        """
        return self.see(frame, gravity_C).measurement

    def see(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> Seen:
        """Return heading and map of one frame.

        Raises:
            RecordError: If gravity is no three numbers.
        """
        try:
            sight = self.look(frame, gravity_C)
        except ImageError:
            return Seen(measurement=None, sight=None)  # a frame that cannot be looked at says nothing; the guard sees that
        return Seen(measurement=_measured(frame.t_s, sight), sight=sight)

    def look(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None, *, stages: bool = False) -> Sight:
        """Return all that a frame says; ``stages`` asks the paper's method for its pictures.

        Raises:
            ImageError: If an image is not of the size that the frame's calibration is for.
            RecordError: If gravity is no three numbers.
        """
        if gravity_C is not None:
            gravity_C = shaped("gravity_C", gravity_C, (3,), "three numbers x, y, z")
        size = (frame.camera.height_px, frame.camera.width_px)
        for name, image in (("depth", frame.depth_m), ("colour", frame.rgb) if self._config.method == "paper" else ("", None)):
            if image is not None:
                _check_size(name, image, size)
        if self._config.method == "robust":
            watch = Stopwatch()
            self.timings = watch.laps_ms
            return replace(look_robust(frame, gravity_C, watch), swept_half_m=self._config.swept_half_m)
        return look_as_printed(frame, self._config.paper, PAPER_SIGMA_RAD, stages=stages)


def _check_size(name: str, image: np.ndarray, size: tuple[int, int]) -> None:
    if not isinstance(image, np.ndarray) or image.ndim < 2:
        raise ImageError(f"{name} is no image but {_kind(image)}; its calibration is for {size[1]}×{size[0]} pixels")
    if image.shape[:2] != size:
        raise ImageError(
            f"{name} is {image.shape[1]}×{image.shape[0]} pixels, its calibration is for {size[1]}×{size[0]}; scale fx, "
            "fy, cx and cy with the image"
        )


def _kind(image: object) -> str:
    return f"an array of shape {image.shape}" if isinstance(image, np.ndarray) else f"a {type(image).__name__}"


def _measured(t_s: float, sight: Sight) -> HeadingMeasurement | None:
    if sight.heading_rad is None or sight.sigma_rad is None:
        return None
    return HeadingMeasurement(t_s=t_s, heading_rad=sight.heading_rad, sigma_rad=sight.sigma_rad, edge_count=sight.edge_count)
