"""Identification of more data than the memory holds: the sums of all of it, and its last samples to judge by."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification.affine import to_model
from treadline.identification.checks import channel_names, check_alike, check_gaps, check_records, check_whole, gaps_in
from treadline.identification.from_sums import from_sums, made_by
from treadline.identification.gram import Gram, GramBuilder, Units
from treadline.identification.identified import Identified
from treadline.identification.identify import SOLVERS
from treadline.identification.threads import one_thread
from treadline.identification.validate import joined_in_time, most_recent, part
from treadline.identification.windows import carried_lags
from treadline.models import InputOutputRecord

METHODS = ("pbsid", "okid-era", "era-dc")
"""What the sums alone give; refinements need all samples."""
KEPT = 20_000
"""Last samples, by which the model is judged."""


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
        experiments: Of each its consecutive chunks; the first in which every channel moves decides the units of the sums, and how
            many lags are tried.
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
    data, halves, last = _summed(start, rest, solver)
    kept = sum(len(record) for record in last)
    warnings = [f"figures are on the last {kept} samples"] if data.count > kept else []
    if start.left_out:
        warnings.append(f"the first {start.left_out} samples, in which a channel stands still, were left out")
    found = from_sums(
        data, halves, last, order=order, lags=lags, method=method, feedthrough=feedthrough, warnings=warnings, again=False
    )
    names = channel_names(start.record)
    return Identified(
        model=to_model(found.system, found.units, data.dt_s, names, made_by(method, found.recipe)),
        found=found,
        method=method,
        fitted=last,
        judged=last,
        shifts=[0] * start.record.u.shape[1],
        started=started,
        gram=data,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Chunk:
    record: InputOutputRecord
    begins: bool
    """Whether it is the first of its experiment."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Start:
    """The first samples in which every channel moves, and what they tell."""

    record: InputOutputRecord
    units: Units
    lags: int
    left_out: int
    """Samples before them."""
    gaps: int
    """Samples among all of those in which a channel is missing."""


def _chunks(experiments: Iterable[Iterable[InputOutputRecord]]) -> Iterator[_Chunk]:
    for experiment in experiments:
        for number, record in enumerate(experiment):
            yield _Chunk(record=record, begins=number == 0)


def _start(chunks: Iterator[_Chunk], lags: int | None, order: int | None) -> _Start:
    """Return the first chunks, as many as it takes until every channel moves and the lags are carried.

    A robot waits to be sent: what it does meanwhile is kept as far as the memory goes.
    """
    waiting: InputOutputRecord | None = None
    refused = PoorExcitation("there is no chunk of data; give a longer record")
    left_out = gaps = 0
    for chunk in chunks:
        if chunk.begins and waiting is not None:
            left_out, waiting = left_out + len(waiting), None
        waiting = chunk.record if waiting is None else joined_in_time(waiting, chunk.record)
        gaps += gaps_in(chunk.record)
        try:
            units = check_records([waiting], parts=True)
            return _Start(record=waiting, units=units, lags=carried_lags([waiting], lags, order), left_out=left_out, gaps=gaps)
        except PoorExcitation as error:
            refused = error
            too_many = max(0, len(waiting) - KEPT)
            waiting, left_out = part(waiting, too_many, len(waiting)), left_out + too_many
    raise refused


def _summed(start: _Start, rest: Iterator[_Chunk], solver: str) -> tuple[Gram, tuple[Gram, Gram] | None, list[InputOutputRecord]]:
    """Return the sums of all chunks, those of two parts of about a half, and the last samples."""
    last, count = [start.record], 1
    samples, gaps = start.left_out + len(start.record), start.gaps
    builder = GramBuilder(start.lags, start.units, start.record.dt_s, solver=solver)
    builder.add(start.record.u, start.record.y)
    marks = {1: builder.finish()}
    for count, chunk in enumerate(rest, start=2):
        record = chunk.record
        check_alike([start.record, record], parts=True)
        samples, gaps = samples + len(record), gaps + gaps_in(record)
        if chunk.begins:
            builder.begin()
        builder.add(record.u, record.y)
        last = most_recent([*last, record] if chunk.begins else [*last[:-1], joined_in_time(last[-1], record)], KEPT)
        if count & (count - 1) == 0:  # after 1, 2, 4, 8 … chunks: one of them is near the half
            marks[count] = builder.finish()
    check_gaps(gaps, samples)
    whole = replace(builder.finish(), names=channel_names(start.record))
    first = marks[max(mark for mark in marks if 2 * mark <= max(count, 2))]
    halves = (first, whole - first) if count > 1 else None
    return whole, halves, most_recent(last, KEPT)
