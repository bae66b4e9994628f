"""ERA: from an impulse response to a state-space model.

Paper: Section IV, Eq. (7), (8). Juang and Pappa, 1985; with data correlations: Juang, Cooper and Wright, 1988. The
Hankel matrix holds the system's Markov parameters alone; an observer gain's do not belong there (they cost two digits
on Eq. (12)).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.errors import PoorExcitation

DENSE_MOST = 300
"""Rows up to which a dense decomposition is as fast as a randomised one."""
RANK_MOST = 30
"""Singular values that a randomised decomposition finds."""
MISSED = 1e-12
"""Share of a matrix's square that random directions may miss before they are turned towards it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HankelSvd:
    """H = U diag(s) V', the shifted H', and H's first block row and column."""

    U: Float[np.ndarray, "a k"]
    s: Float[np.ndarray, " k"]
    Vt: Float[np.ndarray, "k b"]
    shifted: Float[np.ndarray, "a b"]
    matrix: Float[np.ndarray, "a b"]
    """H itself."""


def hankel(markov: Float[np.ndarray, "n p m"], rows: int, columns: int, shift: int) -> Float[np.ndarray, "a b"]:
    """Return the block Hankel matrix whose first block is ``Y_{1 + shift}``.

    Paper: Eq. (8a) with shift 0, Eq. (8b) with shift 1.
    """
    _, p, m = markov.shape
    at = 1 + shift + np.arange(rows)[:, None] + np.arange(columns)
    return np.ascontiguousarray(markov[at].transpose(0, 2, 1, 3)).reshape(rows * p, columns * m)


def hankel_svd(
    markov: Float[np.ndarray, "n p m"],
    rows: int,
    columns: int,
    input_scale: Float[np.ndarray, " m"],
    output_scale: Float[np.ndarray, " p"],
    *,
    rank: int = RANK_MOST,
) -> HankelSvd:
    """Return the singular value decomposition of H, channels scaled to unit deviation.

    Scaled, a singular value says how much of what was measured a state explains; unscaled, it depends on units.
    """
    scaled = markov * input_scale / output_scale[:, None]
    H = hankel(scaled, rows, columns, 0)
    U, s, Vt = decompose(H, max(rank, RANK_MOST))
    return HankelSvd(U=U, s=s, Vt=Vt, shifted=hankel(scaled, rows, columns, 1), matrix=H)


def decompose(
    H: Float[np.ndarray, "a b"], rank: int = RANK_MOST
) -> tuple[Float[np.ndarray, "a k"], Float[np.ndarray, " k"], Float[np.ndarray, "k b"]]:
    """Return the leading singular values and vectors: all of a small matrix, ``rank`` of a large one.

    A large matrix is looked at through ten random directions more than asked for; where they miss something, as under
    noise, two power iterations turn them towards what is large (Halko, Martinsson and Tropp, 2011).
    """
    if min(H.shape) <= DENSE_MOST:
        return np.linalg.svd(H, full_matrices=False)
    basis = np.random.default_rng(0).standard_normal((H.shape[1], rank + 10))
    Q = np.linalg.qr(H @ basis)[0]
    seen = Q.T @ H
    if float(np.vdot(seen, seen)) < (1.0 - MISSED) * float(np.vdot(H, H)):
        for _ in range(2):
            Q = np.linalg.qr(H @ np.linalg.qr(seen.T)[0])[0]
            seen = Q.T @ H
    # Thin: the decomposition of a tall orthogonal factor's small partner.
    basis, R = np.linalg.qr(seen.T)
    U, s, Vt = np.linalg.svd(R.T)
    return (Q @ U)[:, :rank], s[:rank], Vt[:rank] @ basis.T


def realise(
    svd: HankelSvd,
    order: int,
    input_scale: Float[np.ndarray, " m"],
    output_scale: Float[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"]]:
    """Return A, B, C of the balanced realisation of an order.

    Raises:
        PoorExcitation: If the order is above the rank that the data show.
    """
    if order > svd.s.size or svd.s[order - 1] <= 1e-14 * svd.s[0]:
        rank = int(np.sum(svd.s > 1e-14 * svd.s[0]))
        raise PoorExcitation(f"order {order} is above the rank {rank} of the Hankel matrix; ask for {rank} or less")
    root = np.sqrt(svd.s[:order])
    observability, controllability = svd.U[:, :order] * root, root[:, None] * svd.Vt[:order]
    A = (svd.U[:, :order] / root).T @ svd.shifted @ (svd.Vt[:order].T / root)
    m, p = input_scale.size, output_scale.size
    return A, controllability[:, :m] / input_scale, observability[:p] * output_scale[:, None]


def correlated_svd(markov: Float[np.ndarray, "n p m"], rows: int, columns: int, shifts: int) -> HankelSvd:
    """Return the decomposition of ERA/DC: of correlations of Hankel matrices, in place of one Hankel matrix.

    ``[R_0 … R_c; …; R_c … R_2c]`` with ``R_k = H(k) H(0)'`` and c shifts: noise that differs from one shift to the next
    averages out, where ERA sees it once.

    Args:
        markov: Scaled Markov parameters, ``rows + columns + 2c + 1`` of them or more.
    """
    H0 = hankel(markov, rows, columns, 0)
    R = np.stack([hankel(markov, rows, columns, k) @ H0.T for k in range(2 * shifts + 2)])
    at = np.arange(shifts + 1)[:, None] + np.arange(shifts + 1)
    size = (shifts + 1) * len(H0)
    H, shifted = (np.ascontiguousarray(R[at + k].transpose(0, 2, 1, 3)).reshape(size, size) for k in (0, 1))
    U, s, Vt = decompose(H)
    return HankelSvd(U=U, s=s, Vt=Vt, shifted=shifted, matrix=H)


def realise_correlated(
    svd: HankelSvd, H0: Float[np.ndarray, "a b"], order: int, p: int, m: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"]]:
    """Return A, B, C of an order from a decomposition of correlations, in the scaled units of ``H0``."""
    root = np.sqrt(svd.s[:order])
    O = svd.U[:, :order] * root
    A = (svd.U[:, :order] / root).T @ svd.shifted @ (svd.Vt[:order].T / root)
    # The upper rows of O are H(0)'s own observability matrix; what it leaves of H(0) is the controllability matrix.
    B = np.linalg.lstsq(O[: len(H0)], H0, rcond=None)[0][:, :m]
    return A, B, O[:p]


def era(
    markov: Float[np.ndarray, "n p m"], order: int, *, rows: int | None = None
) -> tuple[Float[np.ndarray, "n2 n2"], Float[np.ndarray, "n2 m"], Float[np.ndarray, "p n2"], Float[np.ndarray, "p m"]]:
    """Return A, B, C, D of an order from the impulse response ``Y_0, Y_1, …``.

    Paper: Eq. (7), (8).
    """
    block = (len(markov) - 1) // 2 if rows is None else rows
    ones_m, ones_p = np.ones(markov.shape[2]), np.ones(markov.shape[1])
    svd = hankel_svd(markov, block, len(markov) - 1 - block, ones_m, ones_p)
    A, B, C = realise(svd, order, ones_m, ones_p)
    return A, B, C, markov[0].copy()
