"""Checks of a record before identification: channels, units, gaps and excitation."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import lapack

from treadline.core import state_space
from treadline.core.errors import DependentInputs, NotFinite, PeriodMismatch, PoorExcitation, SettingsError, ShapeMismatch
from treadline.core.models import InputOutputRecord
from treadline.core.printing import UNITS, unit_ending
from treadline.core.state_space import GAP_SHARE, UNWRAPPED
from treadline.identification._gram import Gram, Units, units_of
from treadline.identification._limits import PREDICTABLE, ROUNDING

FEW_SAMPLES = 4.0
"""New information, in samples, below which an order counts as poorly excited."""


def units_of_moving(records: Sequence[InputOutputRecord]) -> Units:
    """Return the units of records that have been checked to be alike.

    Raises:
        PoorExcitation: If a channel is constant; for an input ``DependentInputs``.
    """
    units, m = units_of(records), records[0].u.shape[1]
    for j, (name, deviation) in enumerate(zip(channel_names(records[0]), units.scale, strict=True)):
        if not deviation > 1e-12 * abs(float(units.shift[j])):
            error, kind = (DependentInputs, "input") if j < m else (PoorExcitation, "output")
            raise error(f"{kind} '{name}' is constant; give a record in which it moves")
    return units


def check_integers(**numbers: object) -> None:
    """Check that each option is a positive integer or None.

    Raises:
        SettingsError: With the option and its value.
    """
    for name, number in numbers.items():
        if number is not None and not (isinstance(number, int | np.integer) and number >= 1):
            given = number if isinstance(number, int | float | np.number) else f"{number!r}, of type {type(number).__name__}"
            raise SettingsError(f"{name} is {given}; it must be an integer, at least 1")


def check_alike(records: list[InputOutputRecord], *, parts: bool = False, outputs_alone: bool = False) -> None:
    """Check that records hold finite numbers and have the same channels and period.

    Args:
        parts: Whether the records are parts of longer ones; the share of gaps is then checked on the whole record.
        outputs_alone: Whether the records may have no inputs.

    Raises:
        RecordError: With the record, the column and the number.
        PeriodMismatch: If records have different periods.
    """
    first = records[0]
    if not all(len(record) for record in records):
        raise PoorExcitation("a record holds no samples; give a longer one")
    _check_channels(first, outputs_alone=outputs_alone)
    for index, record in enumerate(records):
        where = f"record {index + 1}: " if len(records) > 1 else ""
        if record.u.shape[1:] != first.u.shape[1:] or record.y.shape[1:] != first.y.shape[1:]:
            raise ShapeMismatch(f"{where}has other channels than the first record")
        if abs(record.dt_s - first.dt_s) > 1e-9 * first.dt_s:
            raise PeriodMismatch(f"{where}period {record.dt_s:g} s, the first record has {first.dt_s:g} s; resample it")
        _check_finite(record, where, parts=parts)


def _check_channels(first: InputOutputRecord, *, outputs_alone: bool) -> None:
    for kind, count, names in (("inputs", first.u.shape[1], first.input_names), ("outputs", first.y.shape[1], first.output_names)):
        if count == 0 and not (outputs_alone and kind == "inputs"):
            raise ShapeMismatch(f"the record has no {kind}; give at least one")
        if names and len(names) != count:
            raise ShapeMismatch(f"the record has {count} {kind} but {len(names)} names of {kind}")
        if count > len(first) > 1:
            raise ShapeMismatch(f"{count} {kind} in {len(first)} samples: is the record transposed?")
    if not math.isfinite(first.dt_s):
        raise PeriodMismatch(f"the record's period is {first.dt_s} s; it must be finite")


def whole_samples(record: InputOutputRecord) -> int:
    """Return the number of samples without a missing channel."""
    return int(np.count_nonzero(record.whole))


def check_gaps(gaps: int, samples: int, where: str = "") -> None:
    """Reject a record with too many gaps.

    Raises:
        NotFinite: With the share of rows that hold a NaN.
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
                f"{where}column '{name}' reaches {np.nanmax(np.abs(column)):.1f}, beyond π: degrees instead of radians? "
                f"convert it; the name of an unwrapped angle ends in {UNWRAPPED}"
            )
    gaps = len(record) - whole_samples(record)
    if not gaps:
        return
    for name, column in zip(names, (*record.u.T, *record.y.T), strict=True):
        if np.isinf(column).any():
            raise NotFinite(f"{where}column '{name}' holds Inf at sample {int(np.flatnonzero(np.isinf(column))[0])}")
    if not parts:
        check_gaps(gaps, len(record), where)


def check_independent(data: Gram, names: tuple[str, ...]) -> None:
    """Check that no input is a linear combination of the others.

    Raises:
        DependentInputs: With the inputs and the standard deviation of each.
    """
    m = data.units.input_count
    at = slice(1, 1 + m)
    mean = data.sums[0, at] / data.count
    covariance = data.sums[at, at] / data.count - np.outer(mean, mean)
    if np.linalg.eigvalsh(covariance)[0] > ROUNDING:
        return
    moved = [f"'{name}' moved by ±{_with_unit(name, size)}" for name, size in zip(names, data.units.input_scale, strict=False)]
    still = np.flatnonzero(np.diag(covariance) <= ROUNDING)
    if still.size:
        raise DependentInputs(f"{moved[still[0]]}, at the start of the record or at gaps alone; give a record in which it moves")
    raise DependentInputs(f"the inputs move together: {', '.join(moved)}; give a record in which they move independently")


def _with_unit(name: str, size: float) -> str:
    """Return a size with the unit that the name of its channel ends in; small lengths and speeds in millimetres."""
    unit = UNITS.get(unit_ending(name) or "", "")
    milli = unit in {"m", "m/s"} and size < 0.1
    return f"{1e3 * size:.2g} m{unit}" if milli else f"{size:.2g} {unit}".rstrip()


def check_excitation(data: Gram, order: int) -> None:
    """Check that the inputs persistently excite the order, up to the lags of the Gram matrix.

    Raises:
        PoorExcitation: With the order that the inputs excite.
    """
    most = min(order, data.lags)
    possible = excitation_order(data.fewer(most))
    if possible < order and possible <= most:
        raise PoorExcitation(
            f"{insufficient_excitation(possible, order)}; give inputs that move more freely, or ask for order {possible} or less"
        )


def insufficient_excitation(support: int, order: int) -> str:
    """Return the message for inputs with too low an order of excitation."""
    return f"the inputs excite order {support} persistently, not {order}"


def excitation_order(data: Gram, *, samples: float = 0.0) -> int:
    """Return the largest order that the inputs excite persistently.

    The pivots of the inputs' covariance are the variances of an input not predictable from its own past and the other inputs
    (Ljung, System Identification, 1999, section 13.2). Limited by the lags of the Gram matrix.

    Args:
        samples: New information, in samples of an input's variance, to disregard; the corner of a single step is worth one.
    """
    m, r = data.units.input_count, len(data.units.scale)
    at = (1 + r * np.arange(data.lags + 1)[:, None] + np.arange(m)).ravel()
    rows = data.sums[at]
    covariance = rows[:, at] / data.count - rows[:, :1] * rows[:, 0] / data.count**2
    factor, info = lapack.dpotrf(covariance, lower=1, clean=0)
    pivots = np.diag(factor)[: info - 1 if info > 0 else None] ** 2
    new = int(np.argmax(np.append(pivots <= max(PREDICTABLE, samples / data.count), values=True)))
    return new // m


def channel_names(record: InputOutputRecord) -> tuple[str, ...]:
    """Return the names of inputs and outputs in one list, numbered for a record without names."""
    inputs, outputs = state_space.channel_names(record)
    return inputs + outputs
