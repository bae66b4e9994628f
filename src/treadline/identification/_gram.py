"""Gram matrix of windows of inputs and outputs: the sufficient statistics of identification, accumulated in one pass.

A window is ``[1, z_k, z_{k-1}, …, z_{k-p}]`` with ``z = (u, y)``. Summed over a record, the product of two samples depends
only on their distance, except at the ends: the matrix is block Toeplitz up to corrections. Only its first block row needs
the data (2·N·r²·(p+1) flops for r channels instead of 2·N·r²·(p+1)²). Gram matrices add over chunks and experiments; fewer
lags are the leading block. Windows with a NaN are dropped and counted. The constant column absorbs offsets, so no mean has
to be subtracted.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from treadline.core.errors import LogFormatError, ShapeMismatch
from treadline.core.files import bytes_of, written_whole
from treadline.core.models import InputOutputRecord
from treadline.identification._factor import Factor
from treadline.identification._recursion_kernels import column_moments, normalise, slide

CHUNK = 1 << 13
"""Samples per pass: with four channels and forty lags their blocks stay in the processor's cache."""
BLOCK = 10
"""Samples per row of the matrix product of the windows: wide enough for the processor, and few products outside the lags."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Units:
    """Offset and scale of each channel, inputs before outputs."""

    shift: Float[np.ndarray, " r"]
    scale: Float[np.ndarray, " r"]
    input_count: int

    @property
    def input_scale(self) -> Float[np.ndarray, " m"]:
        """Standard deviation of each input."""
        return self.scale[: self.input_count]

    @property
    def output_scale(self) -> Float[np.ndarray, " p"]:
        """Standard deviation of each output."""
        return self.scale[self.input_count :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Gram:
    """Gram matrix over all complete windows of one or more experiments, in standard deviations of each channel."""

    lags: int
    units: Units
    dt_s: float
    sums: Float[np.ndarray, "q q"]
    count: float
    """Effective number of windows; smaller than the number seen after exponential forgetting."""
    dropped: int
    root: Float[np.ndarray, "_ q"] | None = None
    """Triangular R with R'R = sums from orthogonal transformations (``solver="qr"``); avoids squaring the condition number."""
    names: tuple[str, ...] = ()
    """Channel names, inputs first; empty if unknown."""

    @cached_property
    def factor(self) -> Factor:
        """Cholesky factor shared by the regressions of all lags."""
        return Factor.of(self.sums, self.units.input_count, len(self.units.scale))

    def __add__(self, other: "Gram") -> "Gram":
        if self.lags != other.lags or self.sums.shape != other.sums.shape:
            raise ShapeMismatch(f"Gram matrices of {self.lags} and {other.lags} lags do not add up")
        one, two = self.units, other.units
        if one.input_count != two.input_count or not np.array_equal([one.shift, one.scale], [two.shift, two.scale]):
            raise ShapeMismatch("Gram matrices in different units do not add up; make both with the units of one")
        if abs(self.dt_s - other.dt_s) > 1e-9 * self.dt_s:
            raise ShapeMismatch(f"Gram matrices of periods {self.dt_s:g} and {other.dt_s:g} s do not add up")
        return replace(
            self,
            sums=self.sums + other.sums,
            count=self.count + other.count,
            dropped=self.dropped + other.dropped,
            root=None if self.root is None or other.root is None else _stacked(self.root, other.root),
        )

    def forgotten(self, factor: float) -> "Gram":
        """Return the Gram matrix weighted by a forgetting factor."""
        root = None if self.root is None else self.root * np.sqrt(factor)
        return replace(self, sums=self.sums * factor, count=self.count * factor, root=root)

    def fewer(self, lags: int) -> "Gram":
        """Return the Gram matrix for fewer lags: the leading block."""
        kept = 1 + len(self.units.scale) * (lags + 1)
        root = None if self.root is None else self.root[:, :kept]
        return replace(self, lags=lags, sums=self.sums[:kept, :kept], root=root)

    def save(self, path: Path) -> None:
        """Write the Gram matrix as NPZ (arrays only, no pickled objects)."""
        with written_whole(path) as part, part.open("wb") as file:
            np.savez(
                file,
                **{name: getattr(self, name) for name in _SAVED},
                **asdict(self.units),
                sums=self.sums,
                names=np.array(self.names, dtype=np.str_),
            )

    @classmethod
    def load(cls, path: Path) -> "Gram":
        """Return the Gram matrix in a file.

        Raises:
            LogFormatError: If the file is missing, or was not written by ``save``.
        """
        data = bytes_of(path, "a saved Gram matrix", LogFormatError)
        try:
            with np.load(BytesIO(data), allow_pickle=False) as file:
                numbers = {name: file[name].item() for name in _SAVED}
                units = Units(shift=file["shift"], scale=file["scale"], input_count=int(file["input_count"]))
                names = tuple(str(name) for name in file["names"]) if "names" in file else ()
                found = cls(units=units, sums=file["sums"], names=names, **numbers)
        except Exception as error:  # noqa: BLE001 - a damaged archive raises many kinds of exceptions
            cause = str(error).strip("'\"").partition("\n")[0] or type(error).__name__
            raise LogFormatError(
                f"{path}: not a saved Gram matrix: {cause}; --update takes a file written by identify --gram"
            ) from None
        if not found._is_sound():
            raise LogFormatError(f"{path}: a Gram matrix with inconsistent parts; write it again with --gram")
        return found

    def _is_sound(self) -> bool:
        """Whether the parts are finite and consistent in shape."""
        r, width = len(self.units.scale), 1 + len(self.units.scale) * (self.lags + 1)
        known = (self.dt_s, self.count, self.units.shift, self.units.scale, self.sums)
        return bool(
            all(np.isfinite(part).all() for part in known)
            and min(self.lags, self.dt_s, self.count, self.dropped + 1, *self.units.scale) > 0
            and 0 < self.units.input_count < r
            and self.units.shift.shape == (r,)
            and self.sums.shape == (width, width)
            and np.allclose(self.sums, self.sums.T)
        )


_SAVED = ("lags", "dt_s", "count", "dropped")
"""Numbers of a Gram matrix in a file, next to its arrays."""


class GramBuilder:
    """Incremental computation of a Gram matrix from samples in order."""

    def __init__(self, lags: int, units: Units, dt_s: float, *, solver: str = "gram") -> None:
        self._lags, self._units, self._dt_s = lags, units, dt_s
        width = 1 + len(units.scale) * (lags + 1)
        self._sums = np.zeros((width, width))
        self._root = np.zeros((0, width)) if solver == "qr" else None
        self._count, self._possible = 0, 0
        self.begin()

    def begin(self) -> None:
        """Begin a new experiment; windows do not extend across experiments."""
        self._past = np.zeros((0, len(self._units.scale)))

    def add(self, u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]) -> None:
        """Add consecutive samples."""
        for start in range(0, len(u), CHUNK):
            rows, old = slice(start, start + CHUNK), len(self._past)
            z = np.empty((old + len(u[rows]), len(self._units.scale)))
            z[:old] = self._past
            gaps = normalise(u[rows], y[rows], self._units.shift, self._units.scale, z[old:])
            self._possible += max(len(z) - self._lags, 0)
            holed = gaps or not np.isfinite(self._past).all()
            runs = runs_of(np.asarray(np.isfinite(z).all(axis=1))) if holed else [(0, len(z))]
            for first, stop in runs:
                if stop - first > self._lags:
                    self._add_windows(z[first:stop])
            self._past = z[max(0, len(z) - self._lags) :]

    def finish(self) -> Gram:
        """Return the Gram matrix of all samples so far; further samples may be added."""
        return Gram(
            lags=self._lags,
            units=self._units,
            dt_s=self._dt_s,
            sums=self._sums.copy() if self._root is None else self._root.T @ self._root,
            count=float(self._count),
            dropped=self._possible - self._count,
            root=None if self._root is None else self._root.copy(),
        )

    def _add_windows(self, z: Float[np.ndarray, "T r"]) -> None:
        """Add the windows of an unbroken run: one for each sample that has all its past in the run."""
        self._count += len(z) - self._lags
        if self._root is None:
            add_windows(z, self._lags, self._sums)
        else:
            windows = sliding_window_view(z, self._lags + 1, axis=0)[:, :, ::-1].transpose(0, 2, 1).reshape(len(z) - self._lags, -1)
            self._root = _stacked(self._root, np.column_stack([np.ones(len(windows)), windows]))


def add_windows(z: Float[np.ndarray, "T r"], lags: int, into: Float[np.ndarray, "q q"]) -> None:
    """Add the products of all windows of a run to a Gram matrix.

    Rows of ``BLOCK`` samples with their past give the products of all lags in one matrix product; equal lags lie on diagonals.
    """
    (samples, r), count = z.shape, len(z) - lags
    rows = -(-count // BLOCK)
    padded = np.zeros((lags + rows * BLOCK, r))
    padded[:samples] = z
    X = np.ascontiguousarray(sliding_window_view(padded.ravel(), (lags + BLOCK) * r)[:: BLOCK * r])
    products = (X[:, lags * r :].T @ X).reshape(BLOCK, r, lags + BLOCK, r)
    first = np.zeros((r, lags + 1, r))
    for i in range(BLOCK):
        first += products[i, :, i : i + lags + 1][:, ::-1]
    head, tail = z[:lags][::-1], z[count:][::-1]
    slide(first.reshape(r, -1), head.ravel(), tail.ravel(), into[1:, 1:])
    constant = np.cumsum(np.vstack([np.ones(count) @ z[lags:], head - tail]), axis=0).ravel()
    into[0, 0] += count
    into[0, 1:] += constant
    into[1:, 0] += constant


def gram_of(records: Sequence[InputOutputRecord], lags: int, units: Units, *, solver: str = "gram") -> Gram:
    """Return the Gram matrix of one or more experiments.

    Args:
        records: Experiments.
        lags: Number of past samples in a window.
        units: Offset and scale of each channel.
        solver: ``gram`` for normal equations, ``qr`` for orthogonal transformations (ten times slower, full precision).
    """
    builder = GramBuilder(lags, units, records[0].dt_s, solver=solver)
    for record in records:
        builder.begin()
        builder.add(record.u, record.y)
    return builder.finish()


def units_of(records: Sequence[InputOutputRecord]) -> Units:
    """Return mean and standard deviation of each channel over all records; NaN values are left out."""
    m = records[0].u.shape[1]
    about = np.concatenate([records[0].u[0], records[0].y[0]])
    about[~np.isfinite(about)] = 0.0
    sums = np.zeros((3, about.size))
    for _ in range(2):  # first about an arbitrary value, then about the mean, to avoid cancellation by a large offset
        sums[:] = 0.0
        for record in records:
            column_moments(record.u, about[:m], sums[:, :m])
            column_moments(record.y, about[m:], sums[:, m:])
        count = np.maximum(sums[0], 1.0)
        about += sums[1] / count
    return Units(shift=about, scale=np.sqrt(np.maximum(sums[2] / count - (sums[1] / count) ** 2, 0.0)), input_count=m)


def runs_of(whole: Bool[np.ndarray, " T"]) -> list[tuple[int, int]]:
    """Return start and stop of each run of True values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _stacked(root: Float[np.ndarray, "_ q"], rows: Float[np.ndarray, "_ q"]) -> Float[np.ndarray, "_ q"]:
    return np.asarray(np.linalg.qr(np.vstack([root, rows]), mode="r"))
