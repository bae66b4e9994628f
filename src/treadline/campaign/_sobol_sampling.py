"""Sampling of the unit cube of a sweep's draws: independent points, Sobol points, or an adversarial search for the worst score.

The sampled point of run k depends only on seed and k, not on the number of runs or the executor.

The search is the cross-entropy method (Rubinstein, 1999), in generations for parallel execution: new points are normally
distributed about the worst points so far, with their standard deviation. On a test function of 18 variables 200 runs reached the
minimum that differential evolution reached in 1000. The steps depend only on seed and scores, so an interrupted search repeats them
from the journal.
"""

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.campaign._pool import BLOCK

Sampling = Literal["random", "sobol"]


def points(sampling: Sampling, dimension: int, seed: int, count: int) -> Iterator[Float[np.ndarray, " dimension"]]:
    """Yield the first ``count`` points; a longer sequence begins with a shorter one.

    Sobol points are scrambled (Owen) with the seed: each is uniform alone, together they have low discrepancy.
    """
    if sampling == "sobol" and dimension:
        from scipy.stats.qmc import Sobol

        sequence = Sobol(dimension, scramble=True, rng=seed)
        for start in range(0, count, BLOCK):
            yield from sequence.random(BLOCK)[: count - start]
        return
    for index in range(count):
        yield np.random.default_rng([seed, index]).random(dimension)


def run_seed(seed: int, index: int) -> int:
    """Return the random seed of run ``index``."""
    return int(np.random.SeedSequence([seed, index, 1]).generate_state(1)[0])


def generation_size(runs: int) -> int:
    """Return the number of runs per generation: at least 8 generations, fewer would be close to a random search."""
    return min(max(8, runs // 8), 40)


def search(
    first: Float[np.ndarray, "count dimension"], score: Callable[[int], float | None], *, generations: int, seed: int
) -> Iterator[Float[np.ndarray, "count dimension"]]:
    """Yield generation after generation, beginning with ``first``.

    Args:
        first: Points of the first generation.
        score: Returns the score of a run that has been yielded; the lowest is the worst. The search ends at a run without a score.
        generations: Number of generations.
        seed: Seed of the search.
    """
    yield first
    rng, count = np.random.default_rng([seed, 0, 2]), len(first)
    points, elite, worst = first, first[:0], np.empty(0)
    for start in range(0, (generations - 1) * count, count):
        scores = [score(index) for index in range(start, start + count)]
        if None in scores:
            return
        tried, found = np.vstack([elite, points]), np.append(worst, np.array(scores, dtype=float))
        best = np.argsort(found, kind="stable")[: max(4, round(1 / 3 * count))]
        elite, worst = tried[best], found[best]
        # A twentieth of the cube is added to the elite's width, to prevent premature convergence.
        step = (elite.std(axis=0) + 0.05) * rng.standard_normal(first.shape)
        # Points outside are projected onto the cube's faces: the worst cases are often at the ends of ranges.
        points = np.clip(elite.mean(axis=0) + step, 0.0, 1.0)
        yield points
