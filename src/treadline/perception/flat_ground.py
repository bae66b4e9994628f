"""Obstacles on the horizontal ground ahead: a landing beyond the crest, the floor at the foot.

``RgbdFrame, gravity -> distance``. Without a visible stair there is no map with obstacles; this test needs only gravity and a
stretch of horizontal ground wider than a chair, and detects a person at the head of the stair.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels
from treadline.perception.detection import SWEPT_HALF_M
from treadline.perception.geometry import first_crowd, viewing_direction
from treadline.perception.vectors import cross
from treadline.signals import RgbdFrame

STRIDE_AT_240 = 4
"""Subsampling of the image at 240 rows [px]: a leg at two metres is four points wide."""
LEVEL = float(np.cos(20.0 * DEG))
"""Cosine of the largest angle between a patch's normal and up; noise tilts a patch at two metres by ten degrees."""
GROUND_BIN_M, GROUND_POINTS = 0.03, 40
"""Height range of one ground level [m], and its least number of patches."""
GROUND_HALF_M = 0.5
"""Least lateral extent of the ground [m]: a suitcase's lid is horizontal too, and narrower."""
CLEAR_M, SWEPT_HEIGHT_M = 0.10, 1.5
"""Height above ground below which an object may be noise, and height of a seated person [m]."""
FAR_M = 3.0
"""Largest distance from mid-track [m]: depth beyond is too noisy, and a chair stops within one metre."""
CROWD_M, CROWD_POINTS = 0.10, 6
"""Length of a cluster of points [m], and its least number of points."""


def obstacle_on_flat_ground(
    frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"], swept_half_m: float = SWEPT_HALF_M
) -> float | None:
    """Return the distance from mid-track to the nearest obstacle on the ground in view [m]; None without one.

    Ahead of a climbing chair the ground is the highest level in view, behind a descending one the lowest. Distances are horizontal,
    or along the belts if smaller.

    Args:
        gravity_C: Unit vector pointing down, in the camera frame.
        swept_half_m: Half width of the volume swept by the chair.
    """
    up = -gravity_C
    camera = frame.camera
    way = viewing_direction(camera.R_BC)
    ahead = way * camera.R_BC[0] - float(way * camera.R_BC[0] @ up) * up
    ahead /= np.linalg.norm(ahead)
    stride = max(1, round(STRIDE_AT_240 * camera.height_px / 240))
    points, (far, aside, height) = kernels.places_of(
        frame.depth_m[::stride, ::stride].astype(float),
        stride,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.R_BC.T @ np.array(camera.mount_m),
        np.stack([ahead, cross(ahead, up), up]),
    )
    level_m = kernels.ground_level(
        points, up, LEVEL, far, aside, height, FAR_M, GROUND_BIN_M, GROUND_POINTS, 2.0 * GROUND_HALF_M, way > 0.0
    )
    if math.isnan(level_m):
        return None
    above = (height > level_m + CLEAR_M) & (height < level_m + SWEPT_HEIGHT_M)
    above &= (np.abs(aside) < swept_half_m) & (far > 0.0) & (far < FAR_M)
    if way < 0.0:
        # The steps down to the floor are above the floor, but not above the belts; the top of an object leans towards the chair.
        above &= points @ camera.R_BC[2] > CLEAR_M
        far = np.minimum(far, way * (points @ camera.R_BC[0]))
    return next(iter(first_crowd(far[above], CROWD_M, CROWD_POINTS)), None)
