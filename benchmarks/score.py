"""One judge for every model, whoever made it: shares no code with what it judges."""

import numpy as np
from jaxtyping import Float
from systems import StateSpace

from treadline.models import InputOutputRecord


def markov(model: StateSpace, steps: int) -> Float[np.ndarray, "steps p m"]:
    """Return D, CB, CAB, …: ``steps`` matrices."""
    response, reach = [model.D], model.B
    for _ in range(steps - 1):
        response.append(model.C @ reach)
        reach = model.A @ reach
    return np.array(response)


def relative_error(model: StateSpace, truth: StateSpace, steps: int) -> float:
    """Return ‖Y - Ŷ‖/‖Y‖ over the first Markov parameters."""
    expected = markov(truth, steps)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.linalg.norm(markov(model, steps) - expected) / np.linalg.norm(expected))


def free_run(model: StateSpace, record: InputOutputRecord) -> Float[np.ndarray, "T p"]:
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


def fit_percent(model: StateSpace, record: InputOutputRecord) -> float:
    """Return 100 (1 - ‖y - ŷ‖/‖y - ȳ‖) of a free run, averaged over the outputs; -inf where it diverges."""
    error = np.linalg.norm(record.y - free_run(model, record), axis=0)
    spread = np.linalg.norm(record.y - record.y.mean(axis=0), axis=0)
    return float(np.mean(100.0 * (1.0 - error / spread)))
