"""Down from the treads, where no IMU tells it.

Treads are the surfaces that look up. A camera that is held upright and does not look above the horizon sees each tread's
normal in the lower, forward quarter of its frame and no riser's: a riser that it looks down on has its normal pointing
upward there. The fullest bundle of normals in that quarter is taken for the treads; whether risers stand square on it
is for the caller to see.
"""

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG

ROLL_LIMIT = 20.0 * DEG
"""How far a camera may be held askew."""
PITCH_LIMITS = (5.0 * DEG, 70.0 * DEG)
"""How far down it may look; closer to level, treads vanish, and a floor below a camera that looks straight down is no stair."""
BUNDLE = 8.0 * DEG
LEAST_BLOCKS = 12


def down_of_treads(unit: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, " 3"] | None:
    """Return the direction most level surfaces agree on, or None.

    Args:
        unit: Unit normals of the blocks in C.
    """
    away = unit * np.where(unit[:, 2:] < 0.0, -1.0, 1.0)
    pitch = np.arctan2(away[:, 2], away[:, 1])
    roll = np.arcsin(np.clip(away[:, 0], -1.0, 1.0))
    candidates = away[(pitch > PITCH_LIMITS[0]) & (pitch < PITCH_LIMITS[1]) & (np.abs(roll) < ROLL_LIMIT)]
    if len(candidates) < LEAST_BLOCKS:
        return None
    alike = candidates @ candidates.T > np.cos(BUNDLE)
    bundle = candidates[alike[int(np.argmax(alike.sum(axis=1)))]]
    if len(bundle) < LEAST_BLOCKS:
        return None
    mean = np.median(bundle, axis=0)
    return np.asarray(mean / np.linalg.norm(mean))
