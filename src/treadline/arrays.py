"""Numbers from a caller as arrays: converted and checked once, where they come in."""

import numpy as np
from jaxtyping import Float

from treadline.errors import RecordError, ShapeMismatch

REAL = "biuf"
"""Kinds of a dtype that are real numbers: truth values, whole numbers with and without a sign, floating ones."""


def shaped(name: str, given: object, shape: tuple[int | None, ...], wanted: str) -> Float[np.ndarray, "..."]:
    """Return what was given as an array of floating numbers of a shape; one that is this already is returned itself.

    Args:
        name: What the caller calls it.
        shape: None for a length that may be any.
        wanted: What it must be, in words.

    Raises:
        RecordError: If it holds anything but real numbers.
        ShapeMismatch: If it has another shape.
    """
    array = real(name, given, wanted)
    if len(array.shape) != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True)):
        raise ShapeMismatch(f"{name} is of shape {array.shape}; wanted {wanted}")
    return array


def matrix(name: str, given: object) -> Float[np.ndarray, "_ _"]:
    """Return what was given as a matrix of floating numbers.

    Raises:
        RecordError: If it holds anything but real numbers, or rows of different lengths.
        ShapeMismatch: If it is no matrix.
    """
    return shaped(name, given, (None, None), "a matrix, of two dimensions even where one is 1")


def real(name: str, given: object, wanted: str) -> Float[np.ndarray, "..."]:
    """Return what was given as an array of floating numbers, of whatever shape.

    Raises:
        RecordError: If it holds anything but real numbers, or rows of different lengths.
    """
    try:
        array = np.asarray(given)
    except ValueError:
        raise ShapeMismatch(f"{name} has rows of different lengths; wanted {wanted}") from None
    if array.dtype.kind not in REAL:
        raise RecordError(f"{name} is {_called(given, array)}; wanted {wanted}, all real numbers")
    return array if array.dtype.kind == "f" else array.astype(float)


def _called(given: object, array: np.ndarray) -> str:
    """Return what something that is no array of numbers is called: itself, or what it holds."""
    if array.ndim == 0:
        return f"{given!r}, of type {type(given).__name__}"
    kind = {"c": "complex", "O": "object", "U": "str", "S": "bytes"}.get(array.dtype.kind, str(array.dtype))
    return f"an array of {kind} values"
