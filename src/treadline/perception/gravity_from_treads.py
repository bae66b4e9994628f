"""Gravity direction from the treads, without an IMU.

Treads are the surfaces facing up. With a camera held upright and not looking above the horizon, each tread normal lies in the
lower, forward quarter of the frame and no riser normal does: a riser seen from above has its normal pointing upward there. The
largest bundle of normals in that quarter is taken as the treads; the caller checks that risers are perpendicular.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels

ROLL_LIMIT = 20.0 * DEG
"""Largest roll of the camera [rad]."""
BUNDLE = 8.0 * DEG
"""Half width of a bundle of normals [rad]."""
LEAST_BLOCKS = 24
"""Least number of blocks of a bundle."""
MIDDLES = 200
"""Largest number of normals tried as centre of a bundle."""


def down_of_treads(unit: Float[np.ndarray, "b 3"], pitch_limits_rad: tuple[float, float]) -> Float[np.ndarray, " 3"] | None:
    """Return the common direction of most horizontal surfaces, or None.

    Args:
        unit: Unit normals of the blocks in C.
        pitch_limits_rad: Range of the camera's downward pitch.
    """
    away = unit * np.where(unit[:, 2:] < 0.0, -1.0, 1.0)
    pitch = np.arctan2(away[:, 2], away[:, 1])
    roll = np.arcsin(np.clip(away[:, 0], -1.0, 1.0))
    candidates = away[(pitch > pitch_limits_rad[0]) & (pitch < pitch_limits_rad[1]) & (np.abs(roll) < ROLL_LIMIT)]
    if len(candidates) < LEAST_BLOCKS:
        return None
    # A subset of a few hundred normals suffices as candidates for the centre of the bundle.
    middles = candidates[:: max(1, len(candidates) // MIDDLES)]
    alike = middles @ candidates.T > np.cos(BUNDLE)
    bundle = candidates[alike[int(np.argmax(alike.sum(axis=1)))]]
    if len(bundle) < LEAST_BLOCKS:
        return None
    mean = np.median(bundle, axis=0)
    # A bundle truncated by the limits is biased away from them, so all of its members are used.
    whole = levelled(mean / np.linalg.norm(mean), unit, BUNDLE)
    inside = pitch_limits_rad[0] < float(np.arctan2(whole[2], whole[1])) < pitch_limits_rad[1]
    return whole if inside else None


def levelled(imu_down: Float[np.ndarray, " 3"], unit: Float[np.ndarray, "b 3"], spread_rad: float) -> Float[np.ndarray, " 3"]:
    """Return the gravity direction from horizontal surfaces near the IMU's, or the IMU's with too few of them.

    A mount error of several degrees tilts gravity in the camera frame, so that treads would not be at constant height.

    Args:
        imu_down: Unit vector of gravity in C from the IMU.
        unit: Unit normals of the blocks in C.
        spread_rad: Largest angle of a horizontal surface's normal from it.
    """
    mean = np.empty(3)
    enough = kernels.middle_of(unit, imu_down, math.cos(spread_rad), math.cos(BUNDLE), LEAST_BLOCKS, mean)
    return mean if enough else imu_down
