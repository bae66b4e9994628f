"""Records and state-space models as data: checked arrays, which the mathematics of ``linear_systems`` works on.

Recorded data come as callers hold them: arrays of either orientation, data frames and series.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.arrays import matrix, real, shaped
from treadline.core.errors import ModelError, NotFinite, RecordError, ShapeMismatch
from treadline.core.printing import Brief

Provenance = Mapping[str, Any]
"""Origin of a model: command, versions, seeds, fit. JSON values only."""
Samples = tuple[Any, tuple[str, ...]]
"""Values, one row per sample, and names of the columns; no names for an array."""

UNWRAPPED = "_unwrapped_rad"
"""Suffix of angle channels that may exceed π; only the name distinguishes an unwrapped angle from degrees."""
GAP_SHARE = 0.2
"""Largest share of rows with a NaN; above this share the remaining rows no longer represent the experiment."""
RUN_VALUES = 10
"""Least output values per estimated initial state for a free-run score: the state estimate uses a tenth of them."""
TEST_VALUES = 100
"""Least output values per initial state for residual tests: state estimation from fewer values colours white residuals."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class InputOutputRecord(Brief):
    """Sampled inputs and outputs of an experiment; ``y[k]`` is measured before ``u[k]`` acts.

    One row per sample, one column per channel; a one-dimensional array is a single channel. Any array-like of real numbers is
    accepted.
    """

    u: Float[np.ndarray, "T m"]
    y: Float[np.ndarray, "T p"]
    dt_s: float
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    vehicle: str = ""
    """Name of the vehicle that drove; empty if unknown."""

    def __post_init__(self) -> None:
        for name in ("u", "y"):
            object.__setattr__(self, name, _columns(name, getattr(self, name)))
        for name in ("input_names", "output_names"):
            object.__setattr__(self, name, names_of(name, getattr(self, name)))
        if self.u.shape[0] != self.y.shape[0]:
            raise ShapeMismatch(
                f"the record has {self.u.shape[0]} inputs but {self.y.shape[0]} outputs in time; cut both to one length"
            )
        if not isinstance(self.dt_s, Real):
            raise ModelError(f"dt_s is {self.dt_s!r}, of type {type(self.dt_s).__name__}; wanted a number")
        if not 0.0 < self.dt_s < math.inf:
            raise ModelError(f"the record's period is {self.dt_s} s; it must be positive and finite")

    def __len__(self) -> int:
        return int(self.u.shape[0])

    @property
    def whole(self) -> Bool[np.ndarray, " T"]:
        """Mask of the samples without a missing channel."""
        if np.isfinite(self.u).all() and np.isfinite(self.y).all():  # much faster than the row-wise test
            return np.ones(len(self), dtype=np.bool_)
        return np.asarray(np.isfinite(self.u).all(axis=1) & np.isfinite(self.y).all(axis=1))

    def stretches(self, values: int) -> list[slice]:
        """Return the segments used for model validation: the whole record, or the parts between missing inputs.

        The effect of an unknown input on the state is unknown and decays slowly in a slow model, so the state is estimated anew
        after each gap. Segments too short for an estimate are left out; if all are too short, the longest is returned.

        Args:
            values: Least number of output values per segment: ``RUN_VALUES`` or ``TEST_VALUES`` per state.
        """
        edges = np.flatnonzero(np.diff(np.isfinite(self.u).all(axis=1).astype(int), prepend=0, append=0))
        spans = [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
        if len(spans) <= 1:
            return spans
        held = [int(np.isfinite(self.y[span]).all(axis=1).sum()) * self.y.shape[1] for span in spans]
        long = [span for span, count in zip(spans, held, strict=True) if count >= values]
        return long or [spans[int(np.argmax(held))]]

    def delayed(self, shifts: Sequence[int]) -> "InputOutputRecord":
        """Return the record with each input as it acts after a dead time; missing where it was given before the record's start."""
        u = np.full(self.u.shape, np.nan)
        for j, shift in enumerate(shifts):
            u[shift:, j] = self.u[: max(len(self) - shift, 0), j]
        return replace(self, u=u)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StateSpaceModel:
    """x[k+1] = A x[k] + B (u[k - d] - input_offset),  y[k] - output_offset = C x[k] + D (u[k - d] - input_offset).

    ``input_delay`` d is the dead time of each input in samples, apart from the states. ``observer_gain`` L corrects the state by
    L (y - ŷ) each period (predictor form). ``input_offset`` contains the climb speed; without an offset the law u = -Kx would
    stop the chair. The constructor checks the shapes: A (n n), B (n m), C (p n), D (p m).
    """

    A: Float[np.ndarray, "_ _"]
    B: Float[np.ndarray, "_ _"]
    C: Float[np.ndarray, "_ _"]
    D: Float[np.ndarray, "_ _"]
    dt_s: float
    input_offset: Float[np.ndarray, " _"]
    output_offset: Float[np.ndarray, " _"]
    observer_gain: Float[np.ndarray, "_ _"] | None = None
    input_delay: tuple[int, ...] = ()
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "D"):
            object.__setattr__(self, name, matrix(name, getattr(self, name)))
        for name in ("input_names", "output_names"):
            object.__setattr__(self, name, names_of(name, getattr(self, name)))
        n, m, p = self.A.shape[0], self.B.shape[1], self.C.shape[0]
        object.__setattr__(self, "input_delay", _delays(self.input_delay, m))
        wanted = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "input_offset": (m,), "output_offset": (p,)}
        for name, shape in wanted.items():
            store_checked(self, name, shape)
        if self.observer_gain is not None:
            store_checked(self, "observer_gain", (n, p))
        if not self.dt_s > 0.0:
            raise ModelError(f"the model's period is {self.dt_s} s; it must be positive")

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    def pair(self, output: int, given: int) -> "StateSpaceModel":
        """Return the model from one input to one output.

        Raises:
            ModelError: If there is no such output or input.
        """
        p, m = self.D.shape
        if not (0 <= output < p and 0 <= given < m):
            raise ModelError(f"the model has no output {output} with input {given}: {p} outputs and {m} inputs, counted from 0")
        i, j = slice(output, output + 1), slice(given, given + 1)
        return replace(
            self,
            B=self.B[:, j],
            C=self.C[i],
            D=self.D[i, j],
            input_offset=self.input_offset[j],
            output_offset=self.output_offset[i],
            observer_gain=None,
            input_delay=self.input_delay[j],
            input_names=self.input_names[j],
            output_names=self.output_names[i],
        )


def channel_names(item: StateSpaceModel | InputOutputRecord) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of inputs and outputs: ``u1``, ``y1`` and so on where a model or a record has none."""
    m, p = (item.u.shape[1], item.y.shape[1]) if isinstance(item, InputOutputRecord) else item.D.shape[::-1]
    inputs = item.input_names or tuple(f"u{j + 1}" for j in range(m))
    outputs = item.output_names or tuple(f"y{i + 1}" for i in range(p))
    return inputs, outputs


def _columns(name: str, given: object) -> Float[np.ndarray, "T c"]:
    """Return the samples of a record, one row each; a one-dimensional array becomes one column.

    The array has the one memory layout that kernels are compiled for; a column-major, read-only or single-precision array, as
    a data frame may hold it, is copied.
    """
    wanted = "one row per sample, one column per channel"
    array = real(name, given, wanted)
    array = shaped(name, array[:, None] if array.ndim == 1 else array, (None, None), wanted)
    return np.require(array, dtype=np.float64, requirements=("C", "W"))


def names_of(name: str, given: Iterable[str]) -> tuple[str, ...]:
    """Return names as a tuple.

    Raises:
        RecordError: If they are one text, or not all texts.
    """
    names = () if isinstance(given, str) else tuple(given)
    if isinstance(given, str) or not all(isinstance(item, str) for item in names):
        raise RecordError(f"{name} is {given!r}; wanted a list of names, one per channel")
    return names


def _delays(given: Iterable[Any], inputs: int) -> tuple[int, ...]:
    """Return the dead time of each input; where all are zero, for as many inputs as there are."""
    delays = tuple(given)
    delays = delays if any(delays) else (0,) * inputs
    whole = all(isinstance(delay, int | np.integer) and not isinstance(delay, bool) and delay >= 0 for delay in delays)
    if not whole or len(delays) != inputs:
        raise ModelError(f"input_delay is {list(delays)}; give one whole number of samples per input ({inputs}), from 0 up")
    return tuple(int(delay) for delay in delays)


def store_checked(owner: object, name: str, shape: tuple[int, ...]) -> None:
    """Check an array of a model and store a read-only view.

    Raises:
        NotFinite: If it holds NaN or infinity.
        ShapeMismatch: If it has another shape.
    """
    array = real(name, getattr(owner, name), f"an array of shape {shape}")
    if array.shape != shape:
        raise ShapeMismatch(f"{name} is {array.shape}, the other matrices ask for {shape}; is it transposed?")
    if not np.isfinite(array).all():
        raise NotFinite(f"{name} holds NaN or Inf; identify the model again")
    array.setflags(write=False)
    object.__setattr__(owner, name, array)


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
