"""Error parameters of depth sensors.

Kinect 1: structured light, disparity d = f·B/Z with f = 575 px and B = 75 mm, noise of 0.05 px and steps of 1/8 px (σ_Z about 1.4
mm at 1 m, 5.7 mm at 2 m, 12.8 mm at 3 m), 0.8 px of lateral jitter at edges, a shadow next to each edge, dropouts at grazing
angles. The noise belongs to the sensor: an image of 320×240 has the same noise as one of 640×480.

Kinect 2: time of flight, 1 to 2 mm at 1 m and more at low signal, correlated between neighbouring pixels, mixed pixels at edges, no
shadow.

Optional for both: spatially correlated noise, and a smooth warp across the image.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32

from treadline.signals import PinholeCamera

DISPARITY_PX_M = 575.0 * 0.075
"""Product f·B of the Kinect 1 [px m]."""
SENSOR_WIDTH_PX, TIME_OF_FLIGHT_WIDTH_PX = 640, 512
"""Width of the Kinect 1 disparity image and of the Kinect 2 depth image [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StructuredLight:
    """Parameters of a structured-light sensor: a projector and a camera that measures the disparity of its pattern."""

    focal_px: float
    """Focal length of the sensor's disparity image, 640 pixels wide [px]."""
    baseline_m: float
    sigma_px: float
    step_px: float
    lateral_px: float
    near_m: float
    far_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOfFlight:
    """Parameters of a time-of-flight sensor, which measures the travel time of its own light."""

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
"""Parameters by sensor name."""


def alike(normal: Float32[np.ndarray, " n"], width_px: int, sigma_px: float) -> Float32[np.ndarray, " n"]:
    """Return spatially correlated normal numbers for an image, with unchanged variance."""
    if sigma_px == 0.0:
        return normal
    whole = len(normal) // width_px * width_px
    smooth = cv2.GaussianBlur(normal[:whole].reshape(-1, width_px), (0, 0), sigma_px)
    alike = normal.copy()
    alike[:whole] = (smooth / smooth.std()).ravel()
    return alike


def warp(camera: PinholeCamera, spread_px: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Return a smooth random field over the image: Legendre terms of up to third order in both coordinates."""
    u, v = np.linspace(-1.0, 1.0, camera.width_px), np.linspace(-1.0, 1.0, camera.height_px)
    order = np.add.outer(np.arange(4), np.arange(4))
    # Low orders have larger amplitudes, because distortions of lens and projector are smooth.
    field = np.polynomial.legendre.leggrid2d(v, u, rng.standard_normal((4, 4)) / (1.0 + order))
    return np.asarray(spread_px * (field - field.mean()) / field.std())
