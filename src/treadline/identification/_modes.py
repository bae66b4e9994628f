"""B, D and initial state that fit a free run best, in modal coordinates.

With A = V diag(λ) V⁻¹ each state is one scalar filter of one input. An output is linear in the modal B, in D and in the initial
state. Of a conjugate pair one filter is run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from treadline.core.arrays import store_contiguous
from treadline.identification._affine import Affine
from treadline.identification._factor import inverse, solved
from treadline.identification._recursion_kernels import pole_filters

ILL_CONDITIONED = 1e5
"""Condition number of the eigenvectors above which modal coordinates lose too many digits (nearly equal poles)."""
GROWTH = 1e3
"""Growth of a mode over a record above which the mode dominates the free run."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment:
    """Unbroken run in standard deviations: inputs with a column of ones, outputs, and a mask of valid samples."""

    u: Float[np.ndarray, "T m1"]
    y: Float[np.ndarray, "T p"]
    there: Bool[np.ndarray, " T"]

    def __post_init__(self) -> None:
        store_contiguous(self)

    def part(self, start: int, stop: int) -> "Experiment":
        """Return the samples ``start … stop - 1``."""
        at = slice(start, stop)
        return Experiment(u=self.u[at], y=self.y[at], there=self.there[at])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Modal decomposition A = V diag(poles) V⁻¹ and the modal output matrix C V; conjugate poles are adjacent."""

    poles: Num[np.ndarray, " n"]
    V: Num[np.ndarray, "n n"]
    C: Complex[np.ndarray, "p n"]

    @property
    def upper(self) -> Bool[np.ndarray, " n"]:
        """Mask of the real poles and the first of each conjugate pair."""
        return np.asarray(self.poles.imag >= 0.0)


def modes_of(system: Affine) -> Modes | None:
    """Return the modes, or None for ill-conditioned eigenvectors."""
    if not np.isfinite(system.A).all():
        return None
    poles, V = system.eigen
    try:
        W = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return None
    if not np.vdot(V, V).real * np.vdot(W, W).real < ILL_CONDITIONED**2:
        return None
    return Modes(poles=poles, V=V, C=(system.C @ V).astype(complex))


Normal = tuple[Num[np.ndarray, "d d"], Num[np.ndarray, " d"]]
"""J'J and J'e."""


def linear_sums(modes: Modes, item: Experiment) -> Normal:
    """Return the normal equations for modal B (n, m1) and D (p, m1); the initial state is eliminated."""
    upper = modes.poles[modes.upper].astype(complex)
    filtered = pole_filters(upper, np.ascontiguousarray(item.u, dtype=complex))
    # The response to an initial state: the powers λ^k.
    powers = np.tile(upper, (len(item.u), 1))
    powers[0] = 1.0
    square, right = _products(modes, item, [filtered, np.cumprod(powers, axis=0)[:, :, None]])
    n, m1 = len(modes.poles), item.u.shape[1]
    # The Schur complement eliminates the initial state's columns.
    start = slice(n * m1, n * m1 + n)
    kept = np.delete(np.arange(len(right)), start)
    cross = square[kept, start] @ inverse(square[start, start])
    return square[np.ix_(kept, kept)] - cross @ square[start][:, kept], right[kept] - cross @ right[start]


def _products(modes: Modes, item: Experiment, groups: Sequence[Complex[np.ndarray, "T h _"]]) -> Normal:
    """Return J'J and J'y for columns of all modes, first those that act on all outputs through C, then inputs on one output each.

    Args:
        modes: Modal decomposition.
        item: Samples.
        groups: Columns of the upper poles that act through C.
    """
    u, y = item.u, item.y
    upper = np.hstack([group.reshape(len(y), -1) for group in groups])
    half = upper.shape[1]
    signals = np.hstack([upper.real, upper.imag, u, y])
    if not item.there.all():
        signals = signals[item.there]
    first, columns = np.cumsum([0, *(group[0].size for group in groups)]), np.cumsum(modes.upper) - 1
    at = np.concatenate([
        (start + columns[:, None] * group.shape[2] + np.arange(group.shape[2])).ravel()
        for start, group in zip(first[:-1], groups, strict=True)
    ])  # fmt: skip
    signs = np.concatenate([np.repeat(np.where(modes.upper, 1.0, -1.0), group.shape[2]) for group in groups])
    rest = np.zeros(u.shape[1] + y.shape[1], dtype=int)
    real, imag = np.concatenate([at, np.arange(2 * half, signals.shape[1])]), np.concatenate([half + at, rest])
    turn = 1j * np.concatenate([signs, rest])
    G = signals.T @ signals
    P = G[real] - turn[:, None] * G[imag]
    P = P[:, real] + turn * P[:, imag]
    s, p = sum(group.shape[2] for group in groups) * len(modes.poles), y.shape[1]
    w = len(real) - s - p
    C = modes.C[:, np.concatenate([np.repeat(np.arange(len(modes.poles)), group.shape[2]) for group in groups])]
    a, b, last = slice(0, s), slice(s, s + w), slice(s + w, None)
    square = np.zeros((s + p * w, s + p * w), dtype=complex)
    square[:s, :s] = (C.conj().T @ C) * P[a, a]
    square[:s, s:] = (C.conj().T[:, :, None] * P[a, None, b]).reshape(s, p * w)
    square[s:, :s] = square[:s, s:].conj().T
    square[s:, s:] = np.kron(np.eye(p), P[b, b])
    return square, np.concatenate([np.einsum("os,so->s", C.conj(), P[a, last]), P[b, last].T.ravel()])


def with_inputs_again(system: Affine, experiments: Sequence[Experiment], fixed: Bool[np.ndarray, "p m1"]) -> Affine:
    """Return the system with B, D and the offsets that minimise the free-run error, A, C and K kept.

    Args:
        system: Model.
        experiments: Data.
        fixed: Mask of the entries of D that stay zero.
    """
    modes = modes_of(system)
    longest = max(len(item.y) for item in experiments)
    if modes is None or longest * np.log(np.abs(modes.poles).max()) > np.log(GROWTH):
        return system
    square, right = (np.sum(parts, axis=0) for parts in zip(*(linear_sums(modes, item) for item in experiments), strict=True))
    if not np.isfinite(square).all():
        return system
    n, m1 = system.order, system.B.shape[1]
    live = np.concatenate([np.ones(n * m1, dtype=bool), ~fixed.ravel()])
    found = np.zeros(len(live), dtype=complex)
    found[live] = solved(square[np.ix_(live, live)], right[live, None])[:, 0]
    return replace(system, B=(modes.V @ found[: n * m1].reshape(n, m1)).real, D=found[n * m1 :].reshape(fixed.shape).real)
