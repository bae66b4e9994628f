"""Numeric arrays: checking of those from callers, once, at the interface; products of vectors; impulse responses; thinning."""

from dataclasses import fields

import numpy as np
from jaxtyping import Float

from treadline.core.errors import NotFinite, RecordError, ShapeMismatch
from treadline.core.rotations import Vector3

REAL = "biuf"
"""Dtype kinds of real numbers: boolean, signed and unsigned integer, floating point."""
CONFIDENCE = 0.95
"""Probability of an interval."""
NORMAL_95 = 1.96
"""Half width of a 95 % interval [standard deviations]."""
BLOCK_ROWS = 65_536
"""Number of rows that are processed at a time: 5 MB with ten columns, 12 MB of products with two inputs and all lags."""
LARGEST = 2.0**53
"""Largest magnitude of a number in a file: double precision holds every integer up to here, and squares are far from overflow."""


def shaped(name: str, given: object, shape: tuple[int | None, ...], wanted: str) -> Float[np.ndarray, "..."]:
    """Return an array-like as a floating-point array of the given shape; a matching array is returned unchanged.

    Args:
        name: Name of the argument in error messages.
        shape: Required shape; None for a dimension of any length.
        wanted: Description of the requirement in error messages.

    Raises:
        RecordError: If the values are not all real numbers.
        ShapeMismatch: If the shape differs.
    """
    array = real(name, given, wanted)
    if len(array.shape) != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True)):
        raise ShapeMismatch(f"{name} is of shape {array.shape}; wanted {wanted}")
    return array


def observability(A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "p n"], steps: int) -> Float[np.ndarray, "steps p n"]:
    """Return the observability matrix C, CA, CA², …, by doubling; infinite where it diverges."""
    rows, power, done = np.empty((steps, *C.shape)), A, 1
    rows[:1] = C
    with np.errstate(over="ignore", invalid="ignore"):
        while done < steps:
            more = min(done, steps - done)
            rows[done : done + more] = (rows[:more].reshape(more * len(C), len(A)) @ power).reshape(more, *C.shape)
            power, done = power @ power, done + more
    return rows


def markov_parameters(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], C: Float[np.ndarray, "p n"], D: Float[np.ndarray, "p m"], steps: int
) -> Float[np.ndarray, "steps p m"]:
    """Return the impulse response D, C B, C A B, … of a state-space model."""
    return np.concatenate([D[None], observability(A, C, max(steps - 1, 1)) @ B])[:steps]


def matrix(name: str, given: object) -> Float[np.ndarray, "_ _"]:
    """Return an array-like as a floating-point matrix.

    Raises:
        RecordError: If the values are not all real numbers, or the rows differ in length.
        ShapeMismatch: If the array is not two-dimensional.
    """
    return shaped(name, given, (None, None), "a matrix, of two dimensions even where one is 1")


def real(name: str, given: object, wanted: str) -> Float[np.ndarray, "..."]:
    """Return an array-like as a floating-point array of any shape.

    Raises:
        RecordError: If the values are not all real numbers, or the rows differ in length.
    """
    try:
        array = np.asarray(given)
    except ValueError:
        raise ShapeMismatch(f"{name} has rows of different lengths; wanted {wanted}") from None
    if array.dtype.kind not in REAL:
        raise RecordError(f"{name} is {_called(given, array)}; wanted {wanted}, all real numbers")
    return array if array.dtype.kind == "f" else array.astype(float)


def check_magnitude(name: str, values: Float[np.ndarray, "..."], remedy: str) -> None:
    """Reject values that are not finite, or larger than ``LARGEST``.

    Raises:
        NotFinite: With the remedy.
    """
    if not (np.abs(values) <= LARGEST).all():
        raise NotFinite(f"{name} holds NaN, Inf or a number beyond {LARGEST:.0e}; {remedy}")


def store_contiguous(instance: object) -> None:
    """Store the arrays of a frozen dataclass C-contiguous: numba compiles a kernel anew for every other memory layout."""
    for item in fields(instance):  # type: ignore[arg-type]
        value = getattr(instance, item.name)
        if isinstance(value, np.ndarray) and not value.flags.c_contiguous:
            object.__setattr__(instance, item.name, np.ascontiguousarray(value))


def _called(given: object, array: np.ndarray) -> str:
    """Return a description of an argument that is not a numeric array: its value, or the type of its items."""
    if array.ndim == 0:
        return f"{given!r}, of type {type(given).__name__}"
    kind = {"c": "complex", "O": "object", "U": "str", "S": "bytes"}.get(array.dtype.kind, str(array.dtype))
    return f"an array of {kind} values"


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Return a × b; ``numpy.cross`` takes ten times as long for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def spectral_radius(A: Float[np.ndarray, "n n"]) -> float:
    """Return the largest magnitude of the eigenvalues; 0 without states."""
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def decimated(
    t: Float[np.ndarray, " T"], values: Float[np.ndarray, " T"], columns: int = 300
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return least and largest value of each of many short spans, or the series itself where it is short.

    Peaks stay; a span without any value stays a gap.
    """
    if len(values) <= 2 * columns:
        return t, values
    edges = np.linspace(0, len(values), columns, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(values, edges), np.fmax.reduceat(values, edges)
    return np.repeat(t[edges], 2), np.column_stack([low, high]).ravel()


def finite_or_none(value: float) -> float | None:
    """Return the number, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def rms(values: Float[np.ndarray, " n"]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
