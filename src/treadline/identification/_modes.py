"""B, D and initial state that fit a free run best, in modal coordinates.

With A = V diag(λ) V⁻¹ each state is one scalar filter of one input. An output is linear in the modal B, in D and in the initial
state. Of a conjugate pair one filter is run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Num

from treadline.core.arrays import store_contiguous
from treadline.core.transfer_function import GROWTH_MOST
from treadline.identification._affine import Affine
from treadline.identification._factor import inverse, solved
from treadline.identification._recursion_kernels import pole_filters

ILL_CONDITIONED = 1e5
"""Condition number of the eigenvectors above which modal coordinates lose too many digits (nearly equal poles)."""


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


def _normal_equations(system: Affine, item: Experiment) -> tuple[Num[np.ndarray, "d d"], Num[np.ndarray, " d"]]:
    """Return J'J and J'y for modal B (n, m1) and D (p, m1); the initial state is eliminated."""
    (poles, V), n, (p, m1) = system.eigen, system.order, system.D.shape
    is_upper = poles.imag >= 0.0  # real poles, and the first of each conjugate pair
    # The initial state acts as an impulse on an additional input, one sample earlier.
    u = np.pad(item.u, ((1, 0), (0, 1)))
    u[0, m1] = 1.0
    upper = pole_filters(poles[is_upper].astype(complex), u.astype(complex))[1:].reshape(len(item.y), -1)
    signals = np.hstack([upper.real, upper.imag, item.u, item.y])[item.there]
    w, s, half = m1 + 1, n * (m1 + 1), upper.shape[1]
    at = ((np.cumsum(is_upper) - 1)[:, None] * w + np.arange(w)).ravel()
    rest = np.arange(2 * half, signals.shape[1])
    real, imag = np.concatenate([at, rest]), np.concatenate([half + at, 0 * rest])
    turn = 1j * np.concatenate([np.repeat(np.where(is_upper, 1.0, -1.0), w), 0.0 * rest])
    G = signals.T @ signals
    P = G[real] - turn[:, None] * G[imag]
    P = P[:, real] + turn * P[:, imag]
    a, b, last = slice(0, s), slice(s, s + m1), slice(s + m1, None)
    # A state acts on all outputs through C, an input through D on one.
    C = np.repeat(system.C @ V, w, axis=1).astype(complex)
    square = np.zeros((s + p * m1, s + p * m1), dtype=complex)
    square[:s, :s] = (C.conj().T @ C) * P[a, a]
    square[:s, s:] = (C.conj().T[:, :, None] * P[a, None, b]).reshape(s, p * m1)
    square[s:, :s] = square[:s, s:].conj().T
    square[s:, s:] = np.kron(np.eye(p), P[b, b])
    right = np.concatenate([np.einsum("os,so->s", C.conj(), P[a, last]), P[b, last].T.ravel()])
    start = np.arange(m1, s, w)
    kept = np.delete(np.arange(len(right)), start)
    cross = square[np.ix_(kept, start)] @ inverse(square[np.ix_(start, start)])
    return square[np.ix_(kept, kept)] - cross @ square[np.ix_(start, kept)], right[kept] - cross @ right[start]


def with_inputs_again(system: Affine, experiments: Sequence[Experiment], fixed: Bool[np.ndarray, "p m1"]) -> Affine:
    """Return the system with B, D and the offsets that minimise the free-run error, A, C and K kept.

    Args:
        system: Model.
        experiments: Data.
        fixed: Mask of the entries of D that stay zero.
    """
    longest = max(len(item.y) for item in experiments)
    if not np.isfinite(system.A).all() or longest * np.log(system.radius) > np.log(GROWTH_MOST):
        return system
    if not np.linalg.cond(system.eigen[1], "fro") < ILL_CONDITIONED:
        return system
    square, right = (
        np.sum(parts, axis=0) for parts in zip(*(_normal_equations(system, item) for item in experiments), strict=True)
    )
    if not np.isfinite(square).all():
        return system
    n, m1 = system.order, system.B.shape[1]
    live = np.concatenate([np.ones(n * m1, dtype=bool), ~fixed.ravel()])
    found = np.zeros(len(live), dtype=complex)
    found[live] = solved(square[np.ix_(live, live)], right[live, None])[:, 0]
    return replace(system, B=(system.eigen[1] @ found[: n * m1].reshape(n, m1)).real, D=found[n * m1 :].reshape(fixed.shape).real)
