"""How many lags the data can carry."""

from collections.abc import Sequence

import numpy as np

from treadline.errors import PoorExcitation
from treadline.models import InputOutputRecord

LAGS_MOST = 40
"""Largest number of lags tried when none is given."""
GAPS_LEAVE = 0.4
"""Share of the samples that must be left where windows look back on gaps."""
ROWS_PER_PARAMETER = 8
"""Samples wanted per coefficient of one output."""


def carried_lags(records: Sequence[InputOutputRecord], lags: int | None, order: int | None) -> int:
    """Return the number of lags wanted, or the most that the data carry.

    Raises:
        PoorExcitation: If the data are too short for them, or for the order.
    """
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    most = lags if lags is not None else _affordable_lags(records)
    needed = max(most, -(-(order or 1) // p), 1)
    wanted = 2 * (1 + m + needed * (m + p))
    usable = _usable(records, needed)
    if most < needed or usable <= wanted:
        total = sum(len(record) for record in records)
        raise PoorExcitation(
            f"{total} samples are too few: {m} inputs, {p} outputs and order {order or 'auto'} with {needed} lags need more "
            f"than {wanted}" + (f", and gaps cost {total - usable}" if total > usable else "")
        )
    return most


def _usable(records: Sequence[InputOutputRecord], lags: int) -> int:
    """Return the number of samples, less those from which some lag looks back on a gap."""
    usable = 0
    for record in records:
        gaps = ~np.isfinite(record.y).all(axis=1) | ~np.isfinite(record.u).all(axis=1)
        usable += len(record)
        if gaps.any():
            seen = np.cumsum(gaps)
            usable -= int(np.count_nonzero(seen[lags:] - np.concatenate([[0], seen[: -lags - 1]])))
    return usable


def _affordable_lags(records: Sequence[InputOutputRecord]) -> int:
    """Return the largest number of lags for which there are enough samples per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    for lags in range(LAGS_MOST, 0, -1):
        wanted = ROWS_PER_PARAMETER * (1 + m + lags * (m + p))
        if total >= wanted and _usable(records, lags) >= max(wanted, GAPS_LEAVE * total):
            return lags
    return 0
