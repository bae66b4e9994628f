"""Images and calibrations of messages, paired to frames: ``Image``, ``Image``, ``CameraInfo`` -> ``RgbdFrame``.

A ``CameraInfo`` message does not include the camera mount, so decoded mounts are zero.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

from treadline.core.camera_images import MOUNT_FIELDS, PinholeCamera, RgbdFrame, black
from treadline.core.errors import ImageError, LogFormatError

ENCODINGS: dict[str, tuple[str, int]] = {
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8"), ("u1", 4)),
    **dict.fromkeys(("mono8", "8UC1"), ("u1", 1)),
    **dict.fromkeys(("mono16", "16UC1"), ("u2", 1)),
    "32FC1": ("f4", 1),
}
"""Number type and number of channels of the supported encodings."""
BGR = ("bgr8", "bgra8", "8UC3")
PAIR_S = 0.02
"""Largest time between a depth image and its colour image [s]: two thirds of a frame period at 30 Hz."""
PLAUSIBLE_M = (0.05, 100.0)
"""Plausible range of the median depth of a frame [m]; outside, the depth unit is wrong by a factor of 1000."""
MILLIMETRE = 0.001
"""Depth per count of a 16-bit depth image [m], the convention of ROS drivers."""


class Picture(NamedTuple):
    """Image of one message."""

    t_s: float
    encoding: str
    pixels: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        height, width = self.pixels.shape[:2]
        return width, height


def picture(message: Any, t_s: float) -> Picture:
    """Return the image in a sensor_msgs/Image."""
    height, width, encoding, step = message.height, message.width, message.encoding, message.step
    if encoding not in ENCODINGS:
        raise LogFormatError(f"unsupported image encoding '{encoding[:40]}'; supported: {', '.join(ENCODINGS)}")
    number, channels = ENCODINGS[encoding]
    kind = np.dtype((">" if message.is_bigendian else "<") + number)
    row = width * channels * kind.itemsize
    if not 0 < row <= step or height == 0 or len(message.data) != height * step:
        raise LogFormatError(f"an image of {width}×{height} '{encoding}' holds {len(message.data)} bytes in rows of {step}")
    rows = message.data.reshape(height, step)
    values = np.ascontiguousarray(rows[:, :row]).view(kind)
    return Picture(t_s, encoding, values.reshape((height, width, channels) if channels > 1 else (height, width)))


def calibration(message: Any) -> PinholeCamera:
    """Return the camera of a sensor_msgs/CameraInfo."""
    matrix = message.K if hasattr(message, "K") else message.k  # ROS 1 and 2
    fx, _, cx, _, fy, cy = matrix[:6].tolist()
    return PinholeCamera(width_px=message.width, height_px=message.height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def with_mount(camera: PinholeCamera, mount: PinholeCamera) -> PinholeCamera:
    """Return a camera with the mount of another."""
    return replace(camera, **{name: getattr(mount, name) for name in MOUNT_FIELDS})


class Paired(NamedTuple):
    """Frame of a depth image, with the picture of its time or a black one."""

    frame: RgbdFrame
    has_colour: bool


class Pairing:
    """Pairs depth images with colour images of their time and a calibration, in whatever order these come.

    A depth image waits for both. It is given up when a newer one has its colour image, or when ``ahead`` newer ones wait. Of one
    message at most one frame comes of the newest images; those given up come before it, where they are used alone.

    Args:
        has_colour: Whether a depth image waits for a colour image.
        unit_m: Depth per count of a 16-bit depth image [m].
        calibrate: Function from the log's calibration (None before one) to the calibration to use (None: the frames wait).
        lost: Receives the stamp of each depth image that becomes no frame [s], and the reason.
        ahead: Number of images that wait for their other one; where each topic travels by itself, one may be images ahead.
        is_alone_enough: Whether a depth image that is given up becomes a frame without colour.
        is_ours: Whether each depth image has a calibration of its own stamp, as in a run's own log: it waits for that one.
            Elsewhere the newest calibration holds.
    """

    def __init__(
        self,
        *,
        has_colour: bool = True,
        unit_m: float = MILLIMETRE,
        calibrate: Callable[[PinholeCamera | None], PinholeCamera | None] = lambda logged: logged,
        lost: Callable[[float, str], object] = lambda _t_s, _reason: None,
        ahead: int = 1,
        is_alone_enough: bool = False,
        is_ours: bool = False,
    ) -> None:
        self._has_colour, self._is_alone_enough = has_colour, is_alone_enough
        self._unit_m, self._calibrate, self._lost = unit_m, calibrate, lost
        self._camera = calibrate(None)
        self._calibrated_s = -math.inf if is_ours and self._camera is None else math.inf
        self._ahead = ahead
        self._depths = deque[Picture]()
        self._colours = deque[Picture](maxlen=ahead)

    def take(self, role: str, message: Any, t_s: float) -> list[Paired]:
        """Take a message by its role, ``depth``, ``color`` or ``info``; return the frames that it completes.

        Raises:
            ImageError: As the method of the role does.
            LogFormatError: If the message is no image that can be read.
        """
        if role == "info":
            return self.calibrate(calibration(message), t_s)
        return (self.depth if role == "depth" else self.colour)(picture(message, t_s))

    def calibrate(self, camera: PinholeCamera, t_s: float = 0.0) -> list[Paired]:
        """Take a calibration with its stamp [s]; return the frames that it completes.

        Raises:
            ImageError: If the calibration has no focal length, or an image has another size.
        """
        given = self._calibrate(camera)
        if given is None or not (given.fx_px > 0.0 and given.fy_px > 0.0 and math.isfinite(given.cx_px + given.cy_px)):
            raise ImageError(
                f"no intrinsics: fx = {camera.fx_px:g}, fy = {camera.fy_px:g} px; the camera was never calibrated: give --camera "
                "FILE, or --set camera.fx_px, fy_px, cx_px and cy_px"
            )
        self._camera = given
        self._calibrated_s = max(self._calibrated_s, t_s)
        return self._completed()

    def depth(self, image: Picture) -> list[Paired]:
        """Take a depth image; return the frames that it completes.

        Raises:
            ImageError: If an image has not the size of the calibration, or the depth another unit.
        """
        given_up = self._given_up(len(self._depths) + 1 - self._ahead)
        self._depths.append(image)
        return [*given_up, *self._completed()]

    def colour(self, image: Picture) -> list[Paired]:
        """Take a colour image; return the frames that it completes.

        Raises:
            ImageError: If an image has not the size of the calibration, or the depth another unit.
        """
        self._colours.append(image)
        return self._completed()

    def rest(self) -> list[Paired]:
        """Return the frames of the depth images that still wait, at the end of a recording."""
        return self._given_up(len(self._depths))

    def _completed(self) -> list[Paired]:
        """Return the frame of the newest depth image that has its colour image, or needs none, after those given up for it."""
        for place in reversed(range(len(self._depths) if self._camera is not None else 0)):
            depth = self._depths[place]
            near = (colour for colour in self._colours if abs(colour.t_s - depth.t_s) <= PAIR_S)
            # One of another size counts as none where a depth image is enough.
            colour = next((found for found in near if found.size == depth.size or not self._is_alone_enough), None)
            is_calibrated = depth.t_s <= self._calibrated_s
            if is_calibrated and (colour is not None or not self._has_colour):
                return [*self._given_up(place), self._frame(self._depths.popleft(), colour)]
        return []

    def _given_up(self, count: int) -> list[Paired]:
        """Return the frames of the oldest depth images, which wait no longer."""
        images = [self._depths.popleft() for _ in range(count)]
        if self._camera is not None and self._is_alone_enough:
            return [self._frame(image, None) for image in images]
        for image in images:
            self._lost(image.t_s, "no calibration yet" if self._camera is None else "no colour image of its time")
        return []

    def _frame(self, depth: Picture, colour: Picture | None) -> Paired:
        camera = self._camera
        assert camera is not None  # noqa: S101 - for the type checker
        size = camera.width_px, camera.height_px
        for image in (depth, colour):
            if image is not None and image.size != size:
                sizes = f"an image of {image.size[0]}×{image.size[1]} at {image.t_s:.3f} s, calibrated for {size[0]}×{size[1]}"
                raise ImageError(f"sizes differ: {sizes}")
        rgb = black(size[1], size[0]) if colour is None else rgb_pixels(colour)
        return Paired(
            RgbdFrame(t_s=depth.t_s, rgb=rgb, depth_m=depth_metres(depth, self._unit_m), camera=camera), colour is not None
        )


def depth_metres(image: Picture, unit_m: float) -> Float32[np.ndarray, "h w"]:
    """Return the depth in metres, NaN where nothing returned.

    Args:
        unit_m: Depth per count of an image of 16 bits [m].

    Raises:
        ImageError: If the median depth is implausible.
    """
    counts = image.pixels
    if counts.dtype.kind == "u":
        depth = metres(counts, unit_m)
    else:
        depth = np.where(np.isfinite(counts) & (counts > 0.0), counts, np.float32(np.nan))
    some = depth[::4, ::4]
    some = some[some > 0.0]
    middle = float(np.median(some)) if some.size else None
    if middle is not None and not PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        of_counts = "--camera FILE with depth_unit_m=0.001 is for millimetres"
        remedy = of_counts if counts.dtype.kind == "u" else "32FC1 must be in metres"
        raise ImageError(f"the median depth at {image.t_s:.3f} s is {middle:.3g} m: wrong unit? {remedy}")
    return depth.astype(np.float32, copy=False)


def metres(counts: np.ndarray, unit_m: float) -> Float32[np.ndarray, "h w"]:
    """Return depth counts of 16 bits in metres; 0 and 65535 mean no return."""
    known = (counts > 0) & (counts < 65535)
    return np.where(known, counts * np.float32(unit_m), np.float32(np.nan)).astype(np.float32)


def rgb_pixels(image: Picture) -> UInt8[np.ndarray, "h w 3"]:
    """Return the colours of an image in the order red, green, blue."""
    pixels = image.pixels
    if pixels.ndim == 2:
        return np.repeat(pixels[:, :, None], 3, axis=2)
    return np.ascontiguousarray(pixels[:, :, 2::-1] if image.encoding in BGR else pixels[:, :, :3])
