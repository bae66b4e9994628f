"""Adversarial search for the run with the worst score within a sweep's ranges.

Cross-entropy method (Rubinstein, 1999) on the unit cube of the draws, in generations for parallel execution: new points are
normally distributed about the worst points so far, with their standard deviation. On a test function of 18 variables 200
runs reached the minimum that differential evolution reached in 1000. The steps depend only on seed and scores, so an
interrupted search repeats them from the journal.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Evaluate = Callable[[Float[np.ndarray, "count dimension"]], list[float]]
"""Function from points of the cube to scores; the lowest score is the worst."""

SMALLEST, LARGEST = 8, 40
GENERATIONS = 8
"""Smallest number of generations; fewer would be close to a random search."""
ELITE = 1 / 3
"""Elite size as a share of a generation."""
WIDTH = 0.05
"""Width added to the elite's standard deviation, as a share of the cube, to prevent premature convergence."""


def generation_size(runs: int) -> int:
    """Return the number of runs per generation."""
    return min(max(SMALLEST, runs // GENERATIONS), LARGEST)


def budget(runs: int) -> int:
    """Return the number of runs of a search: complete generations only."""
    return runs // generation_size(runs) * generation_size(runs)


def search(first: Float[np.ndarray, "count dimension"], evaluate: Evaluate, *, generations: int, seed: int) -> None:
    """Evaluate generation after generation, beginning with ``first``; ``evaluate`` stores the results."""
    rng = np.random.default_rng([seed, 0, 2])
    tried, scores = first, evaluate(first)
    for _ in range(generations - 1):
        elite = tried[np.argsort(scores, kind="stable")[: max(4, round(ELITE * len(first)))]]
        step = (elite.std(axis=0) + WIDTH) * rng.standard_normal(first.shape)
        # Points outside are projected onto the cube's faces: the worst cases are often at the ends of ranges.
        points = np.clip(elite.mean(axis=0) + step, 0.0, 1.0)
        tried, scores = np.vstack([tried, points]), scores + evaluate(points)
