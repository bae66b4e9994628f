"""Measured data: estimate on one half, judge a free run on the other.

A peer's order and number of block rows are selected by the free run over the last 30 % of the estimating half, with models
identified on its first 70 %; the peer then identifies on the whole half. Means are removed for peers and kept as offsets. A search
ends after its CPU time, the smallest orders and fewest block rows first. Nothing is selected for a set.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ours
from peers import Fit, PeerError, centred
from score import fit_percent
from systems import Model

from treadline.core.linear_systems import part
from treadline.core.models import InputOutputRecord
from treadline.identification import IdentificationOptions, identify

ORDERS = range(1, 31)
BLOCK_ROWS = (10, 20, 32)
HELD_OUT = 0.3
CLOSE_POINTS = 2.0
"""Difference of two fits that does not count [percentage points]: the criterion of the project's aims."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What one method made of one cut of a set."""

    method: str
    percent: float
    choice: str
    cpu_s: float
    notes: tuple[str, ...] = ()


def scores(first: InputOutputRecord, second: InputOutputRecord, fits: dict[str, Fit], search_s: float) -> Iterator[Score]:
    """Yield a score per method, treadline's first."""
    for name, arguments in ours.WAYS.items():
        yield _timed(name, partial(_ours, first, arguments), second)
    for name, fit in fits.items():
        yield _timed(name, partial(_chosen, centred(fit), first, search_s), second)


def _ours(first: InputOutputRecord, arguments: dict[str, Any]) -> tuple[Model, str, list[str]]:
    found = identify(first, IdentificationOptions(**arguments))
    return found.model, f"order {found.report.order}, lags {found.report.lags}", found.report.warnings


def _timed(name: str, fit: Callable[[], tuple[Model, str, Sequence[str]]], second: InputOutputRecord) -> Score:
    started = time.process_time()
    try:
        model, choice, notes = fit()
    except FAILURES as error:
        return Score(method=name, percent=-np.inf, choice=str(error), cpu_s=time.process_time() - started)
    cpu_s = time.process_time() - started
    return Score(method=name, percent=fit_percent(model, second), choice=choice, cpu_s=cpu_s, notes=tuple(notes))


def _chosen(fit: Fit, first: InputOutputRecord, search_s: float) -> tuple[Model, str, list[str]]:
    cut = round(len(first) * (1.0 - HELD_OUT))
    early, late = part(first, 0, cut), part(first, cut, len(first))
    tried: dict[tuple[int, int], float] = {}
    ends_s = time.process_time() + search_s
    for rows, order in ((rows, order) for rows in BLOCK_ROWS for order in ORDERS):
        if time.process_time() > ends_s:
            break
        try:
            tried[order, rows] = fit_percent(fit(early, order, rows), late)
        except FAILURES:
            continue
    if not tried:
        raise PeerError("no order suits")
    order, rows = max(tried, key=lambda choice: tried[choice])
    return fit(first, order, rows), f"order {order}, block rows {rows}, {len(tried)} tried", []


FAILURES = (PeerError, *ours.FAILURES, ValueError, FloatingPointError)
"""What peers and their libraries raise."""
