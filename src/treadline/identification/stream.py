"""Identification of more data than the memory holds: the sums of all of it, and its last samples to judge by."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification.affine import to_model
from treadline.identification.checks import channel_names, check_alike, check_gaps, check_records, check_whole, gaps_in
from treadline.identification.from_sums import from_sums, made_by
from treadline.identification.gram import Gram, GramBuilder, Units
from treadline.identification.identified import Identified
from treadline.identification.identify import SOLVERS
from treadline.identification.threads import one_thread
from treadline.identification.validate import joined_in_time, most_recent
from treadline.identification.windows import LAGS_MOST, carried_lags
from treadline.models import InputOutputRecord

METHODS = ("pbsid", "okid-era", "era-dc")
"""What the sums alone give; refinements need all samples."""
KEPT = 20_000
"""Last samples, by which the model is judged."""
HALF_LEAST = 0.1
"""Share of the windows below which a part of the data does not count as a half."""


@one_thread()
def identify_chunks(
    *experiments: Iterable[InputOutputRecord],
    order: int | None = None,
    lags: int | None = None,
    method: str = "pbsid",
    feedthrough: bool | None = None,
    solver: str = "gram",
) -> Identified:
    """Return the linear model of long experiments that come in chunks, in bounded memory.

    Args:
        experiments: Of each its consecutive chunks; the first of all in which every channel moves decide the units of the sums, and
            how many lags are tried.
        order: Number of states; the largest gap of the singular values decides when left out, with ``pbsid`` Schwarz's
            criterion where that leaves doubt.
        lags: Observer lags; when left out Schwarz's criterion decides, with ``okid-era`` and ``era-dc`` Akaike's.
        method: ``pbsid``, ``okid-era`` or ``era-dc``.
        feedthrough: Whether an input may act within its own sample.
        solver: ``gram`` or ``qr``.

    Raises:
        RecordError: If a chunk cannot be used, or the data cannot carry what is asked.
        SettingsError: If an option is unknown or out of range.
    """
    started = time.perf_counter()
    for name, value, allowed in (("method", method, METHODS), ("solver", solver, SOLVERS)):
        if value not in allowed:
            raise SettingsError(f"{name} is '{value}'; for chunks allowed: {', '.join(allowed)}")
    check_whole(order=order, lags=lags)
    rest = _chunks(experiments)
    start = _start(rest, lags, order)
    data, half, last = _summed(start, rest, solver)
    kept = sum(len(record) for record in last)
    warnings = [f"figures are on the last {kept} samples"] if data.count > kept else []
    if start.left_out:
        warnings.append(
            f"the first {start.left_out} samples, in which a channel stands still or too much is missing, were left out"
        )
    found = from_sums(
        data, half, last, order=order, lags=lags, method=method, feedthrough=feedthrough, warnings=warnings, again=False
    )
    names = channel_names(start.chunks[0].record)
    return Identified(
        model=to_model(found.system, found.units, data.dt_s, names, made_by(method, found.recipe)),
        found=found,
        method=method,
        fitted=last,
        judged=last,
        shifts=[0] * start.chunks[0].record.u.shape[1],
        started=started,
        gram=data,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Chunk:
    record: InputOutputRecord
    begins: bool
    """Whether it is the first of its experiment."""
    goes_on: bool = False
    """Whether the sample before it is of the same experiment and whole: what looks back across a gap tells nothing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Start:
    """The first samples, as many as tell the units and carry all lags that are tried."""

    chunks: list[_Chunk]
    units: Units
    lags: int
    left_out: int
    """Samples before them."""


def _chunks(experiments: Iterable[Iterable[InputOutputRecord]]) -> Iterator[_Chunk]:
    """Yield all chunks if they are alike; at the end of an experiment that is mostly holes, refuse it."""
    first: InputOutputRecord | None = None
    for experiment in experiments:
        samples = gaps = 0
        is_whole = False
        for number, record in enumerate(experiment):
            first = first or record
            check_alike([first, record], parts=True)
            samples, gaps = samples + len(record), gaps + gaps_in(record)
            yield _Chunk(record=record, begins=number == 0, goes_on=is_whole)
            is_whole = bool(np.isfinite(record.u[-1]).all() and np.isfinite(record.y[-1]).all())
        check_gaps(gaps, samples)


def _start(chunks: Iterator[_Chunk], lags: int | None, order: int | None) -> _Start:
    """Return the first chunks, as many as it takes until every channel moves and as many lags are carried as are tried.

    A robot waits to be sent: what it does meanwhile is kept as far as the memory goes.
    """
    waiting: list[_Chunk] = []
    refused = PoorExcitation("there is no chunk of data; give a longer record")
    found: _Start | None = None
    left_out = 0
    for chunk in chunks:
        waiting = [*waiting, chunk]
        records = _joined(waiting)
        try:
            carried, units = carried_lags(records, lags, order), check_records(records, parts=True)
            found = _Start(chunks=waiting, units=units, lags=carried, left_out=left_out)
        except PoorExcitation as error:
            refused = error
        samples = sum(len(item.record) for item in waiting)
        if found is not None and (lags is not None or found.lags == LAGS_MOST or samples >= KEPT):
            break
        while samples - len(waiting[0].record) >= KEPT:
            left_out, samples = left_out + len(waiting[0].record), samples - len(waiting[0].record)
            waiting = waiting[1:]
    if found is None:
        raise refused
    return replace(found, chunks=waiting)  # gaps may have let the last of them carry less: they are data all the same


def _joined(chunks: Sequence[_Chunk]) -> list[InputOutputRecord]:
    """Return chunks as parts of experiments."""
    parts: list[list[_Chunk]] = []
    for chunk in chunks:
        if chunk.goes_on and parts:
            parts[-1].append(chunk)
        else:
            parts.append([chunk])
    return [joined_in_time([chunk.record for chunk in together]) for together in parts]


def _with(records: list[InputOutputRecord], chunk: _Chunk) -> list[InputOutputRecord]:
    """Return the parts of experiments with one more chunk."""
    if chunk.goes_on and records:
        return [*records[:-1], joined_in_time([records[-1], chunk.record])]
    return [*records, chunk.record]


def _summed(start: _Start, rest: Iterator[_Chunk], solver: str) -> tuple[Gram, Gram | None, list[InputOutputRecord]]:
    """Return the sums of all chunks, those of about the first half, and the last samples."""
    first, last = start.chunks[0].record, most_recent(_joined(start.chunks), KEPT)
    builder = GramBuilder(start.lags, start.units, first.dt_s, solver=solver)
    marks: list[Gram] = []
    for chunk in start.chunks:
        _add(builder, chunk, marks)
    for chunk in rest:
        _add(builder, chunk, marks)
        last = most_recent(_with(last, chunk), KEPT)
    whole = replace(builder.finish(), names=channel_names(first))
    return whole, _half(whole, marks), last


def _add(builder: GramBuilder, chunk: _Chunk, marks: list[Gram]) -> None:
    """Add a chunk, and note the sums where they have doubled: some mark is near the half of whatever comes."""
    if chunk.begins:
        builder.begin()
    middle = len(chunk.record) // 2
    for rows in (slice(0, middle), slice(middle, None)):
        builder.add(chunk.record.u[rows], chunk.record.y[rows])
        now = builder.finish()
        if now.count > 0 and (not marks or now.count >= 2 * marks[-1].count):
            marks.append(now)


def _half(whole: Gram, marks: list[Gram]) -> Gram | None:
    """Return the sums at the mark that is nearest to the middle; None where before or after it is next to nothing."""
    first = min(marks, key=lambda mark: abs(mark.count - 0.5 * whole.count), default=None)
    if first is None or min(first.count, whole.count - first.count) < HALF_LEAST * whole.count:
        return None
    return first
