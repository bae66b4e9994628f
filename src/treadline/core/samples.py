"""Recorded data as callers hold them: arrays of either orientation, data frames and series."""

from typing import Any

import numpy as np

from treadline.core.errors import RecordError, ShapeMismatch
from treadline.core.state_space import InputOutputRecord, StateSpaceModel

Samples = tuple[Any, tuple[str, ...]]
"""Values, one row per sample, and names of the columns; no names for an array."""


def samples_of(name: str, given: Any, *, channels_first: bool = False) -> Samples:
    """Return samples and column names; only a data frame or a series (pandas, polars) has names.

    Args:
        name: Name of the argument in error messages.
        given: Array-like, data frame or series.
        channels_first: Whether an array has one row per channel instead of one row per sample; a data frame never has.

    Raises:
        RecordError: If a column of the data frame holds no numbers.
    """
    if not hasattr(given, "to_numpy"):
        return (np.asarray(given).T if channels_first else given), ()
    try:
        values = given.to_numpy().astype(float)
    except (TypeError, ValueError):
        raise RecordError(f"{name}: a column of the data frame holds no numbers; select the columns that were measured") from None
    names = getattr(given, "columns", [getattr(given, "name", None)])
    return values, tuple(str(item) for item in names if item is not None)


def record_of(u: Any, y: Any, dt_s: float, *, channels_first: bool = False) -> InputOutputRecord:
    """Return the record of inputs and outputs; columns of data frames keep their names.

    Args:
        u: Inputs, as in ``samples_of``.
        y: Outputs, likewise.
        dt_s: Sampling period [s].
        channels_first: As in ``samples_of``.

    Raises:
        RecordError: If values are not all real numbers.
        ShapeMismatch: If the numbers of samples differ.
    """
    (inputs, input_names), (outputs, output_names) = (
        samples_of(name, given, channels_first=channels_first) for name, given in (("u", u), ("y", y))
    )
    _check_orientation(inputs, outputs, channels_first=channels_first)
    inputs, outputs = (np.reshape(item, (-1, 1)) if np.ndim(item) == 1 else item for item in (inputs, outputs))
    return InputOutputRecord(u=inputs, y=outputs, dt_s=dt_s, input_names=input_names, output_names=output_names)


def measured(model: StateSpaceModel, u: Any, y: Any) -> InputOutputRecord:
    """Return measured data for a model.

    Args:
        model: Model of the same channels and period.
        u: Inputs as in ``samples_of``, or a record.
        y: Outputs likewise; None next to a record.

    Raises:
        RecordError: If channels or period differ from the model's.
    """
    record = u if isinstance(u, InputOutputRecord) else record_of(u, y, model.dt_s)
    wanted, given = model.D.shape[::-1], (record.u.shape[1], record.y.shape[1])
    if wanted != given:
        raise RecordError(
            f"the data have {given[0]} inputs and {given[1]} outputs, the model has {wanted[0]} and {wanted[1]}; "
            "give the same channels"
        )
    if abs(record.dt_s - model.dt_s) > 1e-6 * model.dt_s:
        raise RecordError(f"the data have a period of {record.dt_s:g} s, the model {model.dt_s:g} s; resample the data")
    return record


def _check_orientation(u: Any, y: Any, *, channels_first: bool) -> None:
    """Reject data whose other orientation would fit: equal second, and unequal first lengths."""
    shapes = np.shape(u), np.shape(y)
    if all(len(shape) == 2 for shape in shapes) and shapes[0][0] != shapes[1][0] and shapes[0][1] == shapes[1][1] > 1:
        remedy = "leave channels_first out" if channels_first else "give channels_first=True"
        raise ShapeMismatch(f"u is {shapes[0]} and y is {shapes[1]}, with samples in rows; if a row is a channel, {remedy}")
