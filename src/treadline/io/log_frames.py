"""Assembly of frames from depth, colour and calibration messages: ``Image``, ``Image``, ``CameraInfo`` -> ``RgbdFrame``."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, UInt8

from treadline.core.errors import ImageError
from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.io.decode import Picture
from treadline.io.topics import Topics

PAIR_S = 0.02
"""Largest time between a depth image and its colour image [s]: two thirds of a frame period at 30 Hz."""
PLAUSIBLE_M = (0.05, 100.0)
"""Plausible range of the median depth of a frame [m]; outside, the depth unit is wrong by a factor of 1000."""
NO_RETURN = 65535
BGR = ("bgr8", "bgra8", "8UC3")

Calibrate = Callable[[PinholeCamera | None, tuple[int, int]], PinholeCamera | None]
"""Function from the log's calibration (None without one) and image size (width, height) to the calibration to use."""


def as_logged(logged: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
    """Return the log's own calibration."""
    del size
    return logged


class Frames:
    """Pairs depth and colour images of equal time with a calibration to frames."""

    def __init__(
        self,
        topics: Topics,
        size: tuple[int, int],
        unit_m: float,
        calibrate: Calibrate,
        unpaired: Callable[[float, str], None],
    ) -> None:
        """Start without images.

        Args:
            topics: Topics by role.
            size: Width and height of the images [px].
            unit_m: Depth per count of a 16-bit depth image [m].
            calibrate: Function that returns the calibration to use.
            unpaired: Called with the time of a depth image without a frame [s], and the reason.
        """
        self._topics = topics
        self._size = size
        self._unit_m = unit_m
        self._calibrate = calibrate
        self._unpaired = unpaired
        self._camera = calibrate(None, size)
        self._depth: Picture | None = None
        self._color: Picture | None = None

    def calibrate(self, camera: PinholeCamera) -> RgbdFrame | None:
        """Store a calibration; return the frame that it completes, if any.

        Raises:
            ImageError: If the calibration has no focal length.
        """
        self._camera = given = self._calibrate(camera, self._size)
        if given is None or not (given.fx_px > 0.0 and given.fy_px > 0.0 and math.isfinite(given.cx_px + given.cy_px)):
            raise ImageError(
                f"no intrinsics: fx = {camera.fx_px:g}, fy = {camera.fy_px:g} px; the camera was never calibrated: --set "
                "camera.fx_px, fy_px, cx_px and cy_px"
            )
        return self._whole()

    def depth(self, image: Picture) -> RgbdFrame | None:
        """Store a depth image; return the frame that it completes, if any."""
        if self._depth is not None:
            self._unpaired(self._depth.t_s, "no calibration yet" if self._camera is None else "no colour image of its time")
        self._depth = image
        return self._whole()

    def color(self, image: Picture) -> RgbdFrame | None:
        """Store a colour image; return the frame that it completes, if any."""
        self._color = image
        return self._whole()

    def _whole(self) -> RgbdFrame | None:
        depth, color, camera = self._depth, self._color, self._camera
        if depth is None or camera is None:
            return None
        if self._topics.color is not None and (color is None or abs(color.t_s - depth.t_s) > PAIR_S):
            return None
        self._depth = None
        size = (camera.height_px, camera.width_px)
        for image in (depth, color):
            if image is not None and image.pixels.shape[:2] != size:
                height, width = image.pixels.shape[:2]
                raise ImageError(
                    f"sizes differ: an image of {width}×{height} at {image.t_s:.3f} s, calibrated for {size[1]}×{size[0]}"
                )
        # Without colour the picture is black: in the dark depth alone is looked at.
        rgb = np.zeros((*size, 3), np.uint8) if color is None else rgb_pixels(color)
        return RgbdFrame(t_s=depth.t_s, rgb=rgb, depth_m=depth_metres(depth, self._unit_m), camera=camera)


def depth_metres(image: Picture, unit_m: float, millimetres: str = "--set camera.depth_unit_m=0.001") -> Float32[np.ndarray, "h w"]:
    """Return the depth in metres, NaN where nothing returned.

    Args:
        unit_m: Depth per count of an image of 16 bits [m].
        millimetres: Option that sets the unit to millimetres, for the error message.

    Raises:
        ImageError: If the median depth is implausible.
    """
    counts, nothing = image.pixels, np.float32(np.nan)
    if counts.dtype.kind == "u":
        depth = np.where((counts > 0) & (counts < NO_RETURN), counts * np.float32(unit_m), nothing)
    else:
        depth = np.where(np.isfinite(counts) & (counts > 0.0), counts, nothing)
    some = depth[::4, ::4]
    some = some[some > 0.0]
    middle = float(np.median(some)) if some.size else None
    if middle is not None and not PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        remedy = f"{millimetres} is for millimetres" if counts.dtype.kind == "u" else "32FC1 must be in metres"
        raise ImageError(f"the median depth at {image.t_s:.3f} s is {middle:.3g} m: wrong unit? {remedy}")
    return depth.astype(np.float32, copy=False)


def rgb_pixels(image: Picture) -> UInt8[np.ndarray, "h w 3"]:
    """Return the colours of an image in the order red, green, blue."""
    pixels = image.pixels
    if pixels.ndim == 2:
        return np.repeat(pixels[:, :, None], 3, axis=2)
    return np.ascontiguousarray(pixels[:, :, 2::-1] if image.encoding in BGR else pixels[:, :, :3])
