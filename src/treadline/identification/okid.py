"""OKID: from any inputs and outputs to the system's impulse response, by way of an observer.

Paper: Section IV, Eq. (9). The printed Eq. (9c) has no solution in practice (see ``deconvolution``); with an observer
of p lags the regression is short and well posed (Juang, Phan, Horta, Longman, 1993). The first p samples of each
experiment, whose past is unknown, are targets of no row.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import lapack, solve_triangular

from treadline.identification.gram import Gram, Units
from treadline.identification.kernels import unroll

RIDGE = 1e-13
"""Relative eigenvalue below which a direction of the regressors counts as not excited."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObserverMarkov:
    """y_k = bias + D u_k + Σ (α_i u_{k-i} + β_i y_{k-i}) + e_k, in the record's units."""

    bias: Float[np.ndarray, " p"]
    D: Float[np.ndarray, "p m"]
    alpha: Float[np.ndarray, "lags p m"]
    beta: Float[np.ndarray, "lags p p"]
    residual_covariance: Float[np.ndarray, "p p"]
    information: Float[np.ndarray, "q q"]
    """Sums of products of the scaled regressors."""
    count: float
    units: Units
    feedthrough: bool

    @property
    def parameter_covariance(self) -> Float[np.ndarray, "q q"]:
        """Covariance of one output's scaled coefficients per unit of its residual variance."""
        return inverse(self.information)

    def scaled(self) -> "ObserverMarkov":
        """Return the observer in units of deviations, about the means."""
        into, out, m = self.units.input_scale, self.units.output_scale, self.units.input_count
        u0, y0 = self.units.shift[:m], self.units.shift[m:]
        bias = self.bias - y0 + self.beta.sum(axis=0) @ y0 + (self.D + self.alpha.sum(axis=0)) @ u0
        ones = Units(shift=np.zeros_like(self.units.shift), scale=np.ones_like(self.units.scale), input_count=m)
        return replace(
            self,
            bias=bias / out,
            D=self.D * into / out[:, None],
            alpha=self.alpha * into / out[:, None],
            beta=self.beta * out / out[:, None],
            residual_covariance=self.residual_covariance / np.outer(out, out),
            units=ones,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regression:
    """Sums of regressors X = [1, u_k, z_{k-1}, …, z_{k-p}] and of targets Y = y_k."""

    XX: Float[np.ndarray, "q q"]
    XY: Float[np.ndarray, "q p"]
    YY: Float[np.ndarray, "p p"]
    root: Float[np.ndarray, "w w"] | None

    def solve(self) -> tuple[Float[np.ndarray, "q p"], Float[np.ndarray, "p p"]]:
        """Return the coefficients and the residual sum of squares."""
        if self.root is None:
            theta = solve_normal(self.XX, self.XY)
            return theta, self.YY - theta.T @ self.XY
        q = len(self.XX)
        R, target = self.root[:q, :q], self.root[:q, q:]
        theta = np.linalg.lstsq(R, target, rcond=RIDGE)[0]
        misfit = np.vstack([target - R @ theta, self.root[q:, q:]])
        return theta, misfit.T @ misfit


def regression(data: Gram, lags: int, *, feedthrough: bool) -> Regression:
    """Return the sums that a regression of fewer lags needs, with or without the column of u_k."""
    m, r = data.units.input_count, len(data.units.scale)
    target = np.arange(1 + m, 1 + r)
    columns = np.concatenate([np.arange(1 + m if feedthrough else 1), np.arange(1 + r, 1 + r * (lags + 1))])
    root: Float[np.ndarray, ...] | None = None
    if data.root is not None:
        root = np.asarray(np.linalg.qr(data.root[:, np.concatenate([columns, target])], mode="r"))
        missing = columns.size + target.size - len(root)
        root = np.vstack([root, np.zeros((missing, root.shape[1]))])
    at = data.sums[columns]
    return Regression(XX=at[:, columns], XY=at[:, target], YY=data.sums[1 + m : 1 + r, 1 + m : 1 + r], root=root)


def solve_normal(XX: Float[np.ndarray, "q q"], XY: Float[np.ndarray, "q p"]) -> Float[np.ndarray, "q p"]:
    """Return the least-squares solution: by Cholesky where the regressors are well excited, else by eigenvalues."""
    factor = _factor(XX)
    if factor is None:
        return inverse(XX) @ XY
    theta, _ = lapack.dpotrs(factor, XY, lower=1)
    # One step of refinement wins back the digits that squaring the condition lost.
    return np.asarray(theta + lapack.dpotrs(factor, XY - XX @ theta, lower=1)[0])


def inverse(XX: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"]:
    """Return the inverse of a normal matrix; directions that nothing excites count for nothing."""
    factor = _factor(XX)
    if factor is not None:
        lower = np.tril(lapack.dpotri(factor, lower=1)[0])
        return lower + np.tril(lower, -1).T
    values, vectors = np.linalg.eigh(XX)
    kept = values > RIDGE * values[-1]
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)


def _factor(XX: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"] | None:
    """Return the Cholesky factor, or None where a direction is not excited."""
    factor, failed = lapack.dpotrf(XX, lower=1, clean=0)
    diagonal = np.diag(factor)
    return None if failed or diagonal.min() <= np.sqrt(RIDGE) * diagonal.max() else factor


def residuals_by_lags(data: Gram, *, feedthrough: bool) -> Float[np.ndarray, "lags p p"] | None:
    """Return the residual sums of squares for 1, 2, … lags, by one factorisation; None where it fails.

    The factor of fewer lags is the leading block of the factor of all.
    """
    whole = regression(data, data.lags, feedthrough=feedthrough)
    L = _factor(whole.XX)
    if L is None:
        return None
    explained = solve_triangular(L, whole.XY, lower=True, check_finite=False)
    squares = np.cumsum(explained[:, :, None] * explained[:, None, :], axis=0)
    r = len(data.units.scale)
    first = len(whole.XX) - r * data.lags
    return np.asarray(whole.YY - squares[first + r - 1 :: r])


def residuals_by_feedthrough(data: Gram, lags: int) -> Float[np.ndarray, "2 p p"] | None:
    """Return the residual sums of squares without and with u_k, by one factorisation; None where it fails."""
    whole = regression(data, lags, feedthrough=True)
    m = data.units.input_count
    last = np.concatenate([[0], np.arange(1 + m, len(whole.XX)), np.arange(1, 1 + m)])
    L = _factor(whole.XX[np.ix_(last, last)])
    if L is None:
        return None
    explained = solve_triangular(L, whole.XY[last], lower=True, check_finite=False)
    without = whole.YY - explained[:-m].T @ explained[:-m]
    return np.stack([without, without - explained[-m:].T @ explained[-m:]])


def observer_markov(data: Gram, lags: int | None = None, *, feedthrough: bool = True) -> ObserverMarkov:
    """Return the observer's Markov parameters that fit the data best.

    Paper: Eq. (9a), (9b).

    Args:
        lags: At most those of the sums; all of them when left out.
    """
    lags = data.lags if lags is None else lags
    equations = regression(data, lags, feedthrough=feedthrough)
    theta, squares = equations.solve()
    units = data.units
    m = units.input_count
    into, out = units.input_scale, units.output_scale
    p = out.size
    first = 1 + (m if feedthrough else 0)
    coefficients = theta.T * out[:, None]
    D = coefficients[:, 1:first] / into if feedthrough else np.zeros((p, m))
    lagged = coefficients[:, first:].reshape(p, lags, m + p).transpose(1, 0, 2) / units.scale
    alpha, beta = np.ascontiguousarray(lagged[:, :, :m]), np.ascontiguousarray(lagged[:, :, m:])
    u0, y0 = units.shift[:m], units.shift[m:]
    freedom = max(data.count - theta.shape[0], 1.0)
    return ObserverMarkov(
        bias=coefficients[:, 0] + y0 - beta.sum(axis=0) @ y0 - (D + alpha.sum(axis=0)) @ u0,
        D=D,
        alpha=alpha,
        beta=beta,
        residual_covariance=0.5 * (squares + squares.T) / freedom * np.outer(out, out),
        information=equations.XX,
        count=data.count,
        units=units,
        feedthrough=feedthrough,
    )


def system_markov(observer: ObserverMarkov, count: int) -> Float[np.ndarray, "count p m"]:
    """Return the system's Markov parameters Y_0 = D, Y_k = C A^(k-1) B.

    Paper: Eq. (7). The recursion Y_k = α_k + Σ β_i Y_{k-i} takes the observer out again.
    """
    return np.asarray(unroll(observer.D, observer.alpha, observer.beta, count))
