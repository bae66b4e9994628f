"""What a record must be before anything is fitted to it."""

import math

import numpy as np
from scipy.linalg import lapack

from treadline.errors import NotFinite, PeriodMismatch, PoorExcitation, SettingsError, ShapeMismatch
from treadline.identification.gram import Gram, Units, units_of
from treadline.models import InputOutputRecord

GAP_SHARE = 0.2
"""Largest share of rows with a NaN: beyond it, what is left is not the experiment that was run."""

UNWRAPPED = "_unwrapped_rad"
"""What the name of an angle ends in that may pass π: nothing but its name tells it from degrees, which move as smoothly."""
TOGETHER = 1e-13
"""Variance of the weakest combination of inputs, over one input's, that rounding may leave."""
FEW_SAMPLES = 4.0
"""Samples' worth of something new, below which an order counts as hardly excited."""
NOTHING_NEW = 1e-9
"""Variance, over an input's own, below which a further sample brings nothing that the past did not foretell."""


def check_records(records: list[InputOutputRecord], *, parts: bool = False) -> Units:
    """Check that records are numbers, fit each other and move; return their units, which that takes.

    Whether each input moves by itself shows in the sums: ``check_independent``.

    Args:
        parts: Whether they are parts of longer ones: what share of those may be missing, is asked of the whole.

    Raises:
        RecordError: With the record, the column and the number.
        PeriodMismatch: If records have different periods.
    """
    check_alike(records, parts=parts)
    return _check_movement(records)


def check_whole(**numbers: object) -> None:
    """Check that options are whole numbers, at least 1, or left out.

    Raises:
        SettingsError: With the option and what it is.
    """
    for name, number in numbers.items():
        if number is not None and not (isinstance(number, int | np.integer) and number >= 1):
            given = number if isinstance(number, int | float | np.number) else f"{number!r}, of type {type(number).__name__}"
            raise SettingsError(f"{name} is {given}; at least 1, a whole number")


def check_alike(records: list[InputOutputRecord], *, parts: bool = False) -> None:
    """Check that records hold numbers and have the same channels and period.

    Args:
        parts: As above.

    Raises:
        RecordError: With the record, the column and the number.
        PeriodMismatch: If records have different periods.
    """
    first = records[0]
    if not all(len(record) for record in records):
        raise PoorExcitation("a record holds no samples; give a longer one")
    _check_channels(first)
    for index, record in enumerate(records):
        where = f"record {index + 1}: " if len(records) > 1 else ""
        if record.u.shape[1:] != first.u.shape[1:] or record.y.shape[1:] != first.y.shape[1:]:
            raise ShapeMismatch(f"{where}has other channels than the first record")
        if abs(record.dt_s - first.dt_s) > 1e-9 * first.dt_s:
            raise PeriodMismatch(f"{where}period {record.dt_s:g} s, the first record has {first.dt_s:g} s; resample it")
        _check_finite(record, where, parts=parts)


def _check_channels(first: InputOutputRecord) -> None:
    for kind, count, names in (("inputs", first.u.shape[1], first.input_names), ("outputs", first.y.shape[1], first.output_names)):
        if count == 0:
            raise ShapeMismatch(f"the record has no {kind}; give at least one")
        if names and len(names) != count:
            raise ShapeMismatch(f"the record has {count} {kind} but {len(names)} names of {kind}")
        if count > len(first) > 1:
            raise ShapeMismatch(f"{count} {kind} in {len(first)} samples: is the record transposed?")
    if not math.isfinite(first.dt_s):
        raise PeriodMismatch(f"the record's period is {first.dt_s} s; it must be finite")


def gaps_in(record: InputOutputRecord) -> int:
    """Return in how many samples a channel is missing."""
    return len(record) - int(np.count_nonzero(record.whole))


def check_gaps(gaps: int, samples: int, where: str = "") -> None:
    """Refuse a record that is mostly holes.

    Raises:
        NotFinite: With the share.
    """
    share = gaps / max(samples, 1)
    if share > GAP_SHARE:
        raise NotFinite(f"{where}{100 * share:.0f} % of the rows hold a NaN, more than {100 * GAP_SHARE:.0f} %")


def _check_finite(record: InputOutputRecord, where: str, *, parts: bool) -> None:
    names = channel_names(record)
    for name, column in zip(names, (*record.u.T, *record.y.T), strict=True):
        if not name.endswith("_rad") or name.endswith(UNWRAPPED):
            continue
        if np.nanmax(np.abs(column), initial=0.0) > math.pi and not np.isinf(column).any():
            raise ShapeMismatch(
                f"{where}column '{name}' reaches {np.nanmax(np.abs(column)):.1f}, beyond π: degrees where radians are "
                f"meant? convert it; an angle that was unwrapped is called …{UNWRAPPED}"
            )
    gaps = gaps_in(record)
    if not gaps:
        return
    for name, column in zip(names, (*record.u.T, *record.y.T), strict=True):
        if np.isinf(column).any():
            raise NotFinite(f"{where}column '{name}' holds Inf at sample {int(np.flatnonzero(np.isinf(column))[0])}")
    if not parts:
        check_gaps(gaps, len(record), where)


def _check_movement(records: list[InputOutputRecord]) -> Units:
    names, m = channel_names(records[0]), records[0].u.shape[1]
    units = units_of(records)
    for j, (name, deviation) in enumerate(zip(names, units.scale, strict=True)):
        if not deviation > 1e-12 * abs(float(units.shift[j])):
            kind = "input" if j < m else "output"
            raise PoorExcitation(f"{kind} '{name}' is constant; give a record in which it moves")
    return units


def check_independent(data: Gram, names: tuple[str, ...]) -> None:
    """Check that no input follows from the others.

    Raises:
        PoorExcitation: With the inputs and their rank.
    """
    m = data.units.input_count
    at = slice(1, 1 + m)
    mean = data.sums[0, at] / data.count
    rank = int(np.sum(np.linalg.eigvalsh(data.sums[at, at] / data.count - np.outer(mean, mean)) > TOGETHER))
    if rank < m:
        raise PoorExcitation(
            f"the {m} inputs move together (rank {rank}): {', '.join(names[:m])}; give a record in which each moves by itself"
        )


def check_excitation(data: Gram, order: int) -> None:
    """Check that the inputs excite an order at all, as far as the lags of the sums tell.

    Raises:
        PoorExcitation: With the order that they excite.
    """
    most = min(order, data.lags)
    possible = excitation_order(data.fewer(most))
    if possible < order and possible <= most:
        raise PoorExcitation(
            f"{too_little(possible, order)}; give inputs that move more freely, or ask for order {possible} or less"
        )


def too_little(support: int, order: int) -> str:
    """Return what inputs that excite too low an order are told."""
    return f"the inputs excite order {support} persistently, not {order}"


def excitation_order(data: Gram, *, samples: float = 0.0) -> int:
    """Return the largest order that the inputs excite persistently: how many samples on they still bring something new.

    What of an input its own past and the other inputs cannot foretell is a pivot of the inputs' covariance (Ljung, System
    Identification, 1999, section 13.2). Counted as far as the lags of the sums go.

    Args:
        samples: How many samples' worth of an input's variance do not count yet: a single step's corner is worth one.
    """
    m, r = data.units.input_count, len(data.units.scale)
    at = (1 + r * np.arange(data.lags + 1)[:, None] + np.arange(m)).ravel()
    rows = data.sums[at]
    covariance = rows[:, at] / data.count - rows[:, :1] * rows[:, 0] / data.count**2
    factor, info = lapack.dpotrf(covariance, lower=1, clean=0)
    pivots = np.diag(factor)[: info - 1 if info > 0 else None] ** 2
    new = int(np.argmax(np.append(pivots <= max(NOTHING_NEW, samples / data.count), values=True)))
    return new // m


def channel_names(record: InputOutputRecord) -> tuple[str, ...]:
    """Return the names of inputs and outputs, numbered where the record has none."""
    inputs = record.input_names or tuple(f"u{i + 1}" for i in range(record.u.shape[1]))
    outputs = record.output_names or tuple(f"y{i + 1}" for i in range(record.y.shape[1]))
    return inputs + outputs
