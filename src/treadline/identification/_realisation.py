"""State-space model from OKID's observer: by its Hankel matrix (ERA), or by PBSID_opt.

ERA realises the observer's Markov parameters, with an operating point and an innovation gain.

PBSID_opt (Chiuso, 2007) takes the states from the observer's Markov parameters and the past, without a second pass over the data.
OKID's long regression predicts each future output from the past; the stacked predictions equal the predictor's observability
matrix times the state. Weighted with the covariance of the past, the leading singular directions give the state as a linear
function of the past; A, B, C, D and K follow by regression. All moments are in the Gram matrix. Closed-loop data are allowed
because feedback acts through the past.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.arrays import observability, spectral_radius
from treadline.core.errors import PoorExcitation
from treadline.identification._affine import Affine
from treadline.identification._era import RANK_MOST, HankelSvd, realise
from treadline.identification._factor import solved
from treadline.identification._gram import Gram
from treadline.identification._okid import ObserverMarkov, system_markov
from treadline.identification._recursion_kernels import unroll

BLOCKS_LEAST = 8
"""Smallest number of block rows: two seconds at 4 Hz, enough to separate an integrator from a lag."""


def markov_svd(observer: ObserverMarkov, order: int | None) -> HankelSvd:
    """Return the decomposed Hankel matrix of the observer's system, large enough for an order."""
    lags, p, m = observer.alpha.shape
    blocks = max(lags, BLOCKS_LEAST, -(-((order or 1) + 1) // min(m, p)))
    markov = system_markov(observer, 2 * blocks + 1)
    return HankelSvd(markov=markov, rows=blocks, columns=blocks, rank=max((order or 0) + 1, RANK_MOST))


def realised(observer: ObserverMarkov, svd: HankelSvd, order: int) -> Affine:
    """Return the model of an order by ERA.

    Args:
        observer: OKID observer in standard deviations.
        svd: Its decomposed Hankel matrix.
        order: Number of states.

    Raises:
        PoorExcitation: If the order is above the rank of the data.
    """
    A, B, C = realise(svd, order)
    # At the observer's equilibrium C x = 0, so the offsets enter through the last column of D only.
    u0, y0 = _rest(observer)
    return Affine(
        A=A,
        B=np.column_stack([B, -B @ u0]),
        C=C,
        D=np.column_stack([observer.D, y0 - observer.D @ u0]),
        K=observer_gain(A, C, observer),
    )


def _rest(observer: ObserverMarkov) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " p"]]:
    """Return the equilibrium (input, output) of the observer nearest to the means.

    (I - Σβ) y₀ - (D + Σα) u₀ = bias. If an integrator leaves y₀ undetermined, u₀ absorbs the offset: a chair with a fast right
    belt stands still at unequal belt speeds. Distances are in standard deviations, an input's weighted by three.
    """
    M = np.eye(len(observer.bias)) - observer.beta.sum(axis=0)
    N = observer.D + observer.alpha.sum(axis=0)
    G = np.hstack([M, -N / 3.0])
    change = np.linalg.lstsq(G, observer.bias, rcond=1e-13)[0]
    p = len(observer.bias)
    return change[p:] / 3.0, change[:p]


def observer_gain(
    A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "p n"], observer: ObserverMarkov
) -> Float[np.ndarray, "n p"] | None:
    """Return the innovation gain with the same innovation response as OKID's observer, for the given A and C."""
    lags, p, _ = observer.beta.shape
    steps = max(lags, A.shape[0]) + 1
    # Response of the outputs to an innovation: I, CK, CAK, ….
    response = unroll(np.eye(p), np.zeros_like(observer.beta), observer.beta, steps)
    O = observability(A, C, steps - 1).reshape(-1, A.shape[0])
    gain = np.linalg.lstsq(O, response[1:].reshape(-1, p), rcond=None)[0]
    return np.asarray(gain) if spectral_radius(A - gain @ C) < 1.0 else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateMap:
    """Directions of the past that predict the future, in descending order of their singular value."""

    s: Float[np.ndarray, " k"]
    rows: Float[np.ndarray, "k q"]
    """State map x = rows @ [z_{k-1}, …, z_{k-p}], each state with variance s."""


def state_map(data: Gram, lags: int, theta: Float[np.ndarray, "q p"]) -> StateMap:
    """Return the linear map from the past to the state.

    Args:
        data: Gram matrix.
        lags: Number of lags of the regression.
        theta: Coefficients of the outputs' regression on the past; the lagged ones are its last rows.
    """
    r = len(data.units.scale)
    p = r - data.units.input_count
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
    """Return the innovations' sums of products for orders 1, 2, … ``most``: residuals of y_k after regression on [x_k, u_k, 1]."""
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
    return np.asarray(residual_ss[len(now) :])


def pbsid(data: Gram, states: StateMap, order: int, lags: int, *, feedthrough: bool) -> Affine:
    """Return the model of an order in the units of the Gram matrix.

    Raises:
        PoorExcitation: If the order is above the rank of the state map.
    """
    if order > len(states.s):
        rank = len(states.s)
        raise PoorExcitation(f"order {order} is above the rank {rank} that {lags} lags show; ask for {rank} or less")
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
    CD[:, seen] = solved(sums[np.ix_(seen, seen)], sums[seen, y]).T
    # The innovation e = y - [C D c][x u 1] as an additional row.
    change = np.eye(len(sums))
    change[y, into] = -CD
    sums = change @ sums @ change.T
    both = slice(0, n + m + 1 + p)
    AB = solved(sums[both, both], sums[both, following]).T
    return Affine(A=AB[:, :n], B=AB[:, n : n + m + 1], C=CD[:, :n], D=CD[:, n:], K=AB[:, n + m + 1 :])
