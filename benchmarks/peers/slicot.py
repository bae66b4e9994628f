"""SLICOT's subspace identification (Fortran, IB01AD, IB01BD, IB01CD), called through ctypes.

Arrays are column-major; the workspace sizes are those of the routines' documentation.
"""

import ctypes
from collections.abc import Mapping
from functools import cache, partial
from typing import Any

import numpy as np
from jaxtyping import Float
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

ROWS_AT_ONCE = 20_000
"""Rows of the QR factorisation held at once; more samples are taken in turns."""
WORK_MOST = 20_000_000
"""Doubles of workspace from which IB01CD also works in turns."""


@cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL("libslicot.so.0")


def fit(
    record: InputOutputRecord, order: int, block_rows: int, *, method: str = "M", again: bool = False, cholesky: bool = False
) -> StateSpace:
    """Return the model of an order; ``cholesky`` takes the fast algorithm (squares the condition)."""
    u, y = np.asfortranarray(record.u), np.asfortranarray(record.y)
    if order >= block_rows or len(u) < 2 * (u.shape[1] + y.shape[1] + 1) * block_rows - 1:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(u)} samples")
    factor = _triangular_factor(u, y, block_rows, method, "C" if cholesky else "Q")
    A, B, C, D = _system(factor, order, block_rows, u.shape[1], y.shape[1], method, "C" if again else "A")
    if again:
        B, D, _ = inputs_and_start(A, C, u, y)
    return without_offsets(A, B, C, D)


class Slicot:
    """The library by name, in the form of the Python packages; +BD estimates B, D and x0 again from A and C (IB01CD)."""

    name = "SLICOT"
    install = "apt-get install libslicot0 libopenblas0"
    methods: Mapping[str, Fit] = {
        "SLICOT MOESP": partial(fit, method="M"),
        "SLICOT N4SID": partial(fit, method="N"),
        "SLICOT combined": partial(fit, method="C"),
        "SLICOT MOESP+BD": partial(fit, method="M", again=True),
        "SLICOT N4SID+BD": partial(fit, method="N", again=True),
    }

    def missing(self) -> str | None:
        """Return why the library cannot be used."""
        try:
            _library()
        except OSError as error:
            return str(error)
        return None

    def version(self) -> str:
        """Return the BLAS that the library uses: it decides the speed."""
        _library()
        with open("/proc/self/maps") as maps:  # noqa: PTH123 (a device, not a file)
            blas = sorted({line.split("/")[-1].strip() for line in maps if "/libblas" in line or "/libopenblas" in line})
        return "libslicot0, " + ", ".join(blas)


SLICOT = Slicot()


def _triangular_factor(
    u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"], block_rows: int, method: str, algorithm: str
) -> Float[np.ndarray, "w w"]:
    """IB01AD: the processed factor R of the block-Hankel matrices of the data."""
    (samples, m), p = u.shape, y.shape[1]
    width = 2 * (m + p) * block_rows
    factor = np.zeros((max(width, 3 * m * block_rows), width), order="F")
    turns = min(samples - 2 * block_rows + 1, ROWS_AT_ONCE) if algorithm == "Q" else 1
    work = np.empty(max((turns + 2) * width, 3 * width + 1, 5 * p * block_rows))
    singular_values, whole = np.empty(p * block_rows), np.empty(max(3, (m + p) * block_rows), dtype=np.int32)
    kind, direct = ("N", "N") if method == "N" else ("M", "M" if method == "M" else "N")
    modes = (kind, algorithm, direct, "O", "N", "N")
    sizes = (block_rows, m, p, samples)
    arrays = (u, samples, y, samples, ctypes.c_int(), factor, len(factor), singular_values)
    _call("ib01ad", *modes, *sizes, *arrays, 0.0, -1.0, whole, work, work.size)
    return factor


def _system(
    factor: Float[np.ndarray, "w w"], n: int, s: int, m: int, p: int, method: str, job: str
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"], Float[np.ndarray, "p m"]]:
    """IB01BD: the system matrices (job A), or A and C alone (job C)."""
    A, B, C, D = (np.zeros(shape, order="F") for shape in ((n, n), (n, m), (p, n), (p, m)))
    tall = (p * s - p) * n
    work_m = max(2 * tall + n * n + 7 * n, tall + n + 6 * m * s, tall + n + max(p + m * s, p * s + max(3 * p * s + 1, m)))
    work_n = p * s * n + max(
        tall + 2 * n + (2 * m + p) * s + p, 2 * tall + n * n + 8 * n, n + 4 * (m * s + n) + 1, m * s + 3 * n + p
    )
    work_bd = p * s * n + m * s * (n + p) * (m * (n + p) + 1) + max((n + p) ** 2, 4 * m * (n + p) + 1)
    work = np.empty(max(work_m, 2 * tall + 2 * n, work_n, work_bd) + 1000)
    whole = np.empty(max(p * s, m * s + n, m * (n + p), n * n), dtype=np.int32)
    none = np.empty(1)
    matrices = (factor, len(factor), A, n, C, p, B, n, D, p, none, 1, none, 1, none, 1, none, 1)
    flags = np.empty(2 * n, dtype=np.int32)
    _call("ib01bd", method, job, "N", s, n, m, p, 0, *matrices, 0.0, whole, work, work.size, flags)
    return A, B, C, D


def inputs_and_start(
    A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "p n"], u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]
) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, "p m"], Float[np.ndarray, " n"]]:
    """IB01CD: B, D and the initial state from A, C and the data."""
    (samples, m), p, n = u.shape, y.shape[1], len(A)
    B, D, x0, V = np.zeros((n, m), order="F"), np.zeros((p, m), order="F"), np.zeros(n), np.zeros((n, n), order="F")
    r, b, c, d = n * m + n, p * m, p * n, 2 * n * n + n
    f, q = m + max(2 * r, m), b + r * p
    one = samples * p * (r + 1) + max(n + max(d, f), 6 * r, 2 * m * m + 6 * m)
    turns = (b + r) * (r + 1) + max(q * (r + 1) + n * n * m + c + max(d, f), 6 * r, 2 * m * m + 6 * m)
    work = np.empty(3 + n * (n + m + p) + max(5 * n, 3, turns, min(one, WORK_MOST)))
    matrices = (np.asfortranarray(A), n, B, n, np.asfortranarray(C), p, D, p)
    data = (u.copy(order="F"), samples, y.copy(order="F"), samples)
    whole = np.empty(max(r, m), dtype=np.int32)
    _call("ib01cd", "X", "C", "D", n, m, p, samples, *matrices, *data, x0, V, n, 0.0, whole, work, work.size)
    return B, D, x0


def _call(name: str, *values: Any) -> None:
    """Call a routine with its warning and error indicators appended, and each letter's hidden length after them."""
    warning, error = ctypes.c_int(), ctypes.c_int()
    arguments = [_argument(value) for value in (*values, warning, error)]
    lengths = [ctypes.c_size_t(1) for value in values if isinstance(value, str)]
    getattr(_library(), f"{name}_")(*arguments, *lengths)
    if error.value:
        raise PeerError(f"{name.upper()} answers INFO = {error.value}")


def _argument(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.ctypes.data_as(ctypes.c_void_p)
    if isinstance(value, str):
        return ctypes.c_char_p(value.encode())
    if isinstance(value, ctypes.c_int):
        return ctypes.byref(value)
    return ctypes.byref(ctypes.c_double(value) if isinstance(value, float) else ctypes.c_int(value))
