"""Gravity direction in a frame: from the treads without an IMU, and by both together.

Treads are the surfaces facing up. With a camera held upright and not looking above the horizon, each tread normal lies in the
lower, forward quarter of the frame and no riser normal does: a riser seen from above has its normal pointing upward there. The
largest bundle of normals in that quarter is taken as the treads; the caller checks that risers are perpendicular.
"""

import math
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import Vector3

GRAVITY_SIGMA = 0.5 * DEG
"""Standard deviation of gravity from the IMU [rad]."""
ROLL_LIMIT = 20.0 * DEG
"""Largest roll of the camera [rad]."""
BUNDLE = 8.0 * DEG
"""Half width of a bundle of normals [rad]."""
BUNDLE_BLOCKS = 24
"""Least number of blocks of a bundle."""
MIDDLES = 200
"""Number of normals of a frame that suffice to find a common direction."""
GRAVITY_REJECTED, AGREED_SHARE = 2.0, 0.5
"""Number of declared standard deviations between treads and IMU above which the IMU is rejected, and the agreement of the treads as
a fraction of it."""


def down_of_treads(unit: Float[np.ndarray, "b 3"], pitch_limits_rad: tuple[float, float]) -> Vector3 | None:
    """Return the common direction of most horizontal surfaces, or None.

    Args:
        unit: Unit normals of the blocks in C.
        pitch_limits_rad: Range of the camera's downward pitch.
    """
    away = unit * np.where(unit[:, 2:] < 0.0, -1.0, 1.0)
    pitch = np.arctan2(away[:, 2], away[:, 1])
    roll = np.arcsin(np.clip(away[:, 0], -1.0, 1.0))
    candidates = away[(pitch > pitch_limits_rad[0]) & (pitch < pitch_limits_rad[1]) & (np.abs(roll) < ROLL_LIMIT)]
    if len(candidates) < BUNDLE_BLOCKS:
        return None
    # A few hundred normals suffice to find the centre of the largest bundle.
    middles = candidates[:: max(1, len(candidates) // MIDDLES)]
    centre = middles[int(np.argmax(np.count_nonzero(middles @ middles.T > np.cos(BUNDLE), axis=1)))]
    bundle = candidates[candidates @ centre > np.cos(BUNDLE)]
    if len(bundle) < BUNDLE_BLOCKS:
        return None
    mean = np.median(bundle, axis=0)
    # A bundle truncated by the limits is biased away from them, so all of its members are used.
    whole = levelled(mean / np.linalg.norm(mean), unit, BUNDLE)
    inside = pitch_limits_rad[0] < float(np.arctan2(whole[2], whole[1])) < pitch_limits_rad[1]
    return whole if inside else None


def levelled(imu_down: Vector3, unit: Float[np.ndarray, "b 3"], spread_rad: float) -> Vector3:
    """Return the gravity direction from horizontal surfaces near the IMU's, or the IMU's with too few of them.

    A mount error of several degrees tilts gravity in the camera frame, so that treads would not be at constant height.

    Args:
        imu_down: Unit vector of gravity in C from the IMU.
        unit: Unit normals of the blocks in C.
        spread_rad: Largest angle of a horizontal surface's normal from it.
    """
    cosines = unit @ imu_down
    near = np.abs(cosines) > math.cos(spread_rad)
    if np.count_nonzero(near) < BUNDLE_BLOCKS:
        return imu_down
    normals = unit[near] * np.sign(cosines[near])[:, None]
    middle = np.median(normals, axis=0)
    bundle = normals[normals @ middle > math.cos(BUNDLE) * np.linalg.norm(middle)]
    if len(bundle) < BUNDLE_BLOCKS:
        return imu_down
    mean = bundle.mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def gravity_variance(tilts: Float[np.ndarray, " k"], sigma_rad: float) -> float:
    """Return the variance of the IMU's gravity direction, from the tilt of the treads [rad²].

    Treads that agree with each other but not with the IMU indicate a mount error: degrees where half a degree is declared.

    Args:
        tilts: Angles of the treads about one axis relative to the IMU's horizontal.
        sigma_rad: Declared standard deviation.
    """
    if len(tilts) >= 2:
        gap, error = abs(median(tilts.tolist())), float(np.std(tilts, ddof=1)) / math.sqrt(len(tilts))
        if gap > GRAVITY_REJECTED * math.hypot(sigma_rad, error):
            return gap**2
    return sigma_rad**2


def off_gravity(normals: Float[np.ndarray, "k 3"], imu_down: Vector3) -> float | None:
    """Return the mean tilt of the treads from the IMU's gravity if they agree against the IMU about both axes; else None.

    Args:
        normals: Unit normals of the treads, all pointing down.
        imu_down: Unit vector of gravity from the IMU.
    """
    if len(normals) < 2:
        return None
    mean = normals.mean(axis=0)
    gap = float(np.arccos(np.clip(mean @ imu_down / np.linalg.norm(mean), -1.0, 1.0)))
    apart = float(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0)))
    return gap if apart < AGREED_SHARE * gap else None
