"""The data as sums over windows: how many lags they can carry, and the Gram matrices of about ten parts of them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from treadline.errors import PoorExcitation
from treadline.identification import validate
from treadline.identification.gram import Gram, gram
from treadline.models import InputOutputRecord

Scales = tuple[Float[np.ndarray, " m"], Float[np.ndarray, " p"]]
"""Deviation of each input and of each output."""
LAGS_MOST = 12
"""Largest number of lags tried when none is given."""
ROWS_PER_PARAMETER = 8
"""Samples wanted per coefficient of one output."""
PARTS = 10
"""Parts that are left out in turn for the intervals."""


def scales_of(records: list[InputOutputRecord]) -> Scales:
    """Return the deviation of each channel over all records."""
    u, y = np.vstack([record.u for record in records]), np.vstack([record.y for record in records])
    return np.nanstd(u, axis=0), np.nanstd(y, axis=0)


def parts_of(records: list[InputOutputRecord], lags: int | None, order: int | None, scales: Scales) -> list[Gram]:
    """Return the Gram matrices of the data in about ten parts, at the largest number of lags wanted."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    most = lags if lags is not None else _affordable_lags(records)
    needed = max(most, -(-(order or 1) // p), 1)
    wanted = 2 * (1 + m + needed * (m + p))
    if most < needed or _usable(records, needed) <= wanted:
        lost = total - _usable(records, needed)
        raise PoorExcitation(
            f"{total} samples are too few: {m} inputs, {p} outputs and order {order or 'auto'} with {needed} lags need more "
            f"than {wanted}" + (f", and gaps cost {lost}" if lost else "")
        )
    made = []
    for record in records:
        pieces = max(1, round(PARTS * len(record) / total))
        edges = np.linspace(most, len(record), pieces + 1).astype(int)
        for start, stop in pairwise(edges.tolist()):
            if stop > start:
                piece = validate.part(record, start - most, stop)
                made.append(gram(piece, most, feedthrough=True, input_scale=scales[0], output_scale=scales[1]))
    return made


def _usable(records: list[InputOutputRecord], lags: int) -> int:
    """Return the number of samples, less those from which some lag looks back on a gap."""
    usable = 0
    for record in records:
        gaps = np.cumsum(~np.isfinite(np.hstack([record.u, record.y])).all(axis=1))
        in_window = gaps[lags:] - np.concatenate([[0], gaps[: -lags - 1]])
        usable += len(record) - int(np.count_nonzero(in_window))
    return usable


def _affordable_lags(records: list[InputOutputRecord]) -> int:
    """Return the largest number of lags for which there are enough samples per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    enough = [lags for lags in range(1, LAGS_MOST + 1) if _usable(records, lags) >= ROWS_PER_PARAMETER * (1 + m + lags * (m + p))]
    return max(enough, default=0)


def joined(parts: list[Gram]) -> Gram:
    """Return the Gram matrix of several parts together."""
    whole = parts[0]
    for item in parts[1:]:
        whole = whole + item
    return whole


def leading(whole: Gram, lags: int, feedthrough: bool) -> Gram:
    """Return the Gram matrix of fewer lags: a leading block, with or without the column of u_k."""
    m, p = whole.input_scale.size, whole.output_scale.size
    keep = np.arange(1 + m + lags * (m + p))
    if not feedthrough:
        keep = np.delete(keep, np.arange(1, 1 + m))
    return replace(whole, lags=lags, feedthrough=feedthrough, XX=whole.XX[np.ix_(keep, keep)], XY=whole.XY[keep])
