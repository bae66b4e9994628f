"""Results of the camera: exact views, and frames with sensor errors whose colours are rendered on demand."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from treadline.core.errors import ImageError
from treadline.core.images import PinholeCamera, RgbdFrame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactView:
    """Depth and visible faces without sensor errors."""

    depth_m: Float[np.ndarray, "h w"]
    face: Int[np.ndarray, "h w"]
    """Visible face: 6 · solid + side, with the index of the solid in the scene; -1 without a hit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Motion of the camera while a rolling shutter reads the image from the top row to the bottom row."""

    readout_s: float
    velocity_W: Float[np.ndarray, " 3"]
    rate_W: Float[np.ndarray, " 3"]
    """Angular velocity [rad/s]."""


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
