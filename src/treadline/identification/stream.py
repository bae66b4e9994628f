"""Identification of more data than the memory holds: the sums of all of it, and its last samples to judge by."""

import time
from collections.abc import Iterable
from dataclasses import replace

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification.affine import to_model
from treadline.identification.checks import channel_names, check_records
from treadline.identification.gram import Gram, GramBuilder
from treadline.identification.identified import Identified
from treadline.identification.identify import SOLVERS, from_sums, made_by
from treadline.identification.threads import one_thread
from treadline.identification.validate import joined_in_time, part
from treadline.identification.windows import carried_lags
from treadline.models import InputOutputRecord

METHODS = ("pbsid", "okid-era", "era-dc")
"""What the sums alone give; refinements need all samples."""
KEPT = 20_000
"""Last samples, by which the model is judged."""


@one_thread()
def identify_chunks(
    chunks: Iterable[InputOutputRecord],
    *,
    order: int | None = None,
    lags: int | None = None,
    method: str = "pbsid",
    feedthrough: bool | None = None,
    solver: str = "gram",
) -> Identified:
    """Return the linear model of one long experiment that comes in chunks, in bounded memory.

    Args:
        chunks: Consecutive parts of one experiment; the first decides the units of the sums, and how many lags are tried.
        order: Number of states; the largest gap of the singular values decides when left out.
        lags: Observer lags; Schwarz's criterion decides when left out.
        method: ``pbsid``, ``okid-era`` or ``era-dc``.
        feedthrough: Whether an input may act within its own sample.
        solver: ``gram`` or ``qr``.

    Raises:
        RecordError: If a chunk cannot be used, or the data cannot carry what is asked.
        SettingsError: If an option is unknown.
    """
    started = time.perf_counter()
    for name, value, allowed in (("method", method, METHODS), ("solver", solver, SOLVERS)):
        if value not in allowed:
            raise SettingsError(f"{name} is '{value}'; for chunks allowed: {', '.join(allowed)}")
    data, halves, last = _summed(chunks, lags, order, solver)
    warnings = [f"figures are on the last {len(last)} samples"] if data.count > len(last) else []
    found = from_sums(
        data, halves, [last], order=order, lags=lags, method=method, feedthrough=feedthrough, warnings=warnings, again=False
    )
    return Identified(
        model=to_model(found.system, found.units, data.dt_s, channel_names(last), made_by(method, found.recipe)),
        found=found,
        method=method,
        fitted=[last],
        judged=[last],
        shifts=[0] * last.u.shape[1],
        started=started,
    )


def _summed(
    chunks: Iterable[InputOutputRecord], lags: int | None, order: int | None, solver: str
) -> tuple[Gram, tuple[Gram, Gram] | None, InputOutputRecord]:
    """Return the sums of all chunks, those of two parts of about a half, and the last samples."""
    builder: GramBuilder | None = None
    last: InputOutputRecord | None = None
    marks: dict[int, Gram] = {}
    count = 0
    for count, chunk in enumerate(chunks, start=1):
        if builder is None or last is None:
            units = check_records([chunk])
            builder = GramBuilder(carried_lags([chunk], lags, order), units, chunk.dt_s, solver=solver)
            last = chunk
        else:
            last = joined_in_time(last, chunk)
        builder.add(chunk.u, chunk.y)
        last = part(last, max(0, len(last) - KEPT), len(last))
        if count & (count - 1) == 0:  # after 1, 2, 4, 8 … chunks: one of them is near the half
            marks[count] = builder.finish()
    if builder is None or last is None:
        raise PoorExcitation("there is no chunk of data; give a longer record")
    whole = replace(builder.finish(), names=channel_names(last))
    first = marks[max(mark for mark in marks if 2 * mark <= max(count, 2))]
    halves = (first, whole - first) if count > 1 else None
    return whole, halves, last
