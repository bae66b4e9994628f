"""Size of a stair's irregularity, which is unknown: its prior, and estimates averaged over all sizes.

Each size is weighted by its likelihood on a geometric grid (DerSimonian, Laird 1986, with a prior in place of their estimate). For
the edge direction the prior is a mixture of two components (spike and slab: Mitchell, Beauchamp 1988). The first has no
irregularity and no warp: rendered images, and new concrete seen by a well calibrated camera. In the second all three sizes are
independent; up to the accuracy of a careful builder, a few tenths of a degree, the prior is nearly uniform over the grid, beyond
it decreasing. Since perfection applies to all three sizes or none, nosings that agree by chance do not suffice for the first
component: treads and depth would have to agree as well.
"""

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG

TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Grid of the irregularity: standard deviation of the surfaces' angles [rad]."""


def pooled_mean(
    values: Float[np.ndarray, " k"],
    variances: Float[np.ndarray, " k"],
    regular: Bool[np.ndarray, " k"],
    common: Float[np.ndarray, " k"],
) -> tuple[float, float]:
    """Return the pooled mean of angles with known noise and an unknown common irregularity, and its standard deviation.

    Args:
        regular: Mask of measurements without irregularity: gravity.
        common: Change of each value by one standard deviation of an error that they have in common.
    """
    spread = variances[None, :] + np.where(regular, 0.0, 1.0)[None, :] * TURNS[:, None] ** 2
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
    return mean, float(np.sqrt(belief @ (1.0 / total + (means - mean) ** 2)))


def posterior_weights(log_likelihood: Float[np.ndarray, "*g"]) -> Float[np.ndarray, "*g"]:
    """Return the posterior weight of each irregularity from its log likelihood."""
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())
