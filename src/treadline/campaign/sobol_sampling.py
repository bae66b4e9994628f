"""Sampling of the unit cube: the point of run k depends only on seed and k, not on the number of runs or the executor."""

from typing import Literal

import numpy as np
from jaxtyping import Float

Sampling = Literal["random", "sobol"]


def points(sampling: Sampling, dimension: int, seed: int, count: int) -> Float[np.ndarray, "count dimension"]:
    """Return the first ``count`` points; a longer list begins with a shorter one.

    Sobol points are scrambled (Owen) with the seed: each is uniform alone, together they have low discrepancy.
    """
    if sampling == "sobol" and dimension:
        from scipy.stats.qmc import Sobol

        whole: Float[np.ndarray, "two_to_the_n dimension"]
        whole = Sobol(dimension, scramble=True, rng=seed).random_base2(max(count - 1, 0).bit_length())
        return whole[:count]
    return np.array([np.random.default_rng([seed, index]).random(dimension) for index in range(count)]).reshape(count, dimension)


def run_seed(seed: int, index: int) -> int:
    """Return the random seed of run ``index``."""
    return int(np.random.SeedSequence([seed, index, 1]).generate_state(1)[0])
