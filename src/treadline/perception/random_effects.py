"""Random-effects model of stair irregularity: estimates averaged over all sizes of the irregularity.

Each size is weighted by its likelihood, with a uniform prior over a geometric grid (DerSimonian, Laird 1986, with a prior in place
of their estimate).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG

TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Grid of the irregularity: standard deviation of the surfaces' angles [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PooledMean:
    """PooledMean estimate of a common value."""

    mean: float
    sigma: float


def pooled_mean(
    values: Float[np.ndarray, " k"],
    variances: Float[np.ndarray, " k"],
    regular: Bool[np.ndarray, " k"],
    sizes: Float[np.ndarray, " g"] = TURNS,
) -> PooledMean:
    """Return the pooled mean of values with known noise and an unknown common irregularity.

    Args:
        regular: Mask of measurements without irregularity: gravity.
        sizes: Grid of the irregularity, in the unit of the values.
    """
    spread = variances[None, :] + np.where(regular, 0.0, 1.0)[None, :] * sizes[:, None] ** 2
    precision = 1.0 / spread
    total = precision.sum(axis=1)
    means = precision @ values / total
    residual = (precision * (values[None, :] - means[:, None]) ** 2).sum(axis=1)
    belief = posterior_weights(-0.5 * (np.log(spread).sum(axis=1) + np.log(total) + residual))
    mean = float(belief @ means)
    return PooledMean(mean=mean, sigma=float(np.sqrt(belief @ (1.0 / total + (means - mean) ** 2))))


def posterior_weights(log_likelihood: Float[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
    """Return the posterior weight of each irregularity from its log likelihood."""
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())
