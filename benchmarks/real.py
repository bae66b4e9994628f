"""Measured data: estimate on one half, judge a free run on the other.

A peer's order and number of block rows are selected by the free run over the last 30 % of the first half, with models
identified on the first 70 %. The peer then identifies on the whole first half. Means are removed for peers and kept as offsets.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import ours
from peers import Fit, PeerError, centred
from score import fit_percent
from systems import DataSet, Model, halves

from treadline.core.linear_systems import part
from treadline.core.models import InputOutputRecord
from treadline.identification import IdentificationOptions, identify

ORDERS = range(1, 13)
BLOCK_ROWS = (10, 20, 30)
HELD_OUT = 0.3
LIKE_PEERS = {"okid-era (gram)", "pbsid"}
"""Methods of treadline that are also scored with order and lags selected as for a peer; ``best`` selects its own."""
QUICK_SAMPLES = 3_000
"""Longest estimation half of a quick run [samples]; data sets with a longer one are left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What one method made of one set."""

    method: str
    percent: float
    choice: str
    is_peer: bool
    model: Model | None = None
    notes: tuple[str, ...] = ()


def scores(data: DataSet, folder: Path, fits: dict[str, Fit]) -> Iterator[Score]:
    """Yield a score per method, treadline's first."""
    first, second = halves(data, folder)
    for name, arguments in ours.WAYS.items():
        yield _ours(name, arguments, first, second)
    for name, arguments in ours.WAYS.items():
        if name in LIKE_PEERS:
            yield _like_a_peer(name, arguments, first, second)
    for name, fit in fits.items():
        yield _chosen(name, centred(fit), first, second, is_peer=True)


def _ours(name: str, arguments: dict[str, Any], first: InputOutputRecord, second: InputOutputRecord) -> Score:
    try:
        found = identify(first, IdentificationOptions(**arguments))
    except ours.FAILURES as error:
        return Score(method=name, percent=-np.inf, choice="–", is_peer=False, notes=(str(error),))
    model = found.model
    choice = f"order {found.report.order}, lags {found.report.lags}"
    notes = tuple(found.report.warnings)
    return Score(method=name, percent=fit_percent(model, second), choice=choice, is_peer=False, model=model, notes=notes)


def _like_a_peer(name: str, arguments: dict[str, Any], first: InputOutputRecord, second: InputOutputRecord) -> Score:
    """Score a method of treadline with order and lags selected as for a peer, to separate selection from method."""

    def fit(record: InputOutputRecord, order: int, block_rows: int) -> Model:
        return identify(record, IdentificationOptions(order=order, lags=block_rows, **arguments)).model

    return _chosen(f"{name}, chosen as a peer's", fit, first, second, is_peer=False)


def _chosen(name: str, fit: Fit, first: InputOutputRecord, second: InputOutputRecord, *, is_peer: bool) -> Score:
    cut = round(len(first.u) * (1.0 - HELD_OUT))
    early, late = part(first, 0, cut), part(first, cut, len(first.u))
    trials = {(n, s): _percent(fit, early, late, n, s) for s in BLOCK_ROWS for n in ORDERS}
    order, rows = max(trials, key=lambda choice: trials[choice])
    choice = f"order {order}, block rows {rows}"
    model = _model(fit, first, order, rows)
    return Score(method=name, percent=_percent_of(model, second), choice=choice, is_peer=is_peer, model=model)


def _percent(fit: Fit, first: InputOutputRecord, second: InputOutputRecord, order: int, rows: int) -> float:
    return _percent_of(_model(fit, first, order, rows), second)


def _percent_of(model: Model | None, record: InputOutputRecord) -> float:
    percent = -np.inf if model is None else fit_percent(model, record)
    return percent if np.isfinite(percent) else -np.inf


def _model(fit: Fit, record: InputOutputRecord, order: int, rows: int) -> Model | None:
    try:
        return fit(record, order, rows)
    except (PeerError, *ours.FAILURES, ValueError):  # peers raise what their libraries raise
        return None
