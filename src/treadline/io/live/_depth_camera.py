"""Protocol of a live depth camera, and its images."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from treadline.core.images import PinholeCamera


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraImages:
    """Images of one exposure, registered to the depth camera."""

    t_s: float
    """Stamp of the depth image on the device's clock [s]."""
    depth_m: Float32[np.ndarray, "h w"]
    """Distance along the optical axis [m]; NaN at pixels without a return."""
    rgb: UInt8[np.ndarray, "h w 3"] | None = None
    rgb_t_s: float | None = None
    """Stamp of the colour image on the device's clock [s]."""
    force_C: Float[np.ndarray, " 3"] | None = None
    """Mean specific force since the previous exposure in the camera frame [m/s²]; None without an IMU."""


@runtime_checkable
class DepthCamera(Protocol):
    """Depth camera of any vendor."""

    name: str
    rate_hz: float
    """Nominal frame rate."""

    def open(self, *, colour: bool) -> None:
        """Start the streams.

        Args:
            colour: Whether colour images are wanted.

        Raises:
            CameraError: If the camera is missing or busy, or its package is not installed.
        """
        ...

    def intrinsics(self) -> PinholeCamera:
        """Return the intrinsics of the depth images, as the opened device reports them."""
        ...

    def next_images(self, timeout_s: float) -> CameraImages:
        """Return the next images.

        Raises:
            CameraError: If none arrive in time.
        """
        ...

    def close(self) -> None:
        """Stop the streams; a camera that is not open stays as it is."""
        ...
