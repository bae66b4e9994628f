"""Obstacles on the horizontal ground ahead: a landing beyond the crest, the floor at the foot.

``RgbdFrame, gravity -> distance``. Without a visible stair there is no map with obstacles; this test needs only gravity and a
stretch of horizontal ground wider than a chair, and detects a person at the head of the stair.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import Vector3
from treadline.perception import _free_ground_kernels as point_kernels
from treadline.perception._step_parts import viewing_direction

SWEPT_HALF_M = 0.40
"""Half width swept by the shipped wheelchair [m], for frames without a chair."""
SWEPT_HEIGHT_M = 1.5
"""Height of a seated person above the ground or the nosing plane [m]."""
STRIDE_AT_240 = 4
"""Subsampling of the image at 240 rows [px]: a leg at two metres is four points wide."""
LEVEL = float(np.cos(20.0 * DEG))
"""Cosine of the largest angle between a patch's normal and up; noise tilts a patch at two metres by ten degrees."""
GROUND_BIN_M, GROUND_POINTS = 0.03, 40
"""Height range of one ground level [m], and its least number of patches."""
GROUND_HALF_M = 0.5
"""Least lateral extent of the ground [m]: a suitcase's lid is horizontal too, and narrower."""
CLEAR_M = 0.10
"""Height above ground below which an object may be noise [m]."""
FAR_M = 3.0
"""Largest distance from mid-track [m]: depth beyond is too noisy, and a chair stops within one metre."""
CROWD_M, CROWD_POINTS = 0.10, 6
"""Length of a cluster of points [m], and its least number of points."""


def obstacle_on_flat_ground(frame: RgbdFrame, gravity_C: Vector3, swept_half_m: float = SWEPT_HALF_M) -> float | None:
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
    points, (far, aside, height) = point_kernels.places_of(
        frame.depth_m[::stride, ::stride].astype(float),
        stride,
        camera.pinhole,
        camera.R_BC.T @ np.array(camera.mount_m),
        np.stack([ahead, cross(ahead, up), up]),
    )
    level_m = point_kernels.ground_level(
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


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the nearest cluster of at least ``least`` places, in order, and its start; an empty list without one."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []
