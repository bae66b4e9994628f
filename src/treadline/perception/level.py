"""What stands in the chair's way on the level that it comes to: a landing beyond the crest, the floor at the foot.

``RgbdFrame, gravity -> distance``. Where no stair is seen there is no map, and nothing in it to stand in the way; a person at the
head of the stair stands there all the same. It asks for no more than gravity and a stretch of level ground wider than a chair.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels
from treadline.perception.geometry import first_crowd, way_of
from treadline.perception.sight import SWEPT_HALF_M
from treadline.perception.vectors import cross
from treadline.signals import RgbdFrame

STRIDE_AT_240 = 4
"""Rows and columns from one point to the next: a leg two metres away is four points wide."""
LEVEL = float(np.cos(20.0 * DEG))
"""Of a patch's normal with up; noise tilts a patch two metres away by ten degrees."""
GROUND_BIN_M, GROUND_POINTS = 0.03, 40
"""Heights that are one ground, and the patches that it needs."""
GROUND_HALF_M = 0.5
"""To one side of the other, at least: a suitcase's lid is level too, and narrower."""
CLEAR_M, SWEPT_HEIGHT_M = 0.10, 1.5
"""The height above the ground below which a thing may be noise; a seated person's height."""
FAR_M = 3.0
"""From mid-track: depth further away is noise, and a chair stops within one."""
CROWD_M, CROWD_POINTS = 0.10, 6
"""Points that stand together, for something to be there."""


def obstacle_on_the_level(frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"], swept_half_m: float = SWEPT_HALF_M) -> float | None:
    """Return how far ahead of mid-track something stands on the ground where the camera looks; None if nothing does.

    Ahead of a chair that climbs its ground is the highest level in view, behind one that backs down it is the lowest. Distances are
    level, or along the belts where that is less.

    Args:
        gravity_C: Unit vector that points down, in the camera's frame.
        swept_half_m: What the chair sweeps to either side.
    """
    up = -gravity_C
    camera = frame.camera
    way = way_of(camera.R_BC)
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
        # The steps that lead down to the floor are above it, but not above the belts; a thing's top leans towards the chair.
        above &= points @ camera.R_BC[2] > CLEAR_M
        far = np.minimum(far, way * (points @ camera.R_BC[0]))
    return next(iter(first_crowd(far[above], CROWD_M, CROWD_POINTS)), None)
