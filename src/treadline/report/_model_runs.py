"""Data of the figures of a linear model: measured responses, length of responses, residuals.

Models may be unstable: an overflow gives infinity, never an error.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float

from treadline.core.arrays import NORMAL_95
from treadline.core.linear_systems import part
from treadline.core.state_space import InputOutputRecord
from treadline.core.transfer_function import STEPS_LEAST

SEGMENTS = 8
"""Parts of a record for spectra: 15 windows with half overlap, whose mean halves the noise of a magnitude three times over."""
SEGMENT_LEAST = 16
"""Smallest part of a record for spectra [samples]: eight frequencies."""
SEGMENT_MOST = 4096
"""Largest part of a record for spectra [samples]: 2048 frequencies, as many as a figure has columns of points."""
ANSWERED = 0.05
"""Share of its peak below which an output is drawn as zero response."""


def answering(response: Float[np.ndarray, "steps m"]) -> int:
    """Return how many steps of one output's responses show it answer: half as many again as until little is left."""
    size = np.abs(response)
    lasts = int(np.flatnonzero((size > ANSWERED * size.max(axis=0)).any(axis=1)).max(initial=0))
    return min(len(response), max(STEPS_LEAST, lasts + lasts // 2))


def measured_response(
    records: Sequence[InputOutputRecord],
) -> tuple[Float[np.ndarray, " w"], Complex[np.ndarray, "w p m"]] | None:
    """Return frequencies [rad per sample] and the response estimated from spectra alone, ``G = S_yu S_uu^-1`` (Welch, H1).

    Each record gives its longest stretch without gaps, cut into ``SEGMENTS`` parts or more and as many overlapping ones.
    Frequencies at which the inputs explain less than half of the power of every output are left out. None for short records.
    """
    spans = [_longest_whole(record) for record in records]
    length = min(max(len(span) for span in spans) // SEGMENTS, SEGMENT_MOST)
    kept = [span for span in spans if len(span) >= 2 * length]
    if length < SEGMENT_LEAST:
        return None
    spectra, m = np.sum([_spectra(span, length) for span in kept], axis=0), records[0].u.shape[1]
    suu, syu, syy = spectra[:, :m, :m], spectra[:, m:, :m], np.einsum("wpp->wp", spectra[:, m:, m:]).real
    omega = 2.0 * math.pi * np.fft.rfftfreq(length)
    with np.errstate(divide="ignore", invalid="ignore"):
        G = syu @ np.linalg.pinv(suu, rcond=1e-6, hermitian=True)
        explained = np.einsum("wpm,wpm->wp", G, syu.conj()).real / syy
    good = (omega > 0.0) & (np.nan_to_num(explained) > 0.5).any(axis=1)
    return omega[good], G[good]


def _longest_whole(record: InputOutputRecord) -> InputOutputRecord:
    edges = np.flatnonzero(np.diff(record.whole.astype(int), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return part(record, 0, 0)
    start, stop = edges[np.argmax(edges[:, 1] - edges[:, 0])].tolist()
    return part(record, start, stop)


def _spectra(record: InputOutputRecord, length: int) -> Complex[np.ndarray, "w c c"]:
    """Return the cross spectra of inputs and outputs, summed over half overlapping Hann windows without their means."""
    from scipy.signal import csd  # half a second to import

    z, overlap = np.hstack([record.u, record.y]).T, length - length // 2
    window: Any = np.hanning(length)  # the stubs know windows by name alone
    step, total = length - overlap, np.zeros((len(z), len(z), length // 2 + 1), dtype=complex)
    windows = (len(record) - overlap) // step
    for first in range(0, windows, SEGMENTS):  # all at once take ten times the memory of the record
        count = min(SEGMENTS, windows - first)
        part_of = z[:, first * step : (first + count) * step + overlap]
        total += count * csd(part_of[None], part_of[:, None], window=window, nperseg=length, noverlap=overlap)[1]
    return np.moveaxis(total, -1, 0)


def correlation(a: Float[np.ndarray, " T"], b: Float[np.ndarray, " T"], lags: int) -> Float[np.ndarray, " k"]:
    """Return the correlation of ``a[t]`` with ``b[t - lag]`` for lags ``-lags … lags``; missing samples count as mean."""
    from scipy.signal import correlate

    first, second = _centred(a), _centred(b)
    size = math.sqrt(float(first @ first) * float(second @ second))
    middle = len(first) - 1
    return correlate(first, second)[middle - lags : middle + lags + 1] / (size or 1.0)


def _centred(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    there = np.isfinite(values)
    # A run that blew up must not overflow in its squares; a correlation does not know the size.
    largest = float(np.abs(values[there]).max(initial=0.0))
    if largest == 0.0:
        return np.zeros(len(values))
    scaled = values / largest
    return np.where(there, scaled - scaled[there].mean(), 0.0)


def correlation_band(a: Float[np.ndarray, " k"], b: Float[np.ndarray, " k"], count: int) -> float:
    """Return the half width that the correlation of two independent series keeps within 19 times of 20.

    Bartlett's formula: the variance is ``Σ r_a(k) r_b(k) / N``; at least that of white series.

    Args:
        a: Autocorrelation of one series at lags ``-k … k``; likewise b.
        count: Samples N.
    """
    return NORMAL_95 * math.sqrt(max(float(a @ b), 1.0) / max(count, 1))


def typical_span(error: Float[np.ndarray, "T p"], span: int) -> slice:
    """Return the stretch of ``span`` samples whose error is the median of all stretches: neither the best nor the worst."""
    count = len(error) // span
    if count < 2:
        return slice(0, len(error))
    blocks = np.nan_to_num(np.abs(error[: count * span]), nan=0.0, posinf=1e150).clip(max=1e150).reshape(count, -1)
    order = np.argsort(np.mean(blocks, axis=1), kind="stable")
    start = int(order[(count - 1) // 2]) * span
    return slice(start, start + span)


def cut(
    values: Float[np.ndarray, "T p"], measured: Float[np.ndarray, "T p"]
) -> tuple[Float[np.ndarray, "T p"], Bool[np.ndarray, " p"]]:
    """Return a run without what lies beyond three spans of the measured outputs around their middle, and which left it."""
    low, high = np.fmin.reduce(measured, axis=0), np.fmax.reduce(measured, axis=0)
    middle, reach = 0.5 * (low + high), 3.0 * np.maximum(high - low, 1e-12)
    away = ~(np.abs(values - middle) <= reach) & np.isfinite(middle)
    # A run that overflows is infinite before it is no number; where it is none from the start, it was not judged.
    return np.where(away, np.nan, values), (away & ~np.isnan(values)).any(axis=0)
