"""Depth sensors as they err.

Kinect 1: structured light, disparity d = f·B/Z with f = 575 px and B = 75 mm, noise of 0.05 px and steps of 1/8 px
(σ_Z about 1.4 mm at 1 m, 5.7 at 2, 12.8 at 3), 0.8 px of lateral jitter at edges, a shadow beside each edge, drop-outs at grazing
angles. The noise is the sensor's: an image of 320×240 has the same as one of 640×480.

Kinect 2: time of flight, 1 to 2 mm at 1 m and more as the light fades, alike in neighbours, mixed pixels at edges, no shadow.

Both can be given what their plain models lack: noise that is alike in neighbours, and a warp across the image.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32

from treadline.signals import PinholeCamera

DISPARITY_PX_M = 575.0 * 0.075
"""f·B of the Kinect 1."""
SENSOR_WIDTH_PX, TIME_OF_FLIGHT_WIDTH_PX = 640, 512


@dataclass(frozen=True, slots=True, kw_only=True)
class StructuredLight:
    """A projector and a camera that sees its pattern shifted."""

    focal_px: float
    """Of the sensor's own disparity image, 640 pixels wide."""
    baseline_m: float
    sigma_px: float
    step_px: float
    lateral_px: float
    near_m: float
    far_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOfFlight:
    """A camera that measures how long its own light takes."""

    floor_m: float
    gain_m: float
    ripple_m: float
    near_m: float
    far_m: float


SENSORS: dict[str, StructuredLight | TimeOfFlight] = {
    "kinect1": StructuredLight(
        focal_px=575.0, baseline_m=0.075, sigma_px=0.05, step_px=0.125, lateral_px=0.8, near_m=0.45, far_m=6.0
    ),
    # Fitted to recorded frames: plane-fit residuals of 1.4 to 2.1 mm in blocks of 16×16 between 0.6 and 1.2 m, three
    # quarters of them alike from one pixel to the next.
    "kinect2": TimeOfFlight(floor_m=0.00115, gain_m=0.00035, ripple_m=0.006, near_m=0.5, far_m=4.5),
}


def alike(normal: Float32[np.ndarray, " n"], width_px: int, sigma_px: float) -> Float32[np.ndarray, " n"]:
    """Return normal numbers that resemble those beside, above and below them in an image, as widely spread as before."""
    if sigma_px == 0.0:
        return normal
    whole = len(normal) // width_px * width_px
    smooth = cv2.GaussianBlur(normal[:whole].reshape(-1, width_px), (0, 0), sigma_px)
    alike = normal.copy()
    alike[:whole] = (smooth / smooth.std()).ravel()
    return alike


def warp(camera: PinholeCamera, spread_px: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Return a smooth field over the image: what terms of up to third order in both coordinates make."""
    u, v = np.linspace(-1.0, 1.0, camera.width_px), np.linspace(-1.0, 1.0, camera.height_px)
    order = np.add.outer(np.arange(4), np.arange(4))
    # Slow waves are the larger ones: a lens and a projector bend, they do not ripple.
    field = np.polynomial.legendre.leggrid2d(v, u, rng.standard_normal((4, 4)) / (1.0 + order))
    return np.asarray(spread_px * (field - field.mean()) / field.std())
