"""Common parts of the vendors' adapters: packages, errors on one line, depth counts, calibrations."""

import re
from collections.abc import Callable
from contextlib import redirect_stderr
from importlib import import_module
from io import StringIO
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from treadline.core.errors import CameraError
from treadline.core.images import PinholeCamera

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


def one_line(error: Exception) -> str:
    """Return a vendor's message on one line."""
    return " ".join(str(error).split())[:200]


def metres(counts: np.ndarray, unit_m: float) -> Float32[np.ndarray, "h w"]:
    """Return depth counts of 16 bits in metres; 0 and 65535 mean no return."""
    known = (counts > 0) & (counts < 65535)
    return np.where(known, counts * np.float32(unit_m), np.float32(np.nan)).astype(np.float32)


def rotation_or_none(R: Any) -> Float[np.ndarray, "3 3"] | None:
    """Return a rotation from a vendor's calibration; None if the matrix is not set (zeros) or no rotation."""
    matrix = np.array(R, dtype=float).reshape(3, 3)
    return matrix if np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-2 and np.linalg.det(matrix) > 0.0 else None


class Undistortion:
    """Resampling of a distorted depth image to a pinhole image of the same camera matrix, by the nearest pixel."""

    def __init__(self, camera: PinholeCamera, coefficients: Float[np.ndarray, " n"]) -> None:
        """Compute the map.

        Args:
            coefficients: Distortion in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6.
        """
        import cv2

        K = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
        size = camera.width_px, camera.height_px
        self._maps = cv2.initUndistortRectifyMap(K, np.asarray(coefficients, float), np.eye(3), K, size, cv2.CV_32FC1)
        self._remap: Callable[..., Any] = cv2.remap
        self._nearest, self._outside = cv2.INTER_NEAREST, cv2.BORDER_CONSTANT

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        """Return the undistorted image; depth is never averaged over an edge."""
        return np.asarray(self._remap(counts, *self._maps, self._nearest, borderMode=self._outside, borderValue=0))
