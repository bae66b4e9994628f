"""Number of lags that the data support."""

from collections.abc import Sequence

import numpy as np

from treadline.core.errors import TooFewSamples
from treadline.core.models import InputOutputRecord

LAGS_MOST = 40
"""Largest number of lags tried by default."""
WINDOWS_LEAVE = 0.4
"""Smallest share of the samples that must remain as windows without gaps."""
ROWS_PER_PARAMETER = 8
"""Windows per coefficient of one output for automatically chosen lags."""
ROWS_LEAST = 2
"""Windows per coefficient that must be exceeded for a given number of lags."""


def max_supported_lags(records: Sequence[InputOutputRecord], lags: int | None, order: int | None) -> int:
    """Return the given number of lags, or the largest number that the data support.

    Raises:
        TooFewSamples: If the data are too short for the lags or the order.
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
    """Return the number of samples without gaps needed; the first ``lags`` samples of each record are not targets."""
    needed = max(lags or 0, -(-(order or 1) // outputs), 1)
    unknowns = _unknowns(inputs, outputs, needed)
    return (ROWS_PER_PARAMETER * unknowns if lags is None else ROWS_LEAST * unknowns + 1) + needed * records


def _unknowns(m: int, p: int, lags: int) -> int:
    """Return the number of coefficients of one output: a constant, the current inputs, and inputs and outputs of each lag."""
    return 1 + m + lags * (m + p)


def _windows(records: Sequence[InputOutputRecord], lags: int) -> tuple[int, int]:
    """Return the number of complete windows and the number lost to gaps."""
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
    """Return the largest number of lags with enough windows per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    for lags in range(LAGS_MOST, 0, -1):
        wanted = max(ROWS_PER_PARAMETER * _unknowns(m, p, lags), WINDOWS_LEAVE * total)
        if total >= wanted and _windows(records, lags)[0] >= wanted:
            return lags
    return 0
