"""Dead time of each input, found in the data before a model is fitted.

The evidence of a regression under a prior that decays with the lag (``_decaying_ridge``) grows once a dead time is removed: the
prior takes distant lags for small, which holds of a late plant only without its dead time, and of any other plant with it. Past
outputs in the regression make it valid in closed loop and for a start far from rest. The search begins at the first lag at which
the innovations of an input show in those of an output (prewhitening: Box and Jenkins, 1970).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import correlate
from scipy.special import chdtri

from treadline.core.errors import SettingsError
from treadline.core.linear_systems import most_recent, part
from treadline.core.models import InputOutputRecord
from treadline.identification._decaying_ridge import DECAYS, decaying_ridge
from treadline.identification._factor import solved
from treadline.identification._gram import Gram, gram_of, units_of
from treadline.identification._limits import LAGS_MOST, RECENT, ROWS_LEAST, SIGNIFICANCE

DECISIVE = 5.0
"""Difference of the logarithm of the evidence that is very strong (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995)."""
RANGE_SHARE = 4
"""Samples of the shortest record per sample of dead time: three quarters of each record remain to be explained."""
RANGE_MOST = 256
"""Largest dead time searched: the search leaves as many samples out."""
LAGS = 16
"""Lags of the regressions of the search; 8 find the dead time of order 6 a sample late."""

Delays = tuple[int, ...]


def dead_time(records: Sequence[InputOutputRecord]) -> list[int]:
    """Return the dead time of each input in samples; 0 where the data do not decide for one.

    The range of the search is a quarter of the shortest record, at most ``RANGE_MOST``; records shorter than a quarter of the
    longest are left out.
    """
    recent = most_recent(records, RECENT)
    longest = max(len(record) for record in recent)
    recent = [record for record in recent if RANGE_SHARE * len(record) >= longest]
    found = np.zeros(records[0].u.shape[1], dtype=int)
    units = units_of(recent)
    moves = np.flatnonzero(units.input_scale > 1e-12 * np.abs(units.shift[: len(found)]))
    shortest, channels = min(len(record) for record in recent), moves.size + len(units.output_scale)
    reach = min(shortest // RANGE_SHARE, RANGE_MOST)
    most = min(LAGS_MOST, (shortest - reach) // (ROWS_LEAST * 2 * channels))
    if moves.size and reach and most:
        moving = [replace(record, u=record.u[:, moves], input_names=()) for record in recent]
        first = _first_seen(moving, reach, min(LAGS, most))
        found[moves] = _searched(moving, first, reach, most) if any(first) else 0
    return [int(delay) for delay in found]


def without_delays(records: Sequence[InputOutputRecord], shifts: Sequence[int]) -> list[InputOutputRecord]:
    """Return the records with each input delayed by its dead time.

    Raises:
        SettingsError: If there is not one shift per input, or a shift is negative or as long as a record.
    """
    m, most = records[0].u.shape[1], max(shifts, default=0)
    whole = all(isinstance(shift, int | np.integer) for shift in shifts)
    if not whole or len(shifts) != m or min(shifts) < 0 or most >= min(len(record) for record in records):
        raise SettingsError(f"delays are {list(shifts)}; give one integer per input ({m}), from 0 to less than a record's length")
    return [part(record.delayed(shifts), most, len(record)) for record in records]


def _first_seen(records: Sequence[InputOutputRecord], reach: int, lags: int) -> list[int]:
    """Return for each input the samples after which its innovations first show in those of an output; 0 where they do not."""
    data, m = gram_of(records, lags, units_of(records)), records[0].u.shape[1]
    if data.count <= len(data.sums):
        return [0] * m
    errors = _innovations(records, data)
    size = np.sum([np.sum(e**2, axis=0) for e in errors], axis=0)
    statistic, p = np.zeros((m, reach + 1)), len(size) - m
    for j, i in np.ndindex(m, p):
        cross = [correlate(e[:, m + i], e[:, j], method="fft")[len(e) - 1 : len(e) + reach] for e in errors]
        statistic[j] += data.count * np.sum(cross, axis=0) ** 2 / max(size[j] * size[m + i], 1e-300)
    seen = statistic[:, 1:] > chdtri(p, SIGNIFICANCE / reach)
    return [int(np.argmax(row)) for row in seen]


def _innovations(records: Sequence[InputOutputRecord], data: Gram) -> list[Float[np.ndarray, "T r"]]:
    """Return what is new in each channel: in an output next to its own past, in an input next to all past and the outputs."""
    m, r = data.units.input_count, len(data.units.scale)
    theta = np.zeros((len(data.sums), r))
    for k in range(r):
        known = [0, *(range(1 + m, len(data.sums)) if k < m else range(1 + r + k, len(data.sums), r))]
        theta[known, k] = solved(data.sums[np.ix_(known, known)], data.sums[known, 1 + k][:, None])[:, 0]
    errors = []
    for record in records:
        z = (np.hstack([record.u, record.y]) - data.units.shift) / data.units.scale
        windows = sliding_window_view(z, data.lags + 1, axis=0)[:, :, ::-1].transpose(0, 2, 1).reshape(len(z) - data.lags, -1)
        new = windows[:, :r] - theta[0] - windows @ theta[1:]
        errors.append(np.where(np.isfinite(new).all(axis=1)[:, None], new, 0.0))
    return errors


def _searched(records: Sequence[InputOutputRecord], first: Sequence[int], reach: int, most: int) -> Delays:
    """Return the dead times of largest evidence near the first ones: one for all inputs, or its own where that is better."""
    m, price = len(first), DECISIVE + math.log(reach)
    none = (0,) * m

    @cache
    def evidence(delays: Delays, lags: int = min(LAGS, most)) -> float:
        if min(delays) < 0 or max(delays) > reach:
            return -math.inf
        # All dead times explain the same samples.
        cut = [part(record.delayed(delays), reach, len(record)) for record in records]
        data = gram_of(cut, lags, units_of(cut))
        return max(decaying_ridge(data, decay, feedthrough=False)[1] for decay in DECAYS) if data.count > 1.0 else -math.inf

    def climbed(delays: Delays, moving: Sequence[int]) -> Delays:
        for step in (8, 4, 2, 1):
            while True:
                near = [tuple(d + sign * step * (j in moving) for j, d in enumerate(delays)) for sign in (-1, 1)]
                if evidence(best := max(near, key=evidence)) <= evidence(delays):
                    break
                delays = best
        return delays

    found = max((climbed((start,) * m, range(m)) for start in set(first)), key=evidence)
    found = found if evidence(found) - evidence(none) > price else none
    for j in range(m if m > 1 else 0):
        starts = [(*found[:j], start, *found[j + 1 :]) for start in {first[j], 0}]
        own = max((climbed(start, [j]) for start in starts), key=evidence)
        # The first to differ is chosen among many; after it a better dead time needs no more evidence.
        if evidence(own) - evidence(found) > (price if len(set(found)) == 1 else 0.0):
            found = own
    # Few lags do not hold the memory of a plant of high order, of which a dead time leaves more inside.
    return found if found != none and evidence(found, most) > evidence(none, most) else none
