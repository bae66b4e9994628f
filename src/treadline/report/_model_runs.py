"""Data of the figures of a linear model: simulation of a record, impulse and frequency responses, residuals.

Models may be unstable: an overflow gives infinity, never an error.
"""

import math

import numpy as np
from jaxtyping import Bool, Complex, Float

from treadline.core.linear_systems import (
    impulse_response,
    initial_state,
    one_step_predictions,
    part,
    simulate,
    without_dead_time,
)
from treadline.core.models import RUN_VALUES, InputOutputRecord, LinearModel

LEAST_FOLLOWED = 50
"""Smallest number of samples from which the initial state is estimated, as for one-step predictions."""
GROWTH_MOST = 1e3
"""Growth up to which the responses of an unstable model are computed."""
STEPS_LEAST, STEPS_MOST = 20, 400
"""Smallest and largest length of an impulse response [samples]: a shorter panel looks empty; in a longer one single samples are not
visible."""
TAIL = 1e-4
"""Share of the energy of an impulse response after the end of the drawing: one per cent in amplitude."""
ANSWERED = 0.05
"""Share of its peak below which an output is drawn as zero response."""


def free_run(model: LinearModel, record: InputOutputRecord) -> Float[np.ndarray, "T p"]:
    """Return the free-run simulation of a record, restarted after each missing input; NaN in sections too short to score."""
    model, record = without_dead_time(model, record)
    answers = np.full(record.y.shape, np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        for span in record.stretches(RUN_VALUES * model.order):
            section = part(record, span.start, span.stop)
            start = initial_state(model, part(section, 0, _followed(model)))
            answers[span] = simulate(model, section.u, start)
    return answers


def one_step_ahead(model: LinearModel, record: InputOutputRecord) -> Float[np.ndarray, "T p"]:
    """Return the one-step predictions of a record, restarted after each missing input; NaN in sections too short to score."""
    with np.errstate(over="ignore", invalid="ignore"):
        return one_step_predictions(model, record)


def radius(model: LinearModel) -> float:
    """Return the spectral radius of A."""
    return float(np.abs(np.linalg.eigvals(model.A)).max())


def is_unstable(model: LinearModel) -> bool:
    """Whether a pole lies outside the unit circle by more than rounding."""
    return radius(model) > 1.0 + 1e-6


def _followed(model: LinearModel) -> int:
    """Return the number of steps over which the model grows at most ``GROWTH_MOST`` times, at least ``LEAST_FOLLOWED``."""
    if not is_unstable(model):
        return 2**31
    return max(LEAST_FOLLOWED, int(math.log(GROWTH_MOST) / math.log(radius(model))))


def shown_response(model: LinearModel) -> Float[np.ndarray, "steps p m"]:
    """Return the outputs after a unit impulse of one sample, until they have died out or as far as they can be shown."""
    limit = STEPS_MOST
    if is_unstable(model):
        limit = max(STEPS_LEAST // 2, min(limit, int(math.log(GROWTH_MOST) / math.log(radius(model)))))
        return impulse_response(model, limit + max(model.input_delay))
    response = impulse_response(model, 5 * limit)
    # An integrator's response stays: there, it is its change that has to die out.
    ends = [_died_out(response), _died_out(np.diff(response, axis=0))]
    return response[: max(STEPS_LEAST, next((end for end in ends if end <= limit), limit))]


def _died_out(response: Float[np.ndarray, "steps p m"]) -> int:
    """Return the step from which on each pair has only ``TAIL`` of its energy left."""
    left = np.cumsum(response[::-1] ** 2, axis=0)[::-1]
    return int(np.count_nonzero((left > TAIL * left[0]).any(axis=(1, 2))))


def answering(response: Float[np.ndarray, "steps m"]) -> int:
    """Return how many steps of one output's responses show it answer: half as many again as until little is left."""
    size = np.abs(response)
    lasts = int(np.flatnonzero((size > ANSWERED * size.max(axis=0)).any(axis=1)).max(initial=0))
    return min(len(response), max(STEPS_LEAST, lasts + lasts // 2))


def frequencies(model: LinearModel, samples: int) -> Float[np.ndarray, " w"]:
    """Return frequencies [rad per sample] up to Nyquist, closer together at the resonances."""
    lowest = max(2.0 * math.pi / max(samples, 20), 1e-4 * math.pi)  # four decades fit an axis
    grid = np.geomspace(lowest, math.pi, 160)
    poles = np.linalg.eigvals(model.A)
    rates = np.log(poles[np.abs(poles) > 0.5].astype(complex))
    offsets = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
    near = (np.abs(rates.imag)[:, None] + np.abs(rates.real)[:, None] * offsets).ravel()
    return np.unique(np.concatenate([grid, near[(near > lowest) & (near < math.pi)]]))


def frequency_response(model: LinearModel, omega_rad: Float[np.ndarray, " w"]) -> Complex[np.ndarray, "w p m"]:
    """Return ``G = (C (zI - A)^-1 B + D) z^-d`` at ``z = exp(jω)``; infinite where a pole lies on the point."""
    late = np.exp(-1j * omega_rad[:, None, None] * np.array(model.input_delay))
    values, vectors = np.linalg.eig(model.A)
    if np.linalg.cond(vectors) < 1e8:
        gaps = np.exp(1j * omega_rad)[:, None] - values
        with np.errstate(divide="ignore", invalid="ignore"):
            weighted = (model.C @ vectors) / gaps[:, None, :]
            return np.asarray((weighted @ np.linalg.solve(vectors, model.B.astype(complex)) + model.D) * late)
    # Defective: solve at every frequency, an integrator moved by rounding off the circle.
    shifted = np.exp(1j * omega_rad)[:, None, None] * (1.0 + 1e-12) * np.eye(model.order) - model.A
    moved = np.linalg.solve(shifted, np.broadcast_to(model.B, (len(omega_rad), *model.B.shape)))
    return np.asarray((model.C @ moved + model.D) * late)


def correlation(a: Float[np.ndarray, " T"], b: Float[np.ndarray, " T"], lags: int) -> Float[np.ndarray, " k"]:
    """Return the correlation of ``a[t]`` with ``b[t - lag]`` for lags ``-lags … lags``; missing samples count as mean."""
    first, second = _centred(a), _centred(b)
    size = math.sqrt(float(first @ first) * float(second @ second))
    if size == 0.0:
        return np.zeros(2 * lags + 1)
    ahead = [float(first[lag:] @ second[: len(second) - lag]) for lag in range(lags + 1)]
    behind = [float(first[: len(first) - lag] @ second[lag:]) for lag in range(lags, 0, -1)]
    return np.array(behind + ahead) / size


def _centred(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    there = np.isfinite(values)
    # A run that blew up must not overflow in its squares; a correlation does not know the size.
    largest = float(np.abs(values[there]).max(initial=0.0))
    if largest == 0.0:
        return np.zeros(len(values))
    scaled = values / largest
    return np.where(there, scaled - scaled[there].mean(), 0.0)


def correlation_band(a: Float[np.ndarray, " k"], b: Float[np.ndarray, " k"], count: int) -> float:
    """Return the half width that the correlation of two independent series keeps within 19 times of 20.

    Bartlett's formula: the variance is ``Σ r_a(k) r_b(k) / N``; at least that of white series.

    Args:
        a: Autocorrelation of one series at lags ``-k … k``; likewise b.
        count: Samples N.
    """
    return 1.96 * math.sqrt(max(float(a @ b), 1.0) / max(count, 1))


def typical_span(error: Float[np.ndarray, "T p"], span: int) -> slice:
    """Return the stretch of ``span`` samples whose error is the median of all stretches: neither the best nor the worst."""
    count = len(error) // span
    if count < 2:
        return slice(0, len(error))
    blocks = np.nan_to_num(np.abs(error[: count * span]), nan=0.0, posinf=1e150).clip(max=1e150).reshape(count, -1)
    order = np.argsort(np.mean(blocks, axis=1), kind="stable")
    start = int(order[(count - 1) // 2]) * span
    return slice(start, start + span)


def cut(
    values: Float[np.ndarray, "T p"], measured: Float[np.ndarray, "T p"]
) -> tuple[Float[np.ndarray, "T p"], Bool[np.ndarray, " p"]]:
    """Return a run without what lies beyond three spans of the measured outputs around their middle, and which left it."""
    low, high = np.fmin.reduce(measured, axis=0), np.fmax.reduce(measured, axis=0)
    middle, reach = 0.5 * (low + high), 3.0 * np.maximum(high - low, 1e-12)
    away = ~(np.abs(values - middle) <= reach) & np.isfinite(middle)
    # A run that overflows is infinite before it is no number; where it is none from the start, it was not judged.
    return np.where(away, np.nan, values), (away & ~np.isnan(values)).any(axis=0)
