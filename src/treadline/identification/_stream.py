"""Identification of data larger than memory: a Gram matrix of all samples, and the last samples for validation."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import reduce
from itertools import chain

import numpy as np

from treadline.core.errors import PoorExcitation, SettingsError
from treadline.core.linear_systems import most_recent
from treadline.core.models import InputOutputRecord
from treadline.identification._checks import channel_names, check_alike, check_gaps, units_of_moving, whole_samples
from treadline.identification._drive_log import DriveLog
from treadline.identification._from_gram import from_gram
from treadline.identification._gram import GramBuilder, Units
from treadline.identification._identified import Identified
from treadline.identification._limits import LAGS_MOST, RECENT
from treadline.identification._threads import one_thread
from treadline.identification.options import DEFAULT_OPTIONS, IdentificationOptions, max_supported_lags

METHODS = ("pbsid", "okid-era")
"""Methods that need only the Gram matrix; refinements need all samples."""
WHOLE_RECORD_OPTIONS = ("delays", "stable", "validation", "prior", "forgetting")
"""Options that need all samples at once, so that chunks reject them."""


@one_thread()
def identify_chunks(
    *experiments: Iterable[InputOutputRecord],
    options: IdentificationOptions = DEFAULT_OPTIONS,
) -> Identified:
    """Return the linear model of long experiments read in chunks, in bounded memory.

    Args:
        experiments: Consecutive chunks of each experiment. The first chunks in which every channel moves determine the
            units and the largest number of lags.
        options: Order, lags, feedthrough, solver, and one of the methods in ``METHODS``, by default ``pbsid``.

    Raises:
        RecordError: If a chunk is unusable, or the data do not support the request.
        SettingsError: If an option is unknown or out of range.
    """
    started = time.perf_counter()
    method = options.method or "pbsid"
    _check_options(options, method)
    rest = _chunks(experiments)
    chunks, units, lags, left_out = _start(rest, options.lags, options.largest_order)
    names, builder = channel_names(chunks[0].record), GramBuilder(lags, units, chunks[0].record.dt_s, solver=options.solver)
    last: list[InputOutputRecord] = []
    for chunk in chain(chunks, rest):
        if chunk.begins:
            builder.begin()
        builder.add(chunk.record.u, chunk.record.y)
        last = most_recent(_with(last, chunk), RECENT)
    data, kept = replace(builder.finish(), names=names), sum(len(record) for record in last)
    warnings = [f"figures are on the last {kept} samples"] if data.count > kept else []
    if left_out:
        warnings.append(f"the first {left_out} samples, with a constant channel or too many gaps, were left out")
    found = from_gram(data, last, options, method=method, warnings=warnings, records_are_complete=False)
    return Identified(
        free=found.model(method, name_prior=options.name_prior),
        found=found,
        method=method,
        fitted=last,
        judged=last,
        seconds=time.perf_counter() - started,
        gram=data,
        log=DriveLog(records=last),
        name_prior=options.name_prior,
    )


def _check_options(options: IdentificationOptions, method: str) -> None:
    """Reject options that need all samples at once."""
    if method not in METHODS:
        raise SettingsError(f"method is '{method}'; for chunks allowed: {', '.join(METHODS)}")
    for item in fields(options):
        if item.name in WHOLE_RECORD_OPTIONS and getattr(options, item.name) != item.default:
            raise SettingsError(f"{item.name} needs the whole record; give it to identify")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Chunk:
    record: InputOutputRecord
    begins: bool
    """Whether the chunk is the first of its experiment."""
    goes_on: bool = False
    """Whether the previous sample is complete and of the same experiment, so that windows may extend into it."""


def _chunks(experiments: Iterable[Iterable[InputOutputRecord]]) -> Iterator[_Chunk]:
    """Yield all chunks after a check that they are alike; reject an experiment with too many gaps at its end."""
    first: InputOutputRecord | None = None
    for experiment in experiments:
        samples = gaps = 0
        is_complete = False
        for number, record in enumerate(experiment):
            first = first or record
            check_alike([first, record], parts=True)
            samples, gaps = samples + len(record), gaps + len(record) - whole_samples(record)
            yield _Chunk(record=record, begins=number == 0, goes_on=is_complete)
            is_complete = bool(np.isfinite(record.u[-1]).all() and np.isfinite(record.y[-1]).all())
        check_gaps(gaps, samples)


def _start(chunks: Iterator[_Chunk], lags: int | None, order: int | None) -> tuple[list[_Chunk], Units, int, int]:
    """Return initial chunks in which every channel moves and most lags are supported, units, lags, and the samples left out before.

    A robot may stand still at first; such samples are kept as far as the memory limit allows.
    """
    waiting: list[_Chunk] = []
    rejection = PoorExcitation("there is no chunk of data; give a longer record")
    found: tuple[Units, int] | None = None
    left_out = 0
    for chunk in chunks:
        waiting = [*waiting, chunk]
        records = reduce(_with, waiting, list[InputOutputRecord]())
        try:
            supported = max_supported_lags(records, lags, order)
            found = units_of_moving(records), supported
        except PoorExcitation as error:
            rejection = error
        samples = sum(len(item.record) for item in waiting)
        if found is not None and (lags is not None or found[1] == LAGS_MOST or samples >= RECENT):
            break
        while samples - len(waiting[0].record) >= RECENT:
            left_out, samples = left_out + len(waiting[0].record), samples - len(waiting[0].record)
            waiting = waiting[1:]
    if found is None:
        raise rejection
    return waiting, *found, left_out  # later chunks with gaps may support fewer lags but still contribute data


def _with(records: list[InputOutputRecord], chunk: _Chunk) -> list[InputOutputRecord]:
    """Return the parts of experiments extended by one chunk."""
    if chunk.goes_on and records:
        last, new = records[-1], chunk.record
        return [*records[:-1], replace(last, u=np.vstack([last.u, new.u]), y=np.vstack([last.y, new.y]))]
    return [*records, chunk.record]
