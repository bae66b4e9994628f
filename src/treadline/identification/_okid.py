"""OKID: the system's impulse response from arbitrary inputs and outputs, by an observer.

Paper: Section IV, Eq. (9). The printed Eq. (9c) is ill-conditioned in practice (see ``deconvolution``); with an observer of
p lags the regression is short and well posed (Juang, Phan, Horta, Longman, 1993). The first p samples of each experiment,
whose past is unknown, are not used as regression targets.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from treadline.identification._factor import solved
from treadline.identification._gram import Gram
from treadline.identification._limits import ROUNDING
from treadline.identification._recursion_kernels import unroll


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObserverMarkov:
    """Observer coefficients y_k = bias + D u_k + Σ (α_i u_{k-i} + β_i y_{k-i}) + e_k."""

    bias: Float[np.ndarray, " p"]
    D: Float[np.ndarray, "p m"]
    alpha: Float[np.ndarray, "lags p m"]
    beta: Float[np.ndarray, "lags p p"]
    residual_covariance: Float[np.ndarray, "p p"]
    information: Float[np.ndarray, "q q"]
    """Gram matrix of the scaled regressors."""
    count: float
    feedthrough: bool

    def draws(self, count: int) -> Iterator["ObserverMarkov"]:
        """Yield the observer, in standard deviations, with draws of its estimation errors added."""
        lags, p, m = self.alpha.shape
        rng = np.random.default_rng(0)
        # The coefficients' covariance is the inverse Gram matrix times the residual covariance.
        size = np.diag(self.information)
        root = np.linalg.cholesky(self.information + ROUNDING * len(size) * np.diag(size))  # rounding grows with the size
        variances, W = np.linalg.eigh(self.residual_covariance)
        white = rng.standard_normal((count, len(root), p)) * np.sqrt(np.maximum(variances, 0.0)) @ W.T
        first = len(root) - lags * (m + p)
        for one in white:
            errors = solve_triangular(root, one, lower=True, trans="T", check_finite=False)
            lagged = errors[first:].reshape(lags, m + p, p).transpose(0, 2, 1)
            D = self.D + errors[1:first].T if self.feedthrough else self.D
            yield replace(self, D=D, alpha=self.alpha + lagged[:, :, :m], beta=self.beta + lagged[:, :, m:])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regression:
    """Least-squares regression of y_k on X = [1, u_k, z_{k-1}, …, z_{k-p}], with or without u_k."""

    theta: Float[np.ndarray, "q p"]
    squares: Float[np.ndarray, "p p"]
    """Residual sums of products of the outputs."""
    information: Float[np.ndarray, "q q"]
    """Gram matrix X'X of the regressors."""


def regression(data: Gram, lags: int, *, feedthrough: bool) -> Regression:
    """Return the regression on ``lags`` past samples, with or without the column of u_k."""
    m, r = data.units.input_count, len(data.units.scale)
    columns = np.concatenate([np.arange(1 + m if feedthrough else 1), np.arange(1 + r, 1 + r * (lags + 1))])
    at = data.sums[columns]
    XX, XY, YY = at[:, columns], at[:, 1 + m : 1 + r], data.sums[1 + m : 1 + r, 1 + m : 1 + r]
    if data.root is not None:
        theta, squares = _by_root(data.root[:, np.concatenate([columns, np.arange(1 + m, 1 + r)])], len(columns))
        return Regression(theta=theta, squares=squares, information=XX)
    theta = solved(XX, XY)
    return Regression(theta=theta, squares=YY - theta.T @ XY, information=XX)


def _by_root(columns: Float[np.ndarray, "_ w"], q: int) -> tuple[Float[np.ndarray, "q p"], Float[np.ndarray, "p p"]]:
    """Return coefficients and residual sums of products by QR; the last columns are the outputs."""
    root = np.asarray(np.linalg.qr(columns, mode="r"))
    root = np.vstack([root, np.zeros((columns.shape[1] - len(root), columns.shape[1]))])
    R, target = root[:q, :q], root[:q, q:]
    theta = np.linalg.lstsq(R, target, rcond=ROUNDING)[0]
    residual = np.vstack([target - R @ theta, root[q:, q:]])
    return theta, residual.T @ residual


def residuals_by_lags(data: Gram, lags: range, kinds: Sequence[bool]) -> Float[np.ndarray, "kinds P p p"]:
    """Return the residual sums of squares per number of lags, without and with u_k, from one factorisation if possible."""
    quick = range(lags.start, min(lags.stop, data.factor.lags + 1))
    if quick == lags or not quick:
        both, excited = data.factor.residuals(lags) if quick else (None, np.zeros(0, dtype=bool))
        if both is not None and excited.all():
            return both[np.array(kinds, dtype=int)]
    return np.array([[regression(data, p, feedthrough=has_d).squares for p in lags] for has_d in kinds])


def observer_markov(data: Gram, *, feedthrough: bool = True) -> ObserverMarkov:
    """Return the observer's Markov parameters by least squares, in the record's units.

    Paper: Eq. (9a), (9b).

    Args:
        data: Gram matrix of the records; all its lags are used.
        feedthrough: Whether to include D.
    """
    scaled, units = scaled_observer(data, data.lags, feedthrough=feedthrough), data.units
    m, into, out = units.input_count, units.input_scale, units.output_scale
    D = scaled.D * out[:, None] / into
    alpha, beta = scaled.alpha * out[:, None] / into, scaled.beta * out[:, None] / out
    u0, y0 = units.shift[:m], units.shift[m:]
    return replace(
        scaled,
        bias=scaled.bias * out + y0 - beta.sum(axis=0) @ y0 - (D + alpha.sum(axis=0)) @ u0,
        D=D,
        alpha=alpha,
        beta=beta,
        residual_covariance=scaled.residual_covariance * np.outer(out, out),
    )


def scaled_observer(data: Gram, lags: int, *, feedthrough: bool) -> ObserverMarkov:
    """Return the observer's Markov parameters in standard deviations, about the means (see ``observer_markov``)."""
    found = regression(data, lags, feedthrough=feedthrough)
    m, r = data.units.input_count, len(data.units.scale)
    p = r - m
    first = 1 + (m if feedthrough else 0)
    lagged = found.theta[first:].reshape(lags, r, p).transpose(0, 2, 1)
    return ObserverMarkov(
        bias=found.theta[0],
        D=np.ascontiguousarray(found.theta[1:first].T) if feedthrough else np.zeros((p, m)),
        alpha=np.ascontiguousarray(lagged[:, :, :m]),
        beta=np.ascontiguousarray(lagged[:, :, m:]),
        residual_covariance=0.5 * (found.squares + found.squares.T) / max(data.count - len(found.theta), 1.0),
        information=found.information,
        count=data.count,
        feedthrough=feedthrough,
    )


def system_markov(observer: ObserverMarkov, count: int) -> Float[np.ndarray, "count p m"]:
    """Return the system's Markov parameters Y_0 = D, Y_k = C A^(k-1) B.

    Paper: Eq. (7). The recursion Y_k = α_k + Σ β_i Y_{k-i} converts observer to system Markov parameters.
    """
    return np.asarray(unroll(observer.D, observer.alpha, observer.beta, count))
