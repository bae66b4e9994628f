"""Cholesky factor shared by the regressions of all lags, with and without direct feedthrough.

The Gram matrix of the past ``[1, z_{k-1}, …, z_{k-P}]`` is LL'; the factor for fewer lags is the leading block of L. The
Schur complement of ``z_k z_k'`` separates the predictable part of outputs and inputs, so a regression with u_k follows
from the regression without u_k by a small update (Frisch and Waugh, 1933).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Num
from scipy.linalg import lapack

from treadline.identification._limits import ROUNDING


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factor:
    """Products with the Cholesky factor L of the past, for r channels of which the first m are inputs."""

    m: int
    lags: int
    """Largest number of lags with well-excited regressors."""
    predicted: Float[np.ndarray, "w r"]
    """Projection of z_k on the past: L⁻¹X'z_k."""
    now: Float[np.ndarray, "r r"]
    """Gram matrix of the current sample: sum of z_k z_k'."""

    @classmethod
    def of(cls, sums: Float[np.ndarray, "q q"], m: int, r: int) -> "Factor":
        """Return the factor of a Gram matrix of windows ``[1, z_k, z_{k-1}, …]``."""
        past = np.concatenate([[0], np.arange(1 + r, len(sums))])
        rows = sums[past]
        # The matrix is symmetric, so the transpose gives LAPACK its column order without a copy.
        L, failed = lapack.dpotrf(rows[:, past].T, lower=1, clean=0, overwrite_a=1)
        pivots = np.diag(L)[: failed - 1 if failed > 0 else None]
        # Late pivots may be rounding residue: only the lags before the first such pivot are kept.
        sound = np.minimum.accumulate(pivots) > np.sqrt(ROUNDING) * np.maximum.accumulate(pivots)
        stand = len(sound) if sound.all() else int(np.argmin(sound))
        width = 1 + r * max((stand - 1) // r, 0)
        predicted = lapack.dtrtrs(np.asfortranarray(L[:width, :width]), rows[:width, 1 : 1 + r], lower=1)[0]
        return cls(m=m, lags=width // r, predicted=predicted, now=sums[1 : 1 + r, 1 : 1 + r])

    def residuals(self, lags: range) -> tuple[Float[np.ndarray, "2 P p p"], Bool[np.ndarray, " P"]]:
        """Return the outputs' residual sums of squares without and with u_k, and whether u_k is excited beyond its past."""
        m, r = self.m, len(self.now)
        if len(lags) == 1:
            seen = self.predicted[: 1 + r * lags[0]]
            residual_ss = (self.now - seen.T @ seen)[None]
        else:
            squares = np.cumsum(self.predicted[:, :, None] * self.predicted[:, None, :], axis=0)
            residual_ss = self.now - squares[[r * p for p in lags]]
        excited = np.linalg.eigvalsh(residual_ss[:, :m, :m])[:, 0] > ROUNDING * self.now[0, 0]
        residual_ss[~excited, :m, :m] = np.eye(m)
        without = residual_ss[:, m:, m:]
        return np.stack(
            [without, without - residual_ss[:, m:, :m] @ np.linalg.solve(residual_ss[:, :m, :m], residual_ss[:, :m, m:])]
        ), excited


def solved(XX: Num[np.ndarray, "q q"], XY: Num[np.ndarray, "q p"]) -> Num[np.ndarray, "q p"]:
    """Return the least-squares solution of normal equations; directions that are not excited get zero coefficients.

    Args:
        XX: Real or complex normal matrix.
        XY: Right-hand sides.
    """
    size = np.sqrt(np.maximum(np.diag(XX).real, 0.0))
    scale = np.where(size > 1e-12 * size.max(initial=0.0), 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    A, right = XX * scale[:, None] * scale, XY * scale[:, None]
    potrf, potrs = (lapack.zpotrf, lapack.zpotrs) if np.iscomplexobj(XX) else (lapack.dpotrf, lapack.dpotrs)
    L, failed = potrf(A, lower=1, clean=0)
    if not failed and np.diag(L).real.min(initial=1.0) ** 2 > ROUNDING:
        theta = potrs(L, right, lower=1)[0]
        # One pass of iterative refinement: the normal equations square the condition.
        theta = theta + potrs(L, right - A @ theta, lower=1)[0]
    elif not np.isfinite(A).all():
        return np.full(XY.shape, np.nan)
    else:
        values, V = np.linalg.eigh(A)
        kept = values > ROUNDING * values[-1]
        theta = (V[:, kept] / values[kept]) @ (V[:, kept].conj().T @ right)
    return np.asarray(theta * scale[:, None])


def inverse(XX: Num[np.ndarray, "q q"]) -> Num[np.ndarray, "q q"]:
    """Return the inverse of a normal matrix; directions that are not excited are left out."""
    return solved(XX, np.eye(len(XX), dtype=XX.dtype))
