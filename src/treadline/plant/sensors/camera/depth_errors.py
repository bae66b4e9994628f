"""Error parameters of depth sensors.

Kinect 1: structured light, disparity d = f·B/Z with f = 575 px and B = 75 mm, noise of 0.05 px and steps of 1/8 px (σ_Z about 1.4
mm at 1 m, 5.7 mm at 2 m, 12.8 mm at 3 m), 0.8 px of lateral jitter at edges, a shadow next to each edge, dropouts at grazing
angles. The noise belongs to the sensor: an image of 320×240 has the same noise as one of 640×480.

Kinect 2: time of flight, 1 to 2 mm at 1 m and more at low signal, correlated between neighbouring pixels, mixed pixels at edges, no
shadow.

tof: as the Kinect 2, without a filter of mixed pixels (Wasenmüller and Stricker, ACCV workshops 2016: flying pixels fill the gap
between object and background) and with multipath, which rounds concave corners (``multipath_kernels``).

D435, D455: active stereo, disparity d = f·B/Z with B = 50 or 95 mm and f = 387 px at 640×480 (librealsense issue 11511: field of
view of 79.2°). The noise of Z is Z²·σ_d/(f·B) with σ_d of 0.05 to 0.12 px (Keselman et al., CVPR workshops 2017, eq. 2; Intel,
"Tuning depth cameras for best performance"), in steps of 1/32 px (Intel, "Subpixel linearity improvement"), alike over the matching
window of 7×7 px (Keselman et al.: Census cost, aggregated by a box of 7×7). The left imager is the reference: background left of an
object is hidden from the right imager, and a band of f·B/Z columns at the left border has no depth (D400 data sheet, section 4.5).
The search covers 128 disparities, which gives the nearest depth f·B/126. Objects are wider by half of the matching window.

Optional for all: spatially correlated noise, and a smooth warp across the image. Optional for the Kinect 1: pixels lost where the
correlation window contains a depth jump. The window is 9×9 px: two recorded frames of a flight with open risers have holes of 9 px
(median; quartiles 6 and 19 px) across their depth jumps, along columns; rendered open flights have 11 px (9 and 19 px) with this
option, 6 px (1 and 20 px) without.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32

from treadline.core.images import PinholeCamera

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
    mixed_dropped: float = 0.7
    """Fraction of the mixed pixels at depth edges that the driver removes."""
    multipath: bool = False
    """Whether light that takes a detour over another surface adds to the depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveStereo:
    """Parameters of a stereo camera with a projector of texture."""

    baseline_m: float
    sigma_px: float = 0.08
    """Standard deviation of the disparity noise of an image 640 pixels wide [px]."""
    focal_px: float = 387.0
    """Focal length of an image 640 pixels wide [px]."""
    step_px: float = 1.0 / 32.0
    window_px: int = 7
    """Width of the matching window [px]: the correlation length of the noise; objects grow by half of it on each side."""
    disparities: int = 126
    """Largest disparity of the search [px]."""
    far_m: float = 10.0
    fill_m: float
    """Distance at which half of a white wall facing the camera has no depth [m]. Assumption: twice the manufacturer's ideal range
    of 3 m (D435) and 6 m (D455), at which the projector's light has a quarter of the irradiance."""

    @property
    def strength_px_m(self) -> float:
        """Product f·B [px m]."""
        return self.focal_px * self.baseline_m

    @property
    def near_m(self) -> float:
        """Depth at the largest disparity of the search [m]."""
        return self.strength_px_m / self.disparities


FILL_SPREAD = 0.94
"""Standard deviation of the logarithm of the light needed for a match. Assumption: with ``fill_m`` = 6 m, 99 % of a white wall have
depth at 2 m (log(6² / 2²) / 2.33)."""
CORRELATION_PX = 9
"""Width of the Kinect 1 correlation window [px of a disparity image 640 wide]."""

Sensor = StructuredLight | TimeOfFlight | ActiveStereo
"""Parameters of any depth sensor."""
SENSORS: dict[str, Sensor] = {
    "kinect1": StructuredLight(
        focal_px=575.0, baseline_m=0.075, sigma_px=0.05, step_px=0.125, lateral_px=0.8, near_m=0.45, far_m=6.0
    ),
    # Fitted to recorded frames: plane-fit residuals of 1.4 to 2.1 mm in blocks of 16×16 between 0.6 and 1.2 m, three
    # quarters of them alike from one pixel to the next.
    "kinect2": TimeOfFlight(floor_m=0.00115, gain_m=0.00035, ripple_m=0.006, near_m=0.5, far_m=4.5),
    # Azure Kinect, narrow field of view: standard deviation of at most 17 mm (Tölgyessy et al., Sensors 21, 2021, confirm the
    # manufacturer's figure), assumed to be reached by a reflectance of 15 % at the end of the range: 0.017 · 0.15 / 3.86².
    # Floor and pattern are those of the Kinect 2.
    "tof": TimeOfFlight(floor_m=0.00115, gain_m=0.00017, ripple_m=0.006, near_m=0.5, far_m=3.86, mixed_dropped=0.0, multipath=True),
    "d435": ActiveStereo(baseline_m=0.050, fill_m=6.0),
    "d455": ActiveStereo(baseline_m=0.095, fill_m=12.0),
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


def windowed(normal: Float32[np.ndarray, " n"], width_px: int, window_px: int) -> Float32[np.ndarray, " n"]:
    """Return normal numbers averaged over a window of an image and scaled to unit variance: matches of neighbours share pixels."""
    rows = len(normal) // width_px
    smooth = cv2.blur(normal[: rows * width_px].reshape(rows, width_px), (window_px, window_px))
    # The mean of n white numbers has a standard deviation of 1/√n.
    smooth *= window_px
    return np.concatenate([smooth.ravel(), normal[rows * width_px :]])


def warp(camera: PinholeCamera, spread_px: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Return a smooth random field over the image: Legendre terms of up to third order in both coordinates."""
    u, v = np.linspace(-1.0, 1.0, camera.width_px), np.linspace(-1.0, 1.0, camera.height_px)
    order = np.add.outer(np.arange(4), np.arange(4))
    # Low orders have larger amplitudes, because distortions of lens and projector are smooth.
    field = np.polynomial.legendre.leggrid2d(v, u, rng.standard_normal((4, 4)) / (1.0 + order))
    return np.asarray(spread_px * (field - field.mean()) / field.std())
