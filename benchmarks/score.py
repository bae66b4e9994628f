"""Scores of identified models, the same for all methods; this module shares no code with the methods."""

import numpy as np
from jaxtyping import Float
from systems import Model

from treadline.core.models import InputOutputRecord

BLOCKS, DRAWS, BOOTSTRAP_SEED = 20, 500, 1
"""Block bootstrap: blocks per resampled record, number of resamples, and seed. Blocks exceed the correlation time of the errors."""


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
    """Return the simulated outputs, from the initial state that suits the whole record best."""
    v = record.u - model.input_offset
    n = len(model.A)
    # One recursion carries the forced state (last column) and A^k, which spans the free ones.
    state, drive = np.hstack([np.eye(n), np.zeros((n, 1))]), v @ model.B.T
    response = np.empty((len(v), len(model.C), n + 1))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(v)):
            response[k] = model.C @ state
            state = model.A @ state
            state[:, n] += drive[k]
        forced = response[:, :, n] + v @ model.D.T + model.output_offset
    if not np.isfinite(response).all():
        return np.full_like(record.y, np.inf)
    scale = record.y.std(axis=0)
    free, misfit = response[:, :, :n] / scale[:, None], (record.y - forced) / scale
    x0 = np.linalg.lstsq(free.reshape(-1, n), misfit.ravel(), rcond=None)[0]
    return np.asarray(forced + response[:, :, :n] @ x0)


def fit_percent(model: Model, record: InputOutputRecord) -> float:
    """Return 100 (1 - ‖y - ŷ‖/‖y - ȳ‖) of a free run, averaged over the outputs; -inf where it diverges."""
    return percent_of(record.y - free_run(model, record), record.y - record.y.mean(axis=0))


def percent_of(error: Float[np.ndarray, "T p"], spread: Float[np.ndarray, "T p"]) -> float:
    """Return the fit that errors leave of what there was."""
    return float(np.mean(100.0 * (1.0 - np.linalg.norm(error, axis=0) / np.linalg.norm(spread, axis=0))))


def fits_apart(one: Model, other: Model, record: InputOutputRecord) -> tuple[float, float]:
    """Return between which differences of two models' fits 95 of 100 records like this one would lie.

    Blocks of the record are drawn again and again with both models' errors in them (Künsch 1989): errors are alike in neighbours,
    and in both models. What another estimation half would have changed is not in it.
    """
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    length = max(1, len(record.y) // BLOCKS)
    spread = record.y - record.y.mean(axis=0)
    errors = [record.y - free_run(model, record) for model in (one, other)]
    apart = []
    for starts in rng.integers(0, len(record.y) - length + 1, (DRAWS, BLOCKS)):
        rows = (starts[:, None] + np.arange(length)).ravel()
        apart.append(percent_of(errors[0][rows], spread[rows]) - percent_of(errors[1][rows], spread[rows]))
    low, high = np.quantile(apart, (0.025, 0.975)).tolist()
    return low, high
