"""Size of a stair's irregularity, which is unknown: its prior, and estimates averaged over all sizes.

Each size is weighted by its likelihood on a geometric grid (DerSimonian, Laird 1986, with a prior in place of their estimate). For
the edge direction the prior is a mixture of two components (spike and slab: Mitchell, Beauchamp 1988). The first has no
irregularity and no warp: rendered images, and new concrete seen by a well calibrated camera. In the second all three sizes are
independent; up to the accuracy of a careful builder, a few tenths of a degree, the prior is nearly uniform over the grid, beyond
it decreasing. Since perfection applies to all three sizes or none, nosings that agree by chance do not suffice for the first
component: treads and depth would have to agree as well.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG

AS_DRAWN = 0.2
"""Prior probability of the first component: the smallest sizes of the grids."""
USUAL_RAD = 0.5 * DEG
"""Irregularity at which the prior is halved [rad], decreasing beyond: 9.5 mm between the largest and the smallest step, the limit
of building codes, over a metre of width."""
POWER, WARP_POWER = 0.1, 0.3
"""Exponents of the prior at small sizes, for irregularity and warp."""
TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Grid of the irregularity: standard deviation of the surfaces' angles [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """Grids of the nuisance parameters, and their log prior."""

    turns: Float[np.ndarray, " t"]
    """Standard deviations of the steps' angles about the vertical [rad]."""
    tilts: Float[np.ndarray, " k"]
    """Standard deviations of the steps' tilts from horizontal [rad]."""
    warps: Float[np.ndarray, " w"]
    """Sizes of the warp [px]."""
    logs: Float[np.ndarray, "tk w"]
    """Log prior of each pair of rotation and tilt, and of each warp."""


def prior(
    turns: Float[np.ndarray, " t"],
    tilts: Float[np.ndarray, " k"],
    warps: Float[np.ndarray, " w"],
    *,
    as_drawn: float = AS_DRAWN,
    usual_rad: float = USUAL_RAD,
) -> Prior:
    """Return the prior on the given grids."""
    of_turns, of_tilts = _of_angles(turns, usual_rad), _of_angles(tilts, usual_rad)
    slab = of_turns[:, None, None] * of_tilts[None, :, None] * warps[None, None, :] ** WARP_POWER
    belief = (1.0 - as_drawn) * slab / slab.sum()
    belief[0, 0, 0] += as_drawn
    return Prior(turns=turns, tilts=tilts, warps=warps, logs=np.log(belief).reshape(-1, len(warps)))


def _of_angles(sizes: Float[np.ndarray, " n"], usual_rad: float) -> Float[np.ndarray, " n"]:
    return sizes**POWER / (1.0 + sizes / usual_rad)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PooledMean:
    """Estimate of a common value."""

    mean: float
    sigma: float


def pooled_mean(
    values: Float[np.ndarray, " k"],
    variances: Float[np.ndarray, " k"],
    regular: Bool[np.ndarray, " k"],
    sizes: Float[np.ndarray, " g"] = TURNS,
    common: Float[np.ndarray, " k"] | float = 0.0,
) -> PooledMean:
    """Return the pooled mean of values with known noise and an unknown common irregularity.

    Args:
        regular: Mask of measurements without irregularity: gravity.
        sizes: Grid of the irregularity, in the unit of the values.
        common: Change of each value by one standard deviation of an error that they have in common.
    """
    spread = variances[None, :] + np.where(regular, 0.0, 1.0)[None, :] * sizes[:, None] ** 2
    precision = 1.0 / spread
    # Sherman-Morrison: the common error adds the product of ``common`` with itself to the covariance.
    shared = precision * common
    kept = 1.0 / (1.0 + (shared * common).sum(axis=1))
    total = precision.sum(axis=1) - kept * shared.sum(axis=1) ** 2
    means = (precision @ values - kept * shared.sum(axis=1) * (shared @ values)) / total
    off = values[None, :] - means[:, None]
    residual = (precision * off**2).sum(axis=1) - kept * (shared * off).sum(axis=1) ** 2
    belief = posterior_weights(-0.5 * (np.log(spread).sum(axis=1) - np.log(kept) + np.log(total) + residual))
    mean = float(belief @ means)
    return PooledMean(mean=mean, sigma=float(np.sqrt(belief @ (1.0 / total + (means - mean) ** 2))))


def posterior_weights(log_likelihood: Float[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
    """Return the posterior weight of each irregularity from its log likelihood."""
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())
