"""ERA: from an impulse response to a state-space model.

Paper: Section IV, Eq. (7), (8). Juang and Pappa, 1985. The Hankel matrix holds the system's Markov parameters alone;
an observer gain's do not belong there (they cost two digits on Eq. (12)).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.errors import PoorExcitation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HankelSvd:
    """H = U diag(s) V', and the shifted H'."""

    U: Float[np.ndarray, "a k"]
    s: Float[np.ndarray, " k"]
    Vt: Float[np.ndarray, "k b"]
    shifted: Float[np.ndarray, "a b"]

    @property
    def matrix(self) -> Float[np.ndarray, "a b"]:
        """H itself."""
        return np.asarray((self.U * self.s) @ self.Vt)


def hankel(markov: Float[np.ndarray, "n p m"], rows: int, columns: int, shift: int) -> Float[np.ndarray, "a b"]:
    """Return the block Hankel matrix whose first block is ``Y_{1 + shift}``.

    Paper: Eq. (8a) with shift 0, Eq. (8b) with shift 1.
    """
    return np.block([[markov[1 + shift + i + j] for j in range(columns)] for i in range(rows)])


def hankel_svd(
    markov: Float[np.ndarray, "n p m"],
    rows: int,
    columns: int,
    input_scale: Float[np.ndarray, " m"],
    output_scale: Float[np.ndarray, " p"],
) -> HankelSvd:
    """Return the singular value decomposition of H, channels scaled to unit deviation.

    Scaled, a singular value says how much of what was measured a state explains; unscaled, it depends on units.
    """
    scaled = markov * input_scale / output_scale[:, None]
    H = hankel(scaled, rows, columns, 0)
    U, s, Vt = np.linalg.svd(H, full_matrices=False)
    return HankelSvd(U=U, s=s, Vt=Vt, shifted=hankel(scaled, rows, columns, 1))


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
