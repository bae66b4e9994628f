"""Realisation of OKID's observer: Hankel matrix, state-space model, operating point and innovation gain."""

import numpy as np
from jaxtyping import Float

from treadline.identification._affine import Affine
from treadline.identification._recursion_kernels import observability, unroll
from treadline.identification.era import HankelSvd, correlated_svd, hankel_svd, realise, realise_correlated
from treadline.identification.okid import ObserverMarkov, system_markov

BLOCKS_LEAST = 8
"""Smallest number of block rows: two seconds at 4 Hz, enough to separate an integrator from a lag."""


def block_rows(observer: ObserverMarkov, order: int | None) -> int:
    """Return the number of block rows needed for the observer and an order."""
    lags, p, m = observer.alpha.shape
    return max(lags, BLOCKS_LEAST, -(-((order or 1) + 1) // min(m, p)))


def markov_svd(observer: ObserverMarkov, order: int | None) -> HankelSvd:
    """Return the decomposed Hankel matrix of the observer's system, large enough for an order."""
    blocks = block_rows(observer, order)
    units = observer.units
    markov = system_markov(observer, 2 * blocks + 1)
    return hankel_svd(markov, blocks, blocks, units.input_scale, units.output_scale, rank=(order or 0) + 1)


def realised(observer: ObserverMarkov, svd: HankelSvd, order: int, *, correlated: bool = False) -> Affine:
    """Return the model of an order by ERA or, with ``correlated``, by ERA/DC.

    Args:
        observer: OKID observer in standard deviations.
        svd: Its decomposed Hankel matrix.
        order: Number of states.
        correlated: Whether to use data correlations.

    Raises:
        PoorExcitation: If the order is above the rank of the data.
    """
    p, m = observer.D.shape
    A, B, C = realise(svd, order, np.ones(m), np.ones(p))
    if correlated:
        A, B, C = _by_correlations(observer, svd, order)
    # At the observer's equilibrium C x = 0, so the offsets enter through the last column of D only.
    u0, y0 = _rest(observer)
    return Affine(
        A=A,
        B=np.column_stack([B, -B @ u0]),
        C=C,
        D=np.column_stack([observer.D, y0 - observer.D @ u0]),
        K=observer_gain(A, C, observer),
    )


def _by_correlations(
    observer: ObserverMarkov, svd: HankelSvd, order: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"]]:
    _, correlated = correlations(observer, svd)
    return realise_correlated(correlated, svd.matrix, order, *observer.D.shape)


def correlations(observer: ObserverMarkov, svd: HankelSvd) -> tuple[Float[np.ndarray, "count p m"], HankelSvd]:
    """Return the Markov parameters for ERA/DC and its decomposition, with half as many shifts as block rows."""
    shifts = svd.rows // 2
    markov = system_markov(observer, 2 * svd.rows + 2 * shifts + 2)
    return markov, correlated_svd(markov, svd.rows, svd.columns, shifts)


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
    O = observability(np.ascontiguousarray(A), np.ascontiguousarray(C), steps - 1).reshape(-1, A.shape[0])
    gain = np.linalg.lstsq(O, response[1:].reshape(-1, p), rcond=None)[0]
    stable = float(np.abs(np.linalg.eigvals(A - gain @ C)).max()) < 1.0
    return np.asarray(gain) if stable else None
