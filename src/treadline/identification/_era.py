"""Eigensystem realisation algorithm (ERA): a state-space model from an impulse response.

Paper: Section IV, Eq. (7), (8). Juang and Pappa, 1985.
The Hankel matrix holds only the system's Markov parameters; including the observer gain's cost two digits on Eq. (12).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import lapack

from treadline.core.arrays import shaped
from treadline.core.errors import NotFinite, PoorExcitation, ShapeMismatch
from treadline.identification._checks import check_integers
from treadline.identification._limits import ROUNDING

DENSE_MOST = 300
"""Rows up to which a dense decomposition is as fast as a randomised one."""
RANK_MOST = 30
"""Number of singular values computed by a randomised decomposition."""


Triplets = tuple[Float[np.ndarray, "a k"], Float[np.ndarray, " k"], Float[np.ndarray, "k b"]]
"""Singular triplets U, s and V'."""


@dataclass(kw_only=True, eq=False)
class HankelSvd:
    """Lazy decomposition H = U diag(s) V' and the Markov parameters of H and the shifted H'."""

    markov: Float[np.ndarray, "n p m"]
    """Markov parameters; with channels in standard deviations a singular value measures how much of the measured variance a
    state explains, whatever the units."""
    rows: int
    """Number of block rows."""
    columns: int
    """Number of block columns."""
    rank: int = RANK_MOST
    """Number of singular values computed for a large H; a small H is decomposed completely."""

    @cached_property
    def s(self) -> Float[np.ndarray, " k"]:
        """Singular values."""
        return self._whole[1]

    def leading(self, order: int) -> Triplets:
        """Return O = U S^½, the singular values and R = S^½ V' of the leading part of H, its balanced factors.

        Raises:
            PoorExcitation: If the order is above the rank.
        """
        U, s, Vt = self._whole
        rank = int(np.sum(s > ROUNDING * s[0]))
        if order > rank:
            raise PoorExcitation(f"order {order} is above the rank {rank} of the Hankel matrix; ask for {rank} or less")
        root = np.sqrt(s[:order])
        return U[:, :order] * root, s[:order], root[:, None] * Vt[:order]

    @cached_property
    def _whole(self) -> Triplets:
        if self._is_dense:
            return np.linalg.svd(self.matrix, full_matrices=False)
        turned = self.markov.transpose(0, 2, 1)
        # Y_k fills anti-diagonal k.
        squares = np.convolve(np.ones(self.rows), np.ones(self.columns)) @ np.sum(
            self.markov[1 : self.rows + self.columns] ** 2, axis=(1, 2)
        )
        return leading_by_products(
            lambda X: hankel_times(self.markov, self.rows, X),
            lambda X: hankel_times(turned, self.columns, X),
            self.columns * self.markov.shape[2],
            float(squares),
            self.rank,
        )

    @property
    def _is_dense(self) -> bool:
        _, p, m = self.markov.shape
        return min(self.rows * p, self.columns * m) <= DENSE_MOST

    @property
    def matrix(self) -> Float[np.ndarray, "a b"]:
        """The block Hankel matrix H."""
        return hankel(self.markov, self.rows, self.columns, 0)

    def system_matrix(self, order: int) -> Float[np.ndarray, "n n"]:
        """Return A of the balanced realisation: S^-½ U' H' V S^-½."""
        O, s, R = self.leading(order)
        left, right = (O / s).T, R.T / s
        if self._is_dense:
            return left @ (hankel(self.markov, self.rows, self.columns, 1) @ right)
        return left @ hankel_times(self.markov[1:], self.rows, right)


def largest(H: Float[np.ndarray, "a b"]) -> float:
    """Return the largest singular value of a small matrix."""
    square = lapack.dsyevr(H.T @ H, compute_v=0, range="I", il=H.shape[1], iu=H.shape[1])[0][0]
    return float(np.sqrt(max(square, 0.0)))


def hankel(markov: Float[np.ndarray, "n p m"], rows: int, columns: int, shift: int) -> Float[np.ndarray, "a b"]:
    """Return the block Hankel matrix whose first block is ``Y_{1 + shift}``.

    Paper: Eq. (8a) with shift 0, Eq. (8b) with shift 1.
    """
    _, p, m = markov.shape
    blocks = markov[1 + shift + np.arange(rows)[:, None] + np.arange(columns)]
    return blocks.transpose(0, 2, 1, 3).reshape(rows * p, columns * m)


def hankel_times(markov: Float[np.ndarray, "n p m"], rows: int, right: Float[np.ndarray, "b k"]) -> Float[np.ndarray, "a k"]:
    """Return the Hankel matrix times a matrix, as a convolution of the Markov parameters without forming H."""
    _, p, m = markov.shape
    columns = len(right) // m
    width = rows + columns - 1
    size = next_fast_len(width, real=True)
    backwards = rfft(right.reshape(columns, m, -1)[::-1], size, axis=0)
    product = irfft(rfft(markov[1 : 1 + width], size, axis=0) @ backwards, size, axis=0)
    return np.asarray(product[columns - 1 : width].reshape(rows * p, -1))


Product = Callable[[Float[np.ndarray, "_ k"]], Float[np.ndarray, "_ k"]]


def leading_by_products(times: Product, turned_times: Product, width: int, squares: float, rank: int) -> Triplets:
    """Return the leading singular triplets of a large matrix known only through its products.

    Randomised range finder with an oversampling of ten; if the subspace misses a significant part, as under noise, two power
    iterations follow (Halko, Martinsson and Tropp, 2011).

    Args:
        times: Product of the matrix with given columns.
        turned_times: Product of its transpose with given columns.
        width: Number of columns.
        squares: Squared Frobenius norm.
        rank: Number of singular values wanted.
    """
    Q = np.linalg.qr(times(np.random.default_rng(0).standard_normal((width, rank + 10))))[0]
    seen = turned_times(Q)
    if float(np.vdot(seen, seen)) < (1.0 - ROUNDING) * squares:
        for _ in range(2):
            Q = np.linalg.qr(times(np.linalg.qr(seen)[0]))[0]
            seen = turned_times(Q)
    # Decompose the small factor of the thin QR instead of the tall matrix.
    basis, R = np.linalg.qr(seen)
    U, s, Vt = np.linalg.svd(R.T)
    return (Q @ U)[:, :rank], s[:rank], Vt[:rank] @ basis.T


def realise(svd: HankelSvd, order: int) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"]]:
    """Return A, B, C of the balanced realisation of an order.

    Raises:
        PoorExcitation: If the order is above the rank of the data.
    """
    observability, _, controllability = svd.leading(order)
    _, p, m = svd.markov.shape
    return svd.system_matrix(order), controllability[:, :m], observability[:p]


def era(
    markov: Float[np.ndarray, "n p m"], order: int, *, rows: int | None = None
) -> tuple[Float[np.ndarray, "n2 n2"], Float[np.ndarray, "n2 m"], Float[np.ndarray, "p n2"], Float[np.ndarray, "p m"]]:
    """Return A, B, C, D of an order from the impulse response ``Y_0, Y_1, …``.

    Paper: Eq. (7), (8).

    Args:
        markov: Markov parameters (steps, outputs, inputs).
        order: Number of states.
        rows: Block rows of the Hankel matrix; half of the steps when left out.

    Raises:
        RecordError: If the response has the wrong shape, or is too short for the rows.
        SettingsError: If order or rows is not an integer, at least 1.
        PoorExcitation: If the order is above the rank of the response.
    """
    markov = shaped("markov", markov, (None, None, None), "(steps, outputs, inputs): a matrix per step")
    if not np.isfinite(markov).all():
        raise NotFinite("markov holds NaN or Inf; cut the response before the first such step")
    check_integers(order=order, rows=rows)
    block = (len(markov) - 1) // 2 if rows is None else rows
    if not 0 < block < len(markov) - 1:
        raise ShapeMismatch(f"markov has {len(markov)} steps; {max(block, 1)} block rows need at least {max(block, 1) + 2}")
    A, B, C = realise(HankelSvd(markov=markov, rows=block, columns=len(markov) - 1 - block), order)
    return A, B, C, markov[0].copy()
