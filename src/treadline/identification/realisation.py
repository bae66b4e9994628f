"""From OKID's observer to a model: Hankel matrix, realisation, operating point and innovation gain."""

import numpy as np
from jaxtyping import Float

from treadline.identification.checks import channel_names
from treadline.identification.era import HankelSvd, hankel_svd, realise
from treadline.identification.okid import ObserverMarkov, system_markov
from treadline.identification.windows import Scales
from treadline.models import InputOutputRecord, LinearModel

BLOCKS_LEAST = 8
"""Block rows of the Hankel matrix at least: two seconds at 4 Hz, on which an integrator and a lag part clearly."""


def markov_svd(observer: ObserverMarkov, lags: int, order: int | None, scales: Scales) -> HankelSvd:
    """Return the decomposed Hankel matrix of the observer's system, long enough for an order."""
    m, p = observer.D.shape[1], observer.D.shape[0]
    blocks = max(lags, BLOCKS_LEAST, -(-((order or 1) + 1) // min(m, p)))
    return hankel_svd(system_markov(observer, 2 * blocks + 1), blocks, blocks, *scales)


def model_of(
    svd: HankelSvd,
    order: int,
    scales: Scales,
    records: list[InputOutputRecord],
    observer: ObserverMarkov | None,
    D: Float[np.ndarray, "p m"],
) -> LinearModel:
    """Return the model of an order, around the operating point of the data."""
    A, B, C = realise(svd, order, *scales)
    u0 = np.nanmean(np.vstack([record.u for record in records]), axis=0)
    y0 = np.nanmean(np.vstack([record.y for record in records]), axis=0)
    if observer is not None:
        u0, y0 = _rest(observer, u0, y0, scales)
    names = channel_names(records[0])
    m = records[0].u.shape[1]
    return LinearModel(
        A=A,
        B=B,
        C=C,
        D=D,
        dt_s=records[0].dt_s,
        input_offset=u0,
        output_offset=y0,
        observer_gain=None if observer is None else _observer_gain(A, C, observer),
        input_names=names[:m],
        output_names=names[m:],
    )


def _rest(
    observer: ObserverMarkov, u_mean: Float[np.ndarray, " m"], y_mean: Float[np.ndarray, " p"], scales: Scales
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " p"]]:
    """Return the operating point (input, output) nearest to the means at which the observer says nothing changes.

    (I - Σβ) y₀ - (D + Σα) u₀ = bias. Where an integrator leaves y₀ open, it is u₀ that yields: a chair whose right belt
    runs fast stands still at unequal belts. Distances count in deviations, an input's three times.
    """
    M = np.eye(y_mean.size) - observer.beta.sum(axis=0)
    N = observer.D + observer.alpha.sum(axis=0)
    missing = observer.bias - M @ y_mean + N @ u_mean
    step_u, step_y = scales[0] / 3.0, scales[1]
    change = np.linalg.pinv(np.hstack([M * step_y, -N * step_u])) @ missing
    return u_mean + change[y_mean.size :] * step_u, y_mean + change[: y_mean.size] * step_y


def _observer_gain(
    A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "p n"], observer: ObserverMarkov
) -> Float[np.ndarray, "n p"] | None:
    """Return the innovation gain that, with this A and C, answers an innovation as OKID's observer does."""
    lags, p, _ = observer.beta.shape
    steps = max(lags, A.shape[0]) + 1
    response = [np.eye(p)]
    for k in range(1, steps):
        response.append(sum(observer.beta[i - 1] @ response[k - i] for i in range(1, min(k, lags) + 1)))
    rows, reach = [], C
    for _ in range(1, steps):
        rows.append(reach)
        reach = reach @ A
    gain = np.linalg.lstsq(np.vstack(rows), np.vstack(response[1:]), rcond=None)[0]
    stable = float(np.abs(np.linalg.eigvals(A - gain @ C)).max()) < 1.0
    return np.asarray(gain) if stable else None
