"""Protocol of a live depth camera, its images, and the common parts of the vendors' adapters.

Adapters share packages, errors on one line, the wait for images, depth counts and calibrations.
"""

import re
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import CameraError, one_line
from treadline.core.rotations import Rotation, Vector3


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
    force_C: Vector3 | None = None
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


WIDTH_PX, HEIGHT_PX, RATE_HZ = 640, 480, 30
"""Preferred depth stream: the size and rate that all stereo cameras of the table have."""


def vendor_package(module: str, extra: str) -> Any:
    """Return a vendor's module.

    Raises:
        CameraError: If it is not installed, or does not load.
    """
    try:
        with redirect_stderr(StringIO()):  # NumPy explains on a page of stderr why an old extension does not load
            return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise CameraError(f"{module} is installed but lacks {error.name}; install it again") from None
        raise CameraError(f"--live {extra} needs {module}: pip install '.[{extra}]' in treadline's folder") from None
    except ImportError as error:
        raise CameraError(f"{module} is installed but does not load: {one_line(error)}") from None


BUSY = re.compile(r"busy|in use|already|occupied|access|claim|permission|errno=16", re.IGNORECASE)
"""Words in vendors' messages about a device that another program holds."""


def not_opened(name: str, error: Exception) -> CameraError:
    """Return the error for a camera that does not open."""
    text = one_line(error)
    if BUSY.search(text):
        return CameraError(f"{name}: busy ({text}); close the other program that uses it, and check the udev rules for its rights")
    return CameraError(
        f"{name}: cannot be opened{f' ({text})' if text else ''}; is it plugged in (USB 3), and is no other program using it?"
    )


def no_frame(name: str, timeout_s: float, error: Exception | None = None) -> CameraError:
    """Return the error for a camera whose images stop."""
    text = "" if error is None else one_line(error)
    return CameraError(f"{name}: no depth image for {timeout_s:g} s{f' ({text})' if text else ''}; was it unplugged?")


def rotation_or_none(R: Any) -> Rotation | None:
    """Return a rotation from a vendor's calibration; None if the matrix is not set (zeros) or no rotation."""
    matrix = np.array(R, dtype=float).reshape(3, 3)
    return matrix if np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-2 and np.linalg.det(matrix) > 0.0 else None


def undistortion(camera: PinholeCamera, coefficients: Float[np.ndarray, " n"]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the resampling of a distorted depth image to a pinhole image of the same camera matrix, by the nearest pixel.

    Depth is never averaged over an edge.

    Args:
        coefficients: Distortion in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6.
    """
    import cv2

    K = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
    size = camera.width_px, camera.height_px
    maps = cv2.initUndistortRectifyMap(K, np.asarray(coefficients, float), np.eye(3), K, size, cv2.CV_32FC1)
    return lambda counts: np.asarray(cv2.remap(counts, *maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0))


class VendorCamera:
    """Base of the vendors' cameras: their open pipeline, and the rotation of their accelerometer."""

    name: str
    rate_hz = float(RATE_HZ)

    def __init__(self) -> None:
        self._pipeline: Any = None
        self._R_CI: Rotation | None = None

    def close(self) -> None:
        """Stop the streams."""
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            pipeline.stop()

    def _next_depth(
        self, timeout_s: float, forces_in: Callable[[Any], list[list[float]]], *failures: type[Exception]
    ) -> tuple[Any, Any, list[list[float]]]:
        """Return the next frame set with a depth image, the image, and the forces since the last one [m/s²].

        Args:
            forces_in: Function from a frame set to its samples of the accelerometer.
            failures: The vendor's exceptions.

        Raises:
            CameraError: If no depth image comes in time, or the device fails.
        """
        until_s, forces = time.monotonic() + timeout_s, list[list[float]]()
        while (left_ms := int(1e3 * (until_s - time.monotonic()))) > 0:
            try:
                frames = self._pipeline.wait_for_frames(left_ms)
            except failures as error:
                raise no_frame(self.name, timeout_s, error) from None
            if frames is not None:
                forces += forces_in(frames)
                if depth := frames.get_depth_frame():
                    return frames, depth, forces
        raise no_frame(self.name, timeout_s)

    def _force(self, samples: Sequence[Sequence[float]]) -> Vector3 | None:
        """Return the mean specific force in the camera frame; None without samples, or with unknown axes."""
        return self._R_CI @ np.mean(samples, axis=0) if samples and self._R_CI is not None else None
