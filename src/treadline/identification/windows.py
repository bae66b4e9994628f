"""How many lags the data can carry."""

from collections.abc import Sequence

import numpy as np

from treadline.errors import TooFewSamples
from treadline.models import InputOutputRecord

LAGS_MOST = 40
"""Largest number of lags tried when none is given."""
WINDOWS_LEAVE = 0.4
"""Share of the samples that must be left where windows look back on gaps, or beyond the start of a short record."""
ROWS_PER_PARAMETER = 8
"""Windows wanted per coefficient of one output."""
ROWS_LEAST = 2
"""Windows per coefficient that must be exceeded where the number of lags is given."""


def carried_lags(records: Sequence[InputOutputRecord], lags: int | None, order: int | None) -> int:
    """Return the number of lags wanted, or the most that the data carry.

    Raises:
        TooFewSamples: If the data are too short for them, or for the order.
    """
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    most = lags if lags is not None else _affordable_lags(records)
    needed = max(most, -(-(order or 1) // p), 1)
    whole, lost = _windows(records, needed)
    if most < needed or whole <= ROWS_LEAST * _unknowns(m, p, needed):
        total = sum(len(record) for record in records)
        least = fewest_samples(m, p, lags=lags, order=order, records=len(records))
        raise TooFewSamples(
            f"{total} samples are too few: {m} inputs, {p} outputs and order {order or 'auto'} with {needed} lags need at least "
            f"{least}" + (f", and gaps cost {lost}" if lost else "")
        )
    return most


def fewest_samples(inputs: int, outputs: int, *, lags: int | None = None, order: int | None = None, records: int = 1) -> int:
    """Return how many samples without a gap carry what is asked; the first ``lags`` of each record are targets of no window."""
    needed = max(lags or 0, -(-(order or 1) // outputs), 1)
    unknowns = _unknowns(inputs, outputs, needed)
    return (ROWS_PER_PARAMETER * unknowns if lags is None else ROWS_LEAST * unknowns + 1) + needed * records


def _unknowns(m: int, p: int, lags: int) -> int:
    """Return the coefficients of one output: a constant, the inputs now, and inputs and outputs of each lag."""
    return 1 + m + lags * (m + p)


def _windows(records: Sequence[InputOutputRecord], lags: int) -> tuple[int, int]:
    """Return the number of windows, the first samples of each record being targets of none, and how many a gap costs."""
    whole = lost = 0
    for record in records:
        count = max(len(record) - lags, 0)
        holed = 0
        there = record.whole
        if count and not there.all():
            seen = np.cumsum(~there)
            holed = int(np.count_nonzero(seen[lags:] - np.concatenate([[0], seen[: -lags - 1]])))
        whole, lost = whole + count - holed, lost + holed
    return whole, lost


def _affordable_lags(records: Sequence[InputOutputRecord]) -> int:
    """Return the largest number of lags for which there are enough windows per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    for lags in range(LAGS_MOST, 0, -1):
        wanted = max(ROWS_PER_PARAMETER * _unknowns(m, p, lags), WINDOWS_LEAVE * total)
        if total >= wanted and _windows(records, lags)[0] >= wanted:
            return lags
    return 0
