"""Confidence intervals of ERA/DC models: covariance of OKID's Markov parameters propagated through the correlations.

ERA/DC decomposes the block Hankel matrix of ``R_k = H(k) H(0)'``, ERA decomposes H(0). The Markov parameters change R_k by
``dH(k) H(0)' + H(k) dH(0)'``; the change of state coordinates is then removed as for ERA.
"""

import numpy as np
from jaxtyping import Float

from treadline.identification._affine import Affine
from treadline.identification._pole_intervals import ConfidenceIntervals, markov_changes, with_constant
from treadline.identification._realisation import correlations
from treadline.identification._refine import Directions
from treadline.identification.era import HankelSvd, hankel
from treadline.identification.gram import Gram, Units
from treadline.identification.okid import ObserverMarkov


def of_correlations(observer: ObserverMarkov, svd: HankelSvd, system: Affine, units: Units, data: Gram) -> ConfidenceIntervals:
    """Return the intervals of ERA/DC's realisation of an observer, in standard deviations.

    Args:
        observer: OKID observer in standard deviations.
        svd: Decomposition of H(0).
        system: Realised system.
        units: Units of the system.
        data: Gram matrix of the data.
    """
    markov, found = correlations(observer, svd)
    n, (p, m), rows, columns, blocks = system.order, observer.D.shape, svd.rows, svd.columns, found.rows
    U, s, Vt = found.leading(n)
    root = np.sqrt(s)
    left = (U / root).T.reshape(n, blocks, rows * p).transpose(1, 0, 2)
    right = (Vt.T / root).reshape(blocks, rows * p, n)
    H = np.stack([hankel(markov, rows, columns, k) for k in range(2 * blocks)])
    dY = markov_changes(observer, system, data, len(markov))
    seen = H[0].T @ right  # H(0)' times the right factor, block by block
    at = np.arange(blocks)
    turn, moved = (
        _through_first(left, dY[shift:], seen, p, m)
        + _through_second(np.einsum("ina,ijab->jnb", left, H[at[:, None] + at + shift], optimize=True), dY, right, p, m)
        for shift in (0, 1)
    )
    # Changes of the upper rows of O, from which C and B are taken, with the right factor fixed.
    upper = _through_first(np.eye(rows * p)[None], dY, seen, p, m) + _through_second(H[at], dY, right, p, m)
    O = U[: rows * p] * root
    entering = dY[1 + np.arange(rows)].reshape(rows * p, m, -1)
    changed = entering - np.einsum("ank,nm->amk", upper, system.B[:, :m], optimize=True)
    B = np.tensordot(np.linalg.pinv(O), changed, axes=1)
    A = moved - np.einsum("njk,jl->nlk", turn, system.A, optimize=True)
    ways = Directions(A=A, B=with_constant(B), C=upper[:p], D=with_constant(dY[0]))
    return ConfidenceIntervals(system=system, ways=ways, units=units)


def _through_first(
    left: Float[np.ndarray, "i a b"], dY: Float[np.ndarray, "count p m k"], right: Float[np.ndarray, "j c n"], p: int, m: int
) -> Float[np.ndarray, "a n k"]:
    """Return Σ L_i dH(i+j) R_j; shift and block row enter as their sum, so each factor becomes one row of blocks."""
    L, R = _along_shifts(left.transpose(0, 2, 1), p), _along_shifts(right, m)
    total = np.zeros((L.shape[2], R.shape[2], dY.shape[3]))
    for at, block in enumerate(L):
        inner = np.tensordot(R, dY[1 + at : 1 + at + len(R)], axes=([0, 1], [0, 2]))
        total += np.tensordot(block, inner, axes=([0], [1]))
    return total


def _through_second(
    left: Float[np.ndarray, "j a b"], dY: Float[np.ndarray, "count p m k"], right: Float[np.ndarray, "j c n"], p: int, m: int
) -> Float[np.ndarray, "a n k"]:
    """Return Σ L_j dH(0)' R_j."""
    rows, columns = right.shape[1] // p, left.shape[2] // m
    R, L = right.reshape(len(right), rows, p, -1), left.reshape(len(left), left.shape[1], columns, m)
    total = np.zeros((left.shape[1], right.shape[2], dY.shape[3]))
    for at in range(rows):
        weights = np.einsum("jabm,jpn->bmpan", L, R[:, at], optimize=True)
        total += np.tensordot(weights, dY[1 + at : 1 + at + columns], axes=([0, 1, 2], [0, 2, 1]))
    return total


def _along_shifts(factor: Float[np.ndarray, "i a n"], size: int) -> Float[np.ndarray, "t s n"]:
    """Return Σ over i + row = t of the blocks with ``size`` rows."""
    shifts, rows, n = len(factor), factor.shape[1] // size, factor.shape[2]
    total = np.zeros((shifts + rows - 1, size, n))
    for at in range(shifts):
        total[at : at + rows] += factor[at].reshape(rows, size, n)
    return total
