"""How irregular a stair is thought to be, and how warped the depth, before anything is seen.

Two kinds of places are thought possible. One is as drawn, in all three at once: what a simulator renders, and new concrete seen by
a camera that was calibrated well. In the other each is what it is, whatever the others are; up to what a careful builder leaves,
a few tenths of a degree, each step of a geometric row is nearly as likely as the next, beyond it ever less. That perfection comes
in all or not at all is what keeps nosings that agree by chance from being taken for it: the treads and the depth would have to
agree as well (a spike and a slab: Mitchell, Beauchamp 1988).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG

AS_DRAWN = 0.2
"""How likely it is that all is as drawn."""
AS_DRAWN_RAD, AS_DRAWN_PX = 0.0016 * DEG, 0.0003
"""What is left then; the sensor's noise is more."""
USUAL_RAD = 0.5 * DEG
"""Irregularity that is half as likely as none would let it be, and larger ones ever less: 9.5 mm between the largest and the
smallest step, as building codes allow, over a metre of width."""
POWER, WARP_POWER = 0.1, 0.3
"""Of its size, by which a small irregularity, or a warp, is the likelier the larger it is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """What is tried, and how likely it is beforehand."""

    turns: Float[np.ndarray, " t"]
    """Standard deviations of the steps' angles about the vertical [rad]."""
    tilts: Float[np.ndarray, " k"]
    """Of those off level."""
    warps: Float[np.ndarray, " w"]
    """Sizes of the warp [px]."""
    logs: Float[np.ndarray, "tk w"]
    """Logarithm of the likelihood of each turn with each tilt, and of each warp."""


def prior(
    turns: Float[np.ndarray, " t"],
    tilts: Float[np.ndarray, " k"],
    warps: Float[np.ndarray, " w"],
    *,
    as_drawn: float = AS_DRAWN,
    usual_rad: float = USUAL_RAD,
) -> Prior:
    """Return the likelihood of each that is tried."""
    of_turns, of_tilts = _of_angles(turns, usual_rad), _of_angles(tilts, usual_rad)
    slab = of_turns[:, None, None] * of_tilts[None, :, None] * warps[None, None, :] ** WARP_POWER
    belief = (1.0 - as_drawn) * slab / slab.sum()
    belief[_next_to(turns, AS_DRAWN_RAD), _next_to(tilts, AS_DRAWN_RAD), _next_to(warps, AS_DRAWN_PX)] += as_drawn
    return Prior(turns=turns, tilts=tilts, warps=warps, logs=np.log(belief).reshape(-1, len(warps)))


def _of_angles(sizes: Float[np.ndarray, " n"], usual_rad: float) -> Float[np.ndarray, " n"]:
    return sizes**POWER / (1.0 + sizes / usual_rad)


def _next_to(sizes: Float[np.ndarray, " n"], size: float) -> int:
    return int(np.argmin(np.abs(np.log(sizes / size))))
