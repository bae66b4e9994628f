"""Down from the treads, where no IMU tells it.

Treads are the surfaces that look up. A camera that is held upright and does not look above the horizon sees each tread's
normal in the lower, forward quarter of its frame and no riser's: a riser that it looks down on has its normal pointing
upward there. The fullest bundle of normals in that quarter is taken for the treads; whether risers stand square on it
is for the caller to see.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels

ROLL_LIMIT = 20.0 * DEG
"""How far a camera may be held askew."""
BUNDLE = 8.0 * DEG
LEAST_BLOCKS = 24
MIDDLES = 200


def down_of_treads(unit: Float[np.ndarray, "b 3"], pitch_limits_rad: tuple[float, float]) -> Float[np.ndarray, " 3"] | None:
    """Return the direction most level surfaces agree on, or None.

    Args:
        unit: Unit normals of the blocks in C.
        pitch_limits_rad: How far down the camera may look.
    """
    away = unit * np.where(unit[:, 2:] < 0.0, -1.0, 1.0)
    pitch = np.arctan2(away[:, 2], away[:, 1])
    roll = np.arcsin(np.clip(away[:, 0], -1.0, 1.0))
    candidates = away[(pitch > pitch_limits_rad[0]) & (pitch < pitch_limits_rad[1]) & (np.abs(roll) < ROLL_LIMIT)]
    if len(candidates) < LEAST_BLOCKS:
        return None
    # A few hundred stand for all as the bundle's middle.
    middles = candidates[:: max(1, len(candidates) // MIDDLES)]
    alike = middles @ candidates.T > np.cos(BUNDLE)
    bundle = candidates[alike[int(np.argmax(alike.sum(axis=1)))]]
    if len(bundle) < LEAST_BLOCKS:
        return None
    mean = np.median(bundle, axis=0)
    # A bundle cut by the limits leans away from them: the whole of it tells.
    whole = levelled(mean / np.linalg.norm(mean), unit, BUNDLE)
    inside = pitch_limits_rad[0] < float(np.arctan2(whole[2], whole[1])) < pitch_limits_rad[1]
    return whole if inside else None


def levelled(told: Float[np.ndarray, " 3"], unit: Float[np.ndarray, "b 3"], spread_rad: float) -> Float[np.ndarray, " 3"]:
    """Return down as the level surfaces near the IMU's idea of it have it, or that idea where there are too few.

    A mount that is off by degrees tilts gravity in the camera's frame; treads then no longer lie at one height each.

    Args:
        told: Unit vector in C that the IMU calls down.
        unit: Unit normals of the blocks in C.
        spread_rad: How far a level surface's normal may lie from it.
    """
    mean = np.empty(3)
    enough = kernels.middle_of(unit, told, math.cos(spread_rad), math.cos(BUNDLE), LEAST_BLOCKS, mean)
    return mean if enough else told
