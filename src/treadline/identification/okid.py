"""OKID: from any inputs and outputs to the system's impulse response, by way of an observer.

Paper: Section IV, Eq. (9). The printed Eq. (9c) has no solution in practice (see ``deconvolution``); with an observer
of p lags the regression is short and well posed (Juang, Phan, Horta, Longman, 1993). The first p samples of each
experiment, whose past is unknown, are targets of no row.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from treadline.identification.gram import Gram

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
    parameter_covariance: Float[np.ndarray, "q q"]
    """Of one output's scaled coefficients per unit of its residual variance."""
    count: int


def solve_normal(
    XX: Float[np.ndarray, "q q"], XY: Float[np.ndarray, "q p"]
) -> tuple[Float[np.ndarray, "q p"], Float[np.ndarray, "q q"]]:
    """Return the least-squares solution and the inverse of the normal matrix.

    Cholesky where the regressors are well excited; a truncated eigendecomposition where they are not.
    """
    try:
        factor = cho_factor(XX)
        diagonal = np.abs(np.diag(factor[0]))
        if diagonal.min() > np.sqrt(RIDGE) * diagonal.max():
            inverse = cho_solve(factor, np.eye(len(XX)))
            theta = cho_solve(factor, XY)
            # One step of refinement wins back the digits that squaring the condition lost.
            return theta + cho_solve(factor, XY - XX @ theta), inverse
    except LinAlgError:
        pass
    values, vectors = np.linalg.eigh(XX)
    kept = values > RIDGE * values[-1]
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return inverse @ XY, inverse


def observer_markov(data: Gram) -> ObserverMarkov:
    """Return the observer's Markov parameters that fit the data best.

    Paper: Eq. (9a), (9b).
    """
    theta, inverse = solve_normal(data.XX, data.XY)
    m, p = data.input_scale.size, data.output_scale.size
    residual = data.YY - theta.T @ data.XY
    freedom = max(data.count - theta.shape[0], 1)
    out, into = data.output_scale, data.input_scale
    coefficients = theta.T * out[:, None]
    first = 1 + (m if data.feedthrough else 0)
    D = coefficients[:, 1:first] / into if data.feedthrough else np.zeros((p, m))
    lagged = coefficients[:, first:].reshape(p, data.lags, m + p)
    return ObserverMarkov(
        bias=coefficients[:, 0],
        D=D,
        alpha=np.ascontiguousarray(np.moveaxis(lagged[:, :, :m], 1, 0)) / into,
        beta=np.ascontiguousarray(np.moveaxis(lagged[:, :, m:], 1, 0)) / out,
        residual_covariance=0.5 * (residual + residual.T) / freedom * np.outer(out, out),
        parameter_covariance=inverse,
        count=data.count,
    )


def system_markov(observer: ObserverMarkov, count: int) -> Float[np.ndarray, "count p m"]:
    """Return the system's Markov parameters Y_0 = D, Y_k = C A^(k-1) B.

    Paper: Eq. (7). The recursion Y_k = α_k + Σ β_i Y_{k-i} takes the observer out again.
    """
    lags, p, m = observer.alpha.shape
    Y = np.zeros((count, p, m))
    Y[0] = observer.D
    for k in range(1, count):
        if k <= lags:
            Y[k] = observer.alpha[k - 1]
        for i in range(1, min(k, lags) + 1):
            Y[k] += observer.beta[i - 1] @ Y[k - i]
    return Y
