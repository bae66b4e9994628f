"""Scores of identified models, the same for all methods; this module shares no code with the methods."""

import numpy as np
from jaxtyping import Float
from systems import Model

from treadline.core.models import InputOutputRecord

START = 0.1
"""Share of a record, its first, from which the initial state is estimated; it is not scored (``treadline`` does the same)."""


def markov(model: Model, steps: int) -> Float[np.ndarray, "steps p m"]:
    """Return D, CB, CAB, …: ``steps`` matrices."""
    response, reach = [model.D], model.B
    for _ in range(steps - 1):
        response.append(model.C @ reach)
        reach = model.A @ reach
    return np.array(response)


def relative_error(model: Model, truth: Model, steps: int) -> float:
    """Return ‖Y - Ŷ‖/‖Y‖ over the first Markov parameters."""
    expected = markov(truth, steps)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.linalg.norm(markov(model, steps) - expected) / np.linalg.norm(expected))


def free_run(model: Model, record: InputOutputRecord) -> Float[np.ndarray, "T p"]:
    """Return the simulated outputs, from the initial state that suits the first tenth of the record best."""
    v = record.u - model.input_offset
    start = _prefix(record)
    with np.errstate(over="ignore", invalid="ignore"):
        forced = _simulated(model, v[:start], np.zeros(len(model.A))) + model.output_offset
        if not np.isfinite(forced).all():
            return np.full_like(record.y, np.inf)
        scale = record.y[:start].std(axis=0) + np.finfo(float).tiny
        free = np.array(_observability(model, start)) / scale[:, None]
        residual = (record.y[:start] - forced) / scale
        x0 = np.linalg.lstsq(free.reshape(-1, len(model.A)), residual.ravel(), rcond=None)[0] if np.isfinite(free).all() else 0.0
        return _simulated(model, v, np.zeros(len(model.A)) + x0) + model.output_offset


def fit_percent(model: Model, record: InputOutputRecord) -> float:
    """Return 100 (1 - ‖y - ŷ‖/‖y - ȳ‖) of a free run after its first tenth, averaged over the outputs; -inf where it diverges."""
    start = _prefix(record)
    y = record.y[start:]
    error, spread = y - free_run(model, record)[start:], y - y.mean(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        percent = float(np.mean(100.0 * (1.0 - np.linalg.norm(error, axis=0) / np.linalg.norm(spread, axis=0))))
    return percent if np.isfinite(percent) else -np.inf


def _prefix(record: InputOutputRecord) -> int:
    return max(1, round(START * len(record.y)))


def _simulated(model: Model, v: Float[np.ndarray, "T m"], x0: Float[np.ndarray, " n"]) -> Float[np.ndarray, "T p"]:
    states, x, drive = np.empty((len(v), len(x0))), x0, v @ model.B.T
    for k, into in enumerate(drive):
        states[k] = x
        x = model.A @ x + into
    return np.asarray(states @ model.C.T + v @ model.D.T)


def _observability(model: Model, steps: int) -> list[Float[np.ndarray, "p n"]]:
    rows = [np.asarray(model.C)]
    for _ in range(steps - 1):
        rows.append(rows[-1] @ model.A)
    return rows
