"""How irregular a stair is, nobody knows beforehand: what is sought is averaged over all that is thought possible.

Each degree of irregularity counts by its likelihood, under a prior by which each step of a geometric row is as likely as the
next (a random-effects model: DerSimonian, Laird 1986, with a prior in place of their estimate).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG

TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Irregularities of a stair that are thought possible: spread of its surfaces' angles."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pooled:
    """The common value of some measurements."""

    mean: float
    sigma: float


def pooled(values: Float[np.ndarray, " k"], variances: Float[np.ndarray, " k"], regular: Bool[np.ndarray, " k"]) -> Pooled:
    """Return the common angle of measurements that scatter by their noise and by an unknown irregularity.

    Args:
        regular: Measurements that do not suffer from the irregularity: gravity.
    """
    spread = variances[None, :] + np.where(regular, 0.0, 1.0)[None, :] * TURNS[:, None] ** 2
    precision = 1.0 / spread
    total = precision.sum(axis=1)
    means = precision @ values / total
    misfit = (precision * (values[None, :] - means[:, None]) ** 2).sum(axis=1)
    belief = believed(-0.5 * (np.log(spread).sum(axis=1) + np.log(total) + misfit))
    mean = float(belief @ means)
    return Pooled(mean=mean, sigma=float(np.sqrt(belief @ (1.0 / total + (means - mean) ** 2))))


def believed(log_likelihood: Float[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
    """Return the weight of each irregularity from its log likelihood."""
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())
