"""The Gram matrix of windows of inputs and outputs: all that identification needs of the data, in one pass.

A window is ``[1, z_k, z_{k-1}, …, z_{k-p}]`` with ``z = (u, y)``. Summed over a whole record, products of two samples
depend on their distance alone, but for the ends: the matrix is block-Toeplitz up to corrections, so its first block row
is all that needs the data (2·N·r²·(p+1) flops for r channels instead of 2·N·r²·(p+1)²). Sums add up over chunks, over
experiments and over parts that are left out; fewer lags are the leading block. A window that holds a NaN is left out and
counted. The constant column takes the offsets, so that nobody has to subtract a mean that is not one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from treadline.errors import LogFormatError, ShapeMismatch
from treadline.identification.factor import Factor
from treadline.identification.kernels import column_moments, fold, lagged_products, normalise, slide
from treadline.models import InputOutputRecord, written_whole

CHUNK = 1 << 18
"""Samples per pass: eight megabytes of four channels."""
BLOCK_LEAST = 10
"""Samples per row of the products: matrices of less than 40 columns leave the processor waiting."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Units:
    """What is subtracted from each channel, and what it is divided by: outputs after inputs."""

    shift: Float[np.ndarray, " r"]
    scale: Float[np.ndarray, " r"]
    input_count: int

    def same(self, other: "Units") -> bool:
        """Whether sums in these and in those units add up."""
        return (
            self.input_count == other.input_count
            and np.array_equal(self.shift, other.shift)
            and np.array_equal(self.scale, other.scale)
        )

    @property
    def input_scale(self) -> Float[np.ndarray, " m"]:
        """Deviation of the inputs."""
        return self.scale[: self.input_count]

    @property
    def output_scale(self) -> Float[np.ndarray, " p"]:
        """Deviation of the outputs."""
        return self.scale[self.input_count :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Gram:
    """Sums over all whole windows of one or more experiments, in units of each channel's deviation."""

    lags: int
    units: Units
    dt_s: float
    sums: Float[np.ndarray, "q q"]
    count: float
    """Windows; less than were seen where old ones are forgotten."""
    dropped: int
    root: Float[np.ndarray, "_ q"] | None = None
    """R with R'R = sums, by orthogonal steps (``solver="qr"``): digits that squaring would lose."""
    names: tuple[str, ...] = ()
    """Channels, inputs first; empty where nobody said."""

    @cached_property
    def factor(self) -> Factor:
        """The factor that regressions of all lags share."""
        return Factor.of(self.sums, self.units.input_count, len(self.units.scale))

    def __add__(self, other: "Gram") -> "Gram":
        if self.lags != other.lags or self.sums.shape != other.sums.shape:
            raise ShapeMismatch(f"Gram matrices of {self.lags} and {other.lags} lags do not add up")
        if self.units is not other.units and not self.units.same(other.units):
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

    def __sub__(self, other: "Gram") -> "Gram":
        return replace(self, sums=self.sums - other.sums, count=self.count - other.count, root=None)

    def forgotten(self, factor: float) -> "Gram":
        """Return the sums weighed down by a factor: what was seen before new data counts less."""
        root = None if self.root is None else self.root * np.sqrt(factor)
        return replace(self, sums=self.sums * factor, count=self.count * factor, root=root)

    def fewer(self, lags: int) -> "Gram":
        """Return the sums for fewer lags: the leading block."""
        kept = 1 + len(self.units.scale) * (lags + 1)
        root = None if self.root is None else self.root[:, :kept]
        return replace(self, lags=lags, sums=self.sums[:kept, :kept], root=root)

    def save(self, path: Path) -> None:
        """Write the sums as NPZ: numbers alone, no code."""
        with written_whole(path) as part, part.open("wb") as file:
            np.savez(
                file,
                lags=self.lags,
                dt_s=self.dt_s,
                sums=self.sums,
                count=self.count,
                dropped=self.dropped,
                shift=self.units.shift,
                scale=self.units.scale,
                input_count=self.units.input_count,
                names=np.array(self.names, dtype=np.str_),
            )

    @classmethod
    def load(cls, path: Path) -> "Gram":
        """Return the sums in a file.

        Raises:
            LogFormatError: If it is missing, or not what ``save`` writes.
        """
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                values = {name: file[name] for name in _SAVED}
                names = tuple(str(name) for name in file["names"]) if "names" in file else ()
        except FileNotFoundError:
            raise LogFormatError(f"{path}: no such file") from None
        except KeyError as error:
            lacks = f"it lacks {str(error.args[0]).split(' ', maxsplit=1)[0]}"
            raise LogFormatError(f"{path}: not a saved Gram matrix: {lacks}; --update takes what identify --sums wrote") from None
        except IsADirectoryError:
            raise LogFormatError(f"{path}: not a saved Gram matrix but a folder") from None
        except Exception:  # noqa: BLE001 - a broken archive fails in a dozen ways
            raise LogFormatError(f"{path}: not a saved Gram matrix; write one with --sums") from None
        if not _sound(values):
            raise LogFormatError(f"{path}: a Gram matrix whose parts do not fit each other; write it again with --sums")
        return cls(
            lags=int(values["lags"]),
            units=Units(shift=values["shift"], scale=values["scale"], input_count=int(values["input_count"])),
            dt_s=float(values["dt_s"]),
            sums=values["sums"],
            count=float(values["count"]),
            dropped=int(values["dropped"]),
            names=names,
        )


_SAVED = ("lags", "dt_s", "sums", "count", "dropped", "shift", "scale", "input_count")


def _sound(values: dict[str, np.ndarray]) -> bool:
    """Whether the parts of a saved Gram matrix are numbers and fit each other."""
    if not all(value.dtype.kind in "fiu" and np.isfinite(value).all() for value in values.values()):
        return False
    scalars = [values[name] for name in ("lags", "dt_s", "count", "dropped", "input_count")]
    if any(value.ndim for value in scalars) or values["scale"].ndim != 1:
        return False
    lags, dt_s, count, dropped, inputs = (float(value) for value in scalars)
    r, sums = len(values["scale"]), values["sums"]
    width = 1 + r * (int(lags) + 1)
    return bool(
        lags >= 1
        and dt_s > 0.0
        and count > 0.0
        and dropped >= 0.0
        and 0 < inputs < r
        and values["shift"].shape == (r,)
        and (values["scale"] > 0.0).all()
        and sums.shape == (width, width)
        and sums.dtype == np.float64
        and np.allclose(sums, sums.T)
    )


class GramBuilder:
    """Takes data as they come; ``finish`` gives their Gram matrix."""

    def __init__(self, lags: int, units: Units, dt_s: float, *, solver: str = "gram") -> None:
        self._lags, self._units, self._dt_s = lags, units, dt_s
        r = len(units.scale)
        width = 1 + r * (lags + 1)
        self._sums = np.zeros((width, width))
        self._root = np.zeros((0, width)) if solver == "qr" else None
        self._count, self._lost = 0, 0
        self._past = np.zeros((0, r))
        self._segment: _Segment | None = None
        self._seen = 0

    def begin(self) -> None:
        """Begin a new experiment: no window reaches back into the one before."""
        self._close()
        self._lost += max(self._seen - self._lags, 0)
        self._seen, self._past = 0, self._past[:0]

    def add(self, u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]) -> None:
        """Add the samples that follow."""
        for start in range(0, len(u), CHUNK):
            self._add(u[start : start + CHUNK], y[start : start + CHUNK])

    def finish(self) -> Gram:
        """Return the sums of all that was added so far; more may follow."""
        sums, count = self._sums.copy(), self._count
        if self._segment is not None:
            count += self._segment.into(sums)
        return Gram(
            lags=self._lags,
            units=self._units,
            dt_s=self._dt_s,
            sums=sums if self._root is None else self._root.T @ self._root,
            count=float(count),
            dropped=self._lost + max(self._seen - self._lags, 0) - count,
            root=None if self._root is None else self._root.copy(),
        )

    def _add(self, u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]) -> None:
        old = len(self._past)
        z = np.empty((old + len(u), len(self._units.scale)))
        z[:old] = self._past
        gaps = normalise(u, y, self._units.shift, self._units.scale, z[old:])
        self._seen += len(u)
        for start, stop in _runs(z, old, gaps):
            if self._segment is None or start > 0:
                self._close()
                self._segment = _Segment(self._lags, z.shape[1])
                before = max(start, old)
            else:
                before = old
            self._segment.add(z[start:stop], before - start)
            self._add_rows(z[start:stop], max(before - start, self._lags))
            if stop < len(z):
                self._close()
        if gaps and not np.isfinite(z[-1]).all():
            self._close()
        past = z[max(0, len(z) - self._lags) :]
        self._past = past[_last_gap(past) :].copy()

    def _close(self) -> None:
        if self._segment is not None:
            self._count += self._segment.into(self._sums)
        self._segment = None

    def _add_rows(self, z: Float[np.ndarray, "T r"], begin: int) -> None:
        """Take the windows that end in the samples from ``begin`` on into the triangular root."""
        if self._root is None:
            return
        rows = max(2 * self._root.shape[1], 4096)
        for first in range(begin, len(z), rows):
            last = min(first + rows, len(z))
            blocks = [np.ones((last - first, 1)), *(z[first - lag : last - lag] for lag in range(self._lags + 1))]
            self._root = _stacked(self._root, np.hstack(blocks))


class _Segment:
    """Products of samples at each distance, of an unbroken run of samples."""

    def __init__(self, lags: int, r: int) -> None:
        self._lags = lags
        self._products = np.zeros((lags + 1, r, r))
        self._total = np.zeros(r)
        self._head = np.zeros((0, r))
        self._tail = np.zeros((0, r))
        self._length = 0

    def add(self, z: Float[np.ndarray, "T r"], old: int) -> None:
        """Add the samples from ``old`` on; those before are the run's last ones, at most as many as lags."""
        lags, r = self._lags, z.shape[1]
        # Whole rows of b samples by matrix products; what lies across a seam, and the rest, one by one.
        block = max(lags, BLOCK_LEAST)
        rows = (len(z) - old) // block
        end = old + rows * block if rows > 1 else old
        if end > old:
            X = z[old:end].reshape(rows, block * r)
            fold(X.T @ X, X[:-1].T @ X[1:], lags, r, self._products)
            lagged_products(z, old, min(old + lags, end), old, self._products)
        lagged_products(z, end, len(z), len(z), self._products)
        if len(self._head) < lags:
            self._head = np.vstack([self._head, z[old : old + lags - len(self._head)]])
        self._total += np.ones(len(z) - old) @ z[old:]
        self._tail = z[max(0, len(z) - lags) :]
        self._length += len(z) - old

    def into(self, sums: Float[np.ndarray, "q q"]) -> int:
        """Add the sums over this run's windows; return their number."""
        lags, r = self._lags, self._total.size
        count = self._length - lags
        if count <= 0:
            return 0
        head, tail = self._head[::-1], self._tail[::-1]
        # Block row 0 takes t = p … N-1: what t = l … p-1 gave goes.
        early = np.zeros_like(self._products)
        lagged_products(self._head, 0, lags, lags, early)
        first = (self._products - early).transpose(1, 0, 2).reshape(r, -1)
        slide(np.ascontiguousarray(first), head.ravel(), tail.ravel(), sums[1:, 1:])
        newest = self._total - self._head.sum(axis=0)
        constant = np.concatenate([newest[None], newest + np.cumsum(head - tail, axis=0)]).ravel()
        sums[0, 0] += count
        sums[0, 1:] += constant
        sums[1:, 0] += constant
        return count


def gram(record: InputOutputRecord, lags: int, units: Units, *, solver: str = "gram") -> Gram:
    """Return the Gram matrix of one experiment.

    Args:
        solver: ``gram``, or ``qr``: orthogonal steps, ten times dearer, for data whose digits all count.
    """
    return gram_of([record], lags, units, solver=solver)


def gram_of(records: Sequence[InputOutputRecord], lags: int, units: Units, *, solver: str = "gram") -> Gram:
    """Return the Gram matrix of several experiments."""
    builder = GramBuilder(lags, units, records[0].dt_s, solver=solver)
    for record in records:
        builder.begin()
        builder.add(record.u, record.y)
    return builder.finish()


def units_of(records: Sequence[InputOutputRecord]) -> Units:
    """Return mean and deviation of each channel over all records; a NaN does not count."""
    m = records[0].u.shape[1]
    about = np.concatenate([records[0].u[0], records[0].y[0]])
    about[~np.isfinite(about)] = 0.0
    sums = np.zeros((3, about.size))
    for _ in range(2):  # about a first value, then about the mean: no digit is lost to an offset
        sums[:] = 0.0
        for record in records:
            column_moments(record.u, about[:m], sums[:, :m])
            column_moments(record.y, about[m:], sums[:, m:])
        count = np.maximum(sums[0], 1.0)
        about += sums[1] / count
    return Units(shift=about, scale=np.sqrt(np.maximum(sums[2] / count - (sums[1] / count) ** 2, 0.0)), input_count=m)


def _runs(z: Float[np.ndarray, "T r"], old: int, gaps: int) -> list[tuple[int, int]]:
    """Return start and stop of each run of whole samples that holds one from ``old`` on."""
    if not gaps:
        return [(0, len(z))]
    return [(start, stop) for start, stop in runs_of(np.isfinite(z).all(axis=1)) if stop > old]


def runs_of(whole: Bool[np.ndarray, " T"]) -> list[tuple[int, int]]:
    """Return start and stop of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _last_gap(z: Float[np.ndarray, "T r"]) -> int:
    gaps = np.flatnonzero(~np.isfinite(z).all(axis=1))
    return int(gaps[-1]) + 1 if gaps.size else 0


def _stacked(root: Float[np.ndarray, "_ q"], rows: Float[np.ndarray, "_ q"]) -> Float[np.ndarray, "_ q"]:
    return np.asarray(np.linalg.qr(np.vstack([root, rows]), mode="r"))
