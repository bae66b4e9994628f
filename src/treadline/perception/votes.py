"""Azimuth of the stair by votes of vertical blocks and ends of treads."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception.lines import Line
from treadline.perception.steps import Axes
from treadline.perception.vectors import cross

VOTE_LIMIT = 50.0 * DEG
"""Azimuth beyond which a vertical surface is a side wall [rad]."""
VOTE_BIN = 2.0 * DEG
"""Width of a bin of the vote [rad]."""
VOTES = 3
"""Number of peaks tried: a wall at the landing can outvote the last risers."""
APART = 14.0 * DEG
"""Least angle between two peaks [rad]."""
LEAST_VOTES = 16
"""Least number of votes of a peak."""
PLACE_STEP, PLACE_BIN_M = 3.0 * DEG, 0.04
"""Steps of azimuth [rad] and of distance [m] in the search of azimuths at which blocks lie at few distances: half a step turns a
riser 1 m wide over 26 mm of distance."""
WIDTH_PX = 320
"""Image width at which a line's columns have the same weight as blocks [px]."""


def line_votes(lines: Sequence[Line], width_px: int, level: Axes) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the azimuths of lines, and their weights."""
    azimuths, weights = [], []
    for line in lines:
        across = cross(cross(line.normal, level.up), level.up)
        across = across if across @ level.ahead > 0.0 else -across
        azimuths.append(math.atan2(float(across @ level.right), float(across @ level.ahead)))
        weights.append(line.count * WIDTH_PX / width_px)
    return np.array(azimuths), np.array(weights)


def votes_of(
    blocks: Float[np.ndarray, " b"], lines: Float[np.ndarray, " k"], line_weights: Float[np.ndarray, " k"]
) -> Iterator[float]:
    """Yield the azimuths with most vertical blocks and lines, the strongest first."""
    seen = np.concatenate([blocks, lines])
    weights = np.concatenate([np.ones(len(blocks)), line_weights])
    inside = np.abs(seen) < VOTE_LIMIT
    seen, weights = seen[inside], weights[inside]
    edges = np.arange(-VOTE_LIMIT, VOTE_LIMIT + VOTE_BIN, VOTE_BIN)
    counts = np.bincount(np.searchsorted(edges, seen, side="right") - 1, weights, minlength=edges.size - 1)[: edges.size - 1]
    smooth = np.convolve(counts, [0.5, 1.0, 1.0, 1.0, 0.5], mode="same")
    for _ in range(VOTES):
        top = int(np.argmax(smooth))
        if smooth[top] < LEAST_VOTES:
            return
        peak = float(edges[top] + 0.5 * VOTE_BIN)
        for width in (10.0 * DEG, 6.0 * DEG):
            near = np.abs(seen - peak) < width
            if near.any():
                peak = _weighted_median(seen[near], weights[near])
        yield peak
        middle = edges[:-1] + 0.5 * VOTE_BIN
        smooth[np.abs(middle - edges[top]) < APART] = 0.0


def place_votes(points: Float[np.ndarray, "b 3"], level: Axes) -> Iterator[float]:
    """Yield the azimuths at which points lie at the fewest distances, as those on risers do, the best first."""
    azimuths = np.arange(-VOTE_LIMIT, VOTE_LIMIT + PLACE_STEP, PLACE_STEP)
    scores = np.empty(azimuths.size)
    for k, azimuth in enumerate(azimuths):
        places = points @ (math.cos(azimuth) * level.ahead + math.sin(azimuth) * level.right) / PLACE_BIN_M
        counts = np.bincount(np.maximum(places, 0.0).astype(np.int64), minlength=2)
        both = counts[:-1] + counts[1:]
        scores[k] = float(both @ both)
    for _ in range(VOTES):
        best = int(np.argmax(scores))
        if not scores[best] > 0.0:
            return
        yield float(azimuths[best])
        scores[np.abs(azimuths - azimuths[best]) < APART] = 0.0


def _weighted_median(values: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])
