"""Frames of a live camera, with the checks of its stream: size, stamps, frame rate, pairing of colour, and gravity."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame, black
from treadline.core.errors import CameraError, ImageError
from treadline.core.rotations import Vector3
from treadline.io.images import PAIR_S
from treadline.io.live import CameraImages, DepthCamera
from treadline.scenario.camera_file import CameraFile

TIMEOUT_S = 2.0
"""Longest wait for an image [s]: 60 frames at 30 Hz; a camera that resets itself on USB takes less than a second."""
SAME_FOCAL = 0.02
"""Largest difference between the focal lengths of device and file: 2 % costs 0.2° of heading (docs/how-to/own-camera)."""


class _FrameRate:
    """Rate of the stamps within the last second, or of the last three stamps."""

    def __init__(self) -> None:
        self._stamps: deque[float] = deque()

    def add(self, t_s: float) -> None:
        """Add a stamp."""
        self._stamps.append(t_s)
        while t_s - self._stamps[0] > 1.0 and len(self._stamps) > 3:
            self._stamps.popleft()

    @property
    def rate_hz(self) -> float | None:
        """Frames per second; None before the third frame."""
        if len(self._stamps) < 3:
            return None
        return (len(self._stamps) - 1) / (self._stamps[-1] - self._stamps[0])


class _GravityAverage:
    """Direction of gravity from the specific force of a camera that moves little: opposite to its mean."""

    def __init__(self) -> None:
        self._mean_C: Vector3 | None = None
        self._t_s = 0.0

    def step(self, t_s: float, force_C: Vector3) -> None:
        """Add a sample to the exponential mean."""
        time_constant_s = 1.0  # two steps of a person who walks with the camera
        weight = 1.0 if self._mean_C is None else 1.0 - np.exp(-max(t_s - self._t_s, 0.0) / time_constant_s)
        before = force_C if self._mean_C is None else self._mean_C
        self._mean_C, self._t_s = before + weight * (force_C - before), t_s

    @property
    def gravity_C(self) -> Vector3 | None:
        """Unit vector that points down in the camera frame; None while the camera accelerates."""
        if self._mean_C is None:
            return None
        size = float(np.linalg.norm(self._mean_C))
        # Standard gravity; cameras without IMU calibration measure 9.4 to 10.2 m/s².
        return -self._mean_C / size if abs(size - 9.80665) <= 0.6 else None


@dataclass(eq=False)
class LiveFrames:
    """Frames of a camera until it is closed or fails; the first iteration opens the camera."""

    camera: DepthCamera
    _: KW_ONLY
    calibration: CameraFile | None = None
    """Mount of the camera. Its intrinsics are compared with those of the device."""
    gravity_C: Vector3 | None = None
    """Direction of gravity in place of the device's IMU."""
    colour: bool = False
    """Whether colour images are wanted."""
    on_warning: Callable[[str], None] = lambda _: None
    """Function that receives each warning when it arises."""
    count: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.rate = _FrameRate()
        self._unpaired = self._repeated = 0
        self._slowest_hz: float | None = None
        self._collapsed = False

    @property
    def warnings(self) -> list[str]:
        """Properties of the stream up to now."""
        counted = [
            (self._unpaired, f"frames used without colour: depth and colour were more than {1e3 * PAIR_S:.0f} ms apart"),
            (self._repeated, "frames left out: their stamps were not later than the one before"),
        ]
        found = [f"{count} {what}" for count, what in counted if count]
        if self._slowest_hz is not None:
            found.append(f"the frame rate fell to {self._slowest_hz:.1f} Hz of {self.camera.rate_hz:.0f} Hz")
        return found

    def __iter__(self) -> Iterator[NamedFrame]:
        camera = self.camera
        gravity, start_s, last_s, number = _GravityAverage(), 0.0, -np.inf, 0
        try:
            camera.open(colour=self.colour)
            pinhole = self._pinhole(camera.intrinsics())
            while True:
                try:
                    images = camera.next_images(TIMEOUT_S)
                except CameraError as error:
                    raise CameraError(f"{error} ({number} frames before)") from None
                if images.t_s <= last_s:
                    self._repeated += 1
                    continue
                start_s = images.t_s if number == 0 else start_s
                last_s = images.t_s
                self._check_rate(images.t_s, images.t_s - start_s)
                if images.force_C is not None:
                    gravity.step(images.t_s, images.force_C)
                down = self.gravity_C if self.gravity_C is not None else gravity.gravity_C
                yield self._named(number, images, images.t_s - start_s, pinhole, down)
                number += 1
        finally:
            camera.close()

    def _pinhole(self, device: PinholeCamera) -> PinholeCamera:
        """Return the device's intrinsics with the mount of the calibration."""
        if self.calibration is None:
            return device
        own = self.calibration.camera
        if (own.width_px, own.height_px) != (device.width_px, device.height_px):
            raise ImageError(
                f"{self.camera.name}: the calibration is for {own.width_px}×{own.height_px}, the camera gives "
                f"{device.width_px}×{device.height_px} pixels; calibrate at this size, or leave --camera out (it gives "
                "the mount only)"
            )
        if abs(own.fx_px / device.fx_px - 1.0) > SAME_FOCAL:
            self.on_warning(
                f"the calibration's fx = {own.fx_px:.1f} px differs from the device's {device.fx_px:.1f} px by "
                f"{100.0 * abs(own.fx_px / device.fx_px - 1.0):.1f} %; the device's is used"
            )
        return replace(own, fx_px=device.fx_px, fy_px=device.fy_px, cx_px=device.cx_px, cy_px=device.cy_px)

    def _check_rate(self, t_s: float, since_start_s: float) -> None:
        """Warn once when the rate collapses, and again if it collapses after a recovery."""
        self.rate.add(t_s)
        rate_hz, nominal_hz = self.rate.rate_hz, self.camera.rate_hz
        if rate_hz is None or since_start_s < 2.0:  # loading the compiled kernels takes a second
            return
        if rate_hz >= 0.5 * nominal_hz:  # automatic exposure in the dark halves the rate at most
            self._collapsed = False
            return
        self._slowest_hz = min(rate_hz, self._slowest_hz or np.inf)
        if not self._collapsed:
            self._collapsed = True
            self.on_warning(
                f"{self.camera.name}: {rate_hz:.1f} of {nominal_hz:.0f} frames per second: a USB 2 port, a long exposure in the "
                "dark, or a slow computer"
            )

    def _named(self, number: int, images: CameraImages, t_s: float, camera: PinholeCamera, down: Vector3 | None) -> NamedFrame:
        height, width = images.depth_m.shape
        if (width, height) != (camera.width_px, camera.height_px):
            raise ImageError(
                f"{self.camera.name}: images of {width}×{height} pixels, intrinsics for {camera.width_px}×{camera.height_px}; "
                "open the camera again, or update its firmware"
            )
        rgb = images.rgb if images.rgb is not None and images.rgb.shape[:2] == (height, width) else None
        if rgb is not None and (images.rgb_t_s is None or abs(images.rgb_t_s - images.t_s) > PAIR_S):
            rgb = None
            self._unpaired += 1
            if self._unpaired == 1 and images.rgb_t_s is not None:
                apart_ms = 1e3 * abs(images.rgb_t_s - images.t_s)
                self.on_warning(
                    f"{self.camera.name}: depth and colour are {apart_ms:.0f} ms apart, at most {1e3 * PAIR_S:.0f} ms are paired; "
                    "depth alone is used"
                )
        frame = RgbdFrame(t_s=t_s, rgb=black(height, width) if rgb is None else rgb, depth_m=images.depth_m, camera=camera)
        return NamedFrame(
            name=f"{number:06d}",
            frame=frame,
            mount_known=self.calibration is not None and self.calibration.mount_known,
            gravity_C=down,
            has_colour=rgb is not None,
            t_s=t_s,
        )
