"""Merging of collinear segments, and the most frequent slope.

Paper: Algorithm 1, step 5; Fig. 5(e): slopes differ by less than 2 px, offsets by less than 10 px.
"""

import numpy as np
from jaxtyping import Float

from treadline.perception.segments import slopes

SLOPE_PX, OFFSET_PX = 2.0, 10.0
SLOPE_BASE_PX = 100.0
"""The paper gives slopes in pixels without a base: here the fall over 100 columns."""
SLOPE_BIN = 0.05


def merged(lines: Float[np.ndarray, "n 4"], middle_px: float) -> Float[np.ndarray, "m 4"]:
    """Return segments after merging pairs until none is left to merge.

    Args:
        lines: Segments, left end first.
        middle_px: Column at which offsets are compared.
    """
    kept: list[Float[np.ndarray, " 4"]] = []
    for line in lines[np.argsort(lines[:, 0] - lines[:, 2], kind="stable")]:
        current = line
        while (partner := _partner(current, kept, middle_px)) is not None:
            current = _union(kept.pop(partner), current)
        kept.append(current)
    return np.array(kept).reshape(-1, 4)


def most_frequent_slope(lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "m 4"]:
    """Return the segments whose slope falls in the fullest bin or beside it."""
    if len(lines) == 0:
        return lines
    bins = np.round(slopes(lines) / SLOPE_BIN).astype(int)
    values, counts = np.unique(bins, return_counts=True)
    return lines[np.abs(bins - values[np.argmax(counts)]) <= 1]


def _partner(line: Float[np.ndarray, " 4"], others: list[Float[np.ndarray, " 4"]], middle_px: float) -> int | None:
    for index, other in enumerate(others):
        (first, second) = slopes(np.array([line, other]))
        rise = (line[1] + first * (middle_px - line[0])) - (other[1] + second * (middle_px - other[0]))
        if abs(first - second) * SLOPE_BASE_PX < SLOPE_PX and abs(rise) < OFFSET_PX:
            return index
    return None


def _union(one: Float[np.ndarray, " 4"], other: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " 4"]:
    ends = np.array([one[:2], one[2:], other[:2], other[2:]])
    return np.concatenate([ends[np.argmin(ends[:, 0])], ends[np.argmax(ends[:, 0])]])
