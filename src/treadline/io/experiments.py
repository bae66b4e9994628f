"""Experiments in any form that a caller holds: arrays, data frames, files, run folders, records, or lists of these."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from treadline.core.errors import PeriodMismatch, RecordError, ShapeMismatch, closest
from treadline.core.models import InputOutputRecord
from treadline.core.state_space import record_of, samples_of
from treadline.io._clock import IRREGULAR
from treadline.io._tables import shortest_decimal
from treadline.io.records import read_record
from treadline.io.runs import INPUTS, OUTPUTS

Columns = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of the inputs and of the outputs."""


class Reading(TypedDict):
    """Sampling period [s], and further options of ``read_record``."""

    period_s: float | None
    resample: bool
    allow_gaps: bool


def experiments_of(u: Any, y: Any, how: Reading, columns: Columns | None, *, channels_first: bool) -> list[InputOutputRecord]:
    """Return one record for each experiment.

    Args:
        u: Inputs; None for outputs alone; or whole experiments: a file, a run folder, a data frame with all columns, a record, or
            a time response of python-control; a list of experiments of one kind.
        y: Outputs; None where ``u`` holds whole experiments.
        how: Period and options of files; the period may be None for records, and for files with a time column.
        columns: Columns of files, ``INPUTS`` and ``OUTPUTS`` when None, and of whole data frames; names of the channels of arrays.
        channels_first: Whether arrays have one row per channel instead of one row per sample.

    Raises:
        RecordError: If the data are incomplete, or a file holds no such data.
        ShapeMismatch: If the numbers of samples differ.
    """
    responses = u if isinstance(u, list) else [u]
    if responses and all(hasattr(item, "ntraces") for item in responses):
        u = [record for item in responses for record in _traces(item)]
    if u is None and _is_several(y):
        u = [None] * len(y)
    given, answers = (list(u), y) if _is_several(u) else ([u], [y])
    if answers is None:
        answers = [None] * len(given)
    if len(given) != len(answers):
        raise RecordError(f"u holds {len(given)} experiments and y {len(answers)}; give one y for each u")
    return [_record(a, b, how, columns, channels_first=channels_first) for a, b in zip(given, answers, strict=True)]


def _traces(response: Any) -> list[InputOutputRecord]:
    """Return a record for each trace of python-control's ``TimeResponseData``, which has one sample per column.

    Raises:
        RecordError: If the response holds no inputs.
        PeriodMismatch: If its times are uneven.
    """
    t_s = np.asarray(response.t, dtype=float)
    if response.u is None or len(t_s) < 2:
        raise RecordError("the time response holds no inputs over time; make one with control.forced_response")
    steps = np.diff(t_s)
    if not np.ptp(steps) <= IRREGULAR * steps.mean():
        raise PeriodMismatch(f"the time response has steps of {steps.min():.4g} to {steps.max():.4g} s; give even times")
    u, y = (np.reshape(item, (-1, max(response.ntraces, 1), len(t_s))).transpose(1, 2, 0) for item in (response.u, response.y))
    inputs, outputs = response.input_labels or (), response.output_labels or ()
    period_s = shortest_decimal(float(steps.mean()), 2.0 * float(np.spacing(np.abs(t_s).max())))
    return [InputOutputRecord(u=a, y=b, dt_s=period_s, input_names=inputs, output_names=outputs) for a, b in zip(u, y, strict=True)]


def _is_several(given: Any) -> bool:
    """Whether data are several experiments: a list of files, records, frames or two-dimensional arrays, or of unequal arrays."""
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        return False
    if all(item is None or isinstance(item, InputOutputRecord | str | Path) or hasattr(item, "to_numpy") for item in given):
        return True
    if not all(isinstance(item, np.ndarray) for item in given):
        return np.ndim(given[0]) >= 2
    return any(item.ndim >= 2 for item in given) or len({item.shape for item in given}) > 1


def _record(u: Any, y: Any, how: Reading, columns: Columns | None, *, channels_first: bool) -> InputOutputRecord:
    if isinstance(u, InputOutputRecord):
        return u
    if isinstance(u, str | Path):
        return read_record(Path(u), *(columns or (INPUTS, OUTPUTS)), **how)
    if y is None:
        if columns is None or not hasattr(u, "to_numpy"):
            raise RecordError("y is missing; give inputs and outputs, a data frame with inputs= and outputs=, or a file")
        u, y = (_selected(u, names) for names in columns)
    if u is None:
        samples = len(samples_of("y", y, channels_first=channels_first)[0])
        u = np.empty((0, samples) if channels_first else (samples, 0))
    if how["period_s"] is None:
        raise RecordError("dt is missing; give the sampling period in seconds: tl.identify(u, y, 0.05)")
    record = record_of(u, y, how["period_s"], channels_first=channels_first)
    if columns is None:
        return record
    for kind, names, width in zip(("inputs", "outputs"), columns, (record.u.shape[1], record.y.shape[1]), strict=True):
        if len(names) != width:
            raise ShapeMismatch(f"{kind} names {len(names)} channels, the data have {width}; name each of them")
    return replace(record, input_names=tuple(columns[0]), output_names=tuple(columns[1]))


def _selected(frame: Any, names: Sequence[str]) -> Any:
    missing = [name for name in names if name not in list(frame.columns)]
    if missing:
        meant = closest(missing[0], [str(item) for item in frame.columns])
        hint = f"columns: {', '.join(map(str, frame.columns))}" if meant is None else f"did you mean {meant}?"
        raise RecordError(f"the data frame has no column '{missing[0]}'; {hint}")
    return frame[list(names)]
