"""Simulation, prediction, fit and residual tests of linear models.

After a missing input the state is estimated anew, as at the start of a record (``InputOutputRecord.stretches``).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import chdtrc

from treadline.core.arrays import BLOCK_ROWS, markov_parameters, observability
from treadline.core.errors import PoorExcitation
from treadline.core.linear_system_kernels import free_run, observer_run
from treadline.core.state_space import RUN_VALUES, TEST_VALUES, InputOutputRecord, StateSpaceModel

PREFIX = 0.1
"""Share of a record, at its start, from which the initial state of a free run is estimated."""
PREFIX_VALUES = 3
"""Output values per state in the prefix, at least: three equations for each unknown."""
TESTED_LAGS = 10
"""Number of lags over which residuals are tested."""


def impulse_response(model: StateSpaceModel, steps: int) -> Float[np.ndarray, "steps p m"]:
    """Return the impulse response Y_0 = D, Y_k = C A^(k-1) B, each input's after its dead time.

    Paper: Eq. (7), Fig. 8.
    """
    response = markov_parameters(model.A, model.B, model.C, model.D, steps)
    return np.stack([_later(response[:, :, j], delay) for j, delay in enumerate(model.input_delay)], axis=2)


def _later(values: Float[np.ndarray, "T c"], shift: int) -> Float[np.ndarray, "T c"]:
    """Return a signal delayed by some samples, zero before it begins."""
    shift = min(shift, len(values))
    return np.concatenate([np.zeros((shift, values.shape[1])), values[: len(values) - shift]])


def without_dead_time(model: StateSpaceModel, record: InputOutputRecord) -> tuple[StateSpaceModel, InputOutputRecord]:
    """Return the model without its dead time and the record with the inputs as they act, missing before they first do."""
    if not any(model.input_delay):
        return model, record
    return replace(model, input_delay=()), record.delayed(model.input_delay)


def simulate(model: StateSpaceModel, u: Float[np.ndarray, "T m"], x0: Float[np.ndarray, " n"]) -> Float[np.ndarray, "T p"]:
    """Return the outputs of a free run from the initial state x0; before the first sample the inputs are at their offset."""
    v = u - model.input_offset
    if any(model.input_delay):
        v = np.hstack([_later(v[:, j : j + 1], delay) for j, delay in enumerate(model.input_delay)])
    v = writeable(v)
    y = free_run(*(writeable(item) for item in (model.A, model.B, model.C, model.D, x0)), v)
    return np.asarray(y + model.output_offset)


def writeable(array: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return a contiguous, writeable array, the layout of the compiled kernels."""
    return np.require(array, np.float64, ["C", "W"])


def initial_state(model: StateSpaceModel, record: InputOutputRecord) -> Float[np.ndarray, " n"]:
    """Return the least-squares initial state of a free run; the inputs must be complete."""
    n = model.order
    if not len(record):
        return np.zeros(n)
    response = observability(model.A, model.C, len(record))
    residual = record.y - simulate(model, record.u, np.zeros(n))
    whole = np.isfinite(residual).all(axis=1) & np.isfinite(response).all(axis=(1, 2))
    # Outputs are weighted by their deviation from the offset, so the result does not depend on their units; one at rest gets 1.
    size = np.sqrt(np.mean((record.y[whole] - model.output_offset) ** 2, axis=0)) if whole.any() else np.zeros(residual.shape[1])
    weight = 1.0 / np.where(size > 0.0, size, 1.0)
    design, target = (response[whole] * weight[:, None]).reshape(-1, n), (residual[whole] * weight).ravel()
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])


def prefix(samples: int, order: int, outputs: int) -> int:
    """Return how many first samples of a record determine the initial state of a free run, and are not scored.

    A tenth of the record, at least ``PREFIX_VALUES`` output values per state, at most half of the record.
    """
    return min(max(math.ceil(PREFIX * samples), math.ceil(PREFIX_VALUES * order / outputs)), samples // 2)


def fair_run(model: StateSpaceModel, record: InputOutputRecord) -> tuple[Float[np.ndarray, "T p"], Bool[np.ndarray, " T"]]:
    """Return a free run whose initial state comes from the prefix of the record alone, and the samples after the prefix.

    After a missing input the run starts anew, with a prefix of its own. NaN where the inputs are missing.
    """
    model, record = without_dead_time(model, record)
    run, scored = np.full(record.y.shape, np.nan), np.zeros(len(record), dtype=np.bool_)
    with np.errstate(over="ignore", invalid="ignore"):
        for span in record.stretches(RUN_VALUES * model.order):
            section = part(record, span.start, span.stop)
            first = prefix(len(section), model.order, len(model.C))
            run[span] = simulate(model, section.u, initial_state(model, part(section, 0, first)))
            scored[span.start + first : span.stop] = True
    return run, scored


def fit_percent(model: StateSpaceModel, record: InputOutputRecord) -> Float[np.ndarray, " p"]:
    """Return the free-run fit 100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%] per output, over the samples after the prefix (``fair_run``).

    The fit of an integrator is not informative: its free run drifts with the smallest disturbance.
    """
    run, scored = fair_run(model, record)
    return percent_of(record.y[scored], run[scored])


def percent_of(y: Float[np.ndarray, "T p"], modelled: Float[np.ndarray, "T p"]) -> Float[np.ndarray, " p"]:
    """Return 100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) [%] per output over the samples at which both are known; -infinity if it diverges."""
    known = ~(np.isnan(y) | np.isnan(modelled))
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.sqrt(np.sum((y - modelled) ** 2, axis=0, where=known))
        deviation = np.sqrt(_variation(np.where(known, y, np.nan)))
    return np.asarray(100.0 * (1.0 - error / np.maximum(deviation, 1e-300)))


def _variation(values: Float[np.ndarray, "T p"]) -> Float[np.ndarray, " p"]:
    """Return the sum of squares about the mean of each column, NaN left out; zero where nothing is known."""
    known = ~np.isnan(values)
    mean = np.sum(values, axis=0, where=known) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.sum((values - mean) ** 2, axis=0, where=known))


def predictions(model: StateSpaceModel, record: InputOutputRecord, horizon: int = 1) -> Float[np.ndarray, "T p"]:
    """Return the outputs predicted ``horizon`` samples ahead with measured inputs: row k knows the outputs up to k - horizon.

    The first rows, which no output precedes by so much, continue from the initial state. NaN at a missing input, before the first
    input acts, and between two missing inputs in close succession.
    """
    model, record = without_dead_time(model, record)
    v, y = record.u - model.input_offset, np.full(record.y.shape, np.nan)
    if horizon == 1:
        for rows, x in _predictor_states(model, record):
            y[rows] = x @ model.C.T
    else:
        x = np.full((len(record), model.order), np.nan)
        for rows, states in _predictor_states(model, record):
            x[rows] = states
        for _ in range(min(horizon, len(record)) - 1):
            x = np.vstack([x[:1], x[:-1] @ model.A.T + v[:-1] @ model.B.T])
        y = x @ model.C.T
    y += v @ model.D.T
    return np.asarray(y + model.output_offset)


def _predictor_states(model: StateSpaceModel, record: InputOutputRecord) -> Iterator[tuple[slice, Float[np.ndarray, "k n"]]]:
    """Yield the observer's state before each sample, block by block; missing outputs are bridged by prediction."""
    for span in record.stretches(TEST_VALUES * model.order):
        first = prefix(span.stop - span.start, model.order, len(model.C))
        x = initial_state(model, part(record, span.start, span.start + first))
        for start in range(span.start, span.stop, BLOCK_ROWS):
            stop = min(start + BLOCK_ROWS, span.stop)
            states = _observed(model, part(record, start, min(stop + 1, span.stop)), x)
            yield slice(start, stop), states[: stop - start]
            x = states[-1]


def _observed(model: StateSpaceModel, record: InputOutputRecord, x0: Float[np.ndarray, " n"]) -> Float[np.ndarray, "T n"]:
    gain = np.zeros((model.order, model.C.shape[0])) if model.observer_gain is None else model.observer_gain
    v = record.u - model.input_offset
    # x⁺ = (A - KC) x + (B - KD) v + K y; a sample with a NaN applies no correction.
    whole = np.isfinite(record.y).all(axis=1)
    correction = np.where(whole[:, None], record.y - model.output_offset - v @ model.D.T, 0.0) @ gain.T
    closed = model.A - gain @ model.C
    return np.asarray(observer_run(writeable(model.A), closed, v @ model.B.T, correction, whole, x0))


def vaf_percent(y: Float[np.ndarray, "T p"], residuals: Float[np.ndarray, "T p"]) -> Float[np.ndarray, " p"]:
    """Return the variance accounted for [%] per output; NaN if the residuals diverge."""
    counts = [np.maximum((~np.isnan(item)).sum(axis=0), 1) for item in (residuals, y)]
    with np.errstate(over="ignore", invalid="ignore"):
        left, whole = _variation(residuals) / counts[0], _variation(y) / counts[1]
    return np.asarray(100.0 * (1.0 - left / np.maximum(whole, 1e-300)))


def h_step_rmse(model: StateSpaceModel, record: InputOutputRecord, steps: int) -> Float[np.ndarray, " p"]:
    """Return the RMS error of forecasts ``steps`` ahead from every sample, with measured inputs; 1 is the next sample.

    Raises:
        PoorExcitation: If the record is shorter than the forecast.
    """
    if len(record) <= steps:
        raise PoorExcitation(f"{len(record)} samples are too few to forecast {steps} ahead")
    error = (record.y - predictions(model, record, steps))[steps - 1 :]
    return np.asarray(np.sqrt(np.nanmean(error**2, axis=0)))


def whiteness_p(residuals: Float[np.ndarray, "T p"]) -> float:
    """Return the p-value of the residuals being white (Hosking's portmanteau test, 1980)."""
    e = unit_scale(residuals)
    e = e[np.isfinite(e).all(axis=1)]
    count, p = e.shape
    if not count:
        return math.nan
    e = e - e.mean(axis=0)
    C0 = np.linalg.pinv(e.T @ e / count)
    statistic = 0.0
    lags = min(TESTED_LAGS, count - 1)
    for lag in range(1, lags + 1):
        C = e[lag:].T @ e[:-lag] / count
        statistic += count * count / (count - lag) * float(np.trace(C.T @ C0 @ C @ C0))
    return chi2_tail(statistic, p * p * lags)


def crosscorrelation_p(residuals: Float[np.ndarray, "T p"], u: Float[np.ndarray, "T m"], lags: int = TESTED_LAGS) -> float:
    """Return the p-value of the residuals being independent of past inputs.

    The cross-covariance, weighted by both covariances, is χ² distributed for independent signals of which one is white (Ljung,
    System Identification, 1999, section 16.6, for all pairs at once). A small p-value indicates missing dynamics. On the
    fitted data the p-value is too large, because the fit decorrelates the residuals.
    """
    residuals, u = unit_scale(residuals), unit_scale(u)
    p, q = residuals.shape[1], u.shape[1] * (lags + 1)
    past = np.lib.stride_tricks.sliding_window_view(np.vstack([np.full((lags, u.shape[1]), np.nan), u]), lags + 1, axis=0)
    count, total, square = 0, np.zeros(p + q), np.zeros((p + q, p + q))
    for k in range(0, len(u), BLOCK_ROWS):
        rows = np.hstack([residuals[k : k + BLOCK_ROWS], past[k : k + BLOCK_ROWS].reshape(-1, q)])
        rows = rows[np.isfinite(rows).all(axis=1)]
        count, total, square = count + len(rows), total + rows.sum(axis=0), square + rows.T @ rows
    if count <= 2 * q:
        return float("nan")
    covariance = square / count - np.outer(total, total) / count**2
    cross = covariance[p:, :p]
    weight_e, weight_phi = np.linalg.pinv(covariance[:p, :p]), np.linalg.pinv(covariance[p:, p:], rcond=1e-9)
    rank = int(np.linalg.matrix_rank(weight_phi, tol=1e-12 * float(np.abs(weight_phi).max())))
    statistic = count * float(np.trace(weight_phi @ cross @ weight_e @ cross.T))
    return chi2_tail(statistic, p * rank)


def unit_scale(values: Float[np.ndarray, "T c"]) -> Float[np.ndarray, "T c"]:
    """Return signals about their means, at most 2 in size, NaN where not finite: no square of a diverging one overflows."""
    known = np.isfinite(values)
    scaled = np.where(known, values, 0.0) / np.max(np.abs(values), axis=0, where=known, initial=np.finfo(float).tiny)
    return np.where(known, scaled - scaled.sum(axis=0) / np.maximum(known.sum(axis=0), 1), np.nan)


def chi2_tail(statistic: float, freedom: int) -> float:
    """Return the probability that a χ² variable exceeds a statistic; NaN without a degree of freedom."""
    return float(chdtrc(freedom, max(statistic, 0.0))) if freedom else math.nan


def most_recent(records: Sequence[InputOutputRecord], samples: int) -> list[InputOutputRecord]:
    """Return the last records with a total of ``samples`` complete samples."""
    kept: list[InputOutputRecord] = []
    remaining = samples
    for record in reversed(records):
        whole = np.flatnonzero(record.whole)
        whole = whole[max(0, whole.size - remaining) :]
        if whole.size:
            kept.insert(0, part(record, int(whole[0]), int(whole[-1]) + 1))
            remaining -= whole.size
    return kept


def part(record: InputOutputRecord, start: int, stop: int) -> InputOutputRecord:
    """Return the samples ``start … stop - 1``."""
    return replace(record, u=record.u[start:stop], y=record.y[start:stop])
