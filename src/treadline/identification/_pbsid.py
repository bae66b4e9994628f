"""PBSID_opt: states from the observer's Markov parameters and the past, without a second pass over the data.

Chiuso, 2007. OKID's long regression predicts each future output from the past; the stacked predictions equal the
predictor's observability matrix times the state. Weighted with the covariance of the past, the leading singular directions
give the state as a linear function of the past; A, B, C, D and K follow by regression. All moments are in the Gram matrix.
Closed-loop data are allowed because feedback acts through the past.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.identification._affine import Affine
from treadline.identification._factor import solution
from treadline.identification.gram import Gram
from treadline.identification.okid import regression


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateMap:
    """Directions of the past that predict the future, in descending order of their singular value."""

    s: Float[np.ndarray, " k"]
    rows: Float[np.ndarray, "k q"]
    """State map x = rows @ [z_{k-1}, …, z_{k-p}], each state with variance s."""


def state_map(data: Gram, lags: int, *, feedthrough: bool) -> StateMap:
    """Return the linear map from the past to the state."""
    m, r = data.units.input_count, len(data.units.scale)
    p = r - m
    theta = regression(data, lags, feedthrough=feedthrough).theta
    first = len(theta) - lags * r
    response = theta[first:].reshape(lags, r, p).transpose(0, 2, 1)
    padded = np.concatenate([response, np.zeros_like(response)])
    future = np.arange(lags)[:, None] + np.arange(lags)
    predictor = padded[future].transpose(0, 2, 1, 3).reshape(lags * p, lags * r)
    past = slice(1 + r, 1 + r * (lags + 1))
    mean = data.sums[0, past]
    covariance = (data.sums[past, past] - np.outer(mean, mean) / data.count) / data.count
    covariance_of_predictions = predictor @ covariance @ predictor.T
    values, U = np.linalg.eigh(0.5 * (covariance_of_predictions + covariance_of_predictions.T))
    # Rounding leaves 1e-16 of the largest squared singular value.
    kept = values[::-1] > 1e-14 * values[-1]
    s = np.sqrt(np.maximum(values[::-1], 0.0))
    return StateMap(s=s[kept], rows=(U[:, ::-1][:, kept] / np.sqrt(s[kept])).T @ predictor)


def innovations(data: Gram, states: StateMap, most: int, lags: int, *, feedthrough: bool) -> Float[np.ndarray, "n p p"]:
    """Return the innovation covariance for orders 1, 2, … ``most``: the residual of y_k after regression on [x_k, u_k, 1]."""
    m, r = data.units.input_count, len(data.units.scale)
    now = np.eye(1 + r)[: 1 + m if feedthrough else 1]
    rows = np.zeros((len(now) + most + r - m, 1 + r * (lags + 1)))
    rows[: len(now), : 1 + r] = now
    rows[len(now) : len(now) + most, 1 + r :] = states.rows[:most]
    rows[len(now) + most :, 1 + m : 1 + r] = np.eye(r - m)
    sums = rows @ data.sums[: rows.shape[1], : rows.shape[1]] @ rows.T
    q = len(now) + most
    # The factor for fewer states is the leading block; the ridge covers states with little variance.
    L = np.linalg.cholesky(sums[:q, :q] + 1e-13 * np.diag(np.diag(sums)[:q]))
    explained = np.linalg.solve(L, sums[:q, q:])
    residual_ss = sums[q:, q:] - np.cumsum(explained[:, :, None] * explained[:, None, :], axis=0)
    return np.asarray(residual_ss[len(now) :] / data.count)


def pbsid(data: Gram, states: StateMap, order: int, lags: int, *, feedthrough: bool) -> Affine:
    """Return the model of an order in the units of the Gram matrix."""
    m, r = data.units.input_count, len(data.units.scale)
    p, n = r - m, order
    T = states.rows[:n]
    width = 1 + r * (lags + 1)
    # Rows: x_k, u_k, 1 | y_k | x_{k+1}, each as a linear function of the window.
    select = np.zeros((n + m + 1 + p + n, width))
    select[:n, 1 + r :] = T
    select[n : n + m, 1 : 1 + m] = np.eye(m)
    select[n + m, 0] = 1.0
    select[n + m + 1 : n + m + 1 + p, 1 + m : 1 + r] = np.eye(p)
    select[n + m + 1 + p :, 1 : 1 + r * lags] = T
    sums = select @ data.sums[:width, :width] @ select.T
    y, following = slice(n + m + 1, n + m + 1 + p), slice(n + m + 1 + p, None)
    into = np.arange(n + m + 1)
    seen = into if feedthrough else np.delete(into, np.arange(n, n + m))
    CD = np.zeros((p, n + m + 1))
    CD[:, seen] = solution(sums[np.ix_(seen, seen)], sums[seen, y]).T
    # The innovation e = y - [C D c][x u 1] as an additional row.
    change = np.eye(len(sums))
    change[y, into] = -CD
    sums = change @ sums @ change.T
    both = slice(0, n + m + 1 + p)
    AB = solution(sums[both, both], sums[both, following]).T
    return Affine(A=AB[:, :n], B=AB[:, n : n + m + 1], C=CD[:, :n], D=CD[:, n:], K=AB[:, n + m + 1 :])
