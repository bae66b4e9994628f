"""Sampling of a linear model whose inputs are held between samples: another period, or continuous time."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, logm

from treadline.core.errors import ModelError, PeriodMismatch
from treadline.core.state_space import StateSpaceModel

Model = TypeVar("Model", bound=StateSpaceModel)


def resampled(model: Model, period_s: float) -> Model:
    """Return the model at another period, as ``LinearModel.resampled`` states."""
    if not 0.0 < period_s < np.inf:
        raise PeriodMismatch(f"the period is {period_s} s; it must be positive and finite")
    n = model.order
    sampled = expm(_rates(model) * period_s)
    made = {**model.provenance, "resampled_from_s": model.dt_s}
    late = tuple(round(delay * model.dt_s / period_s) for delay in model.input_delay)
    A, B = sampled[:n, :n], sampled[:n, n:]
    return replace(model, A=A, B=B, dt_s=period_s, input_delay=late, observer_gain=None, provenance=made)


def continuous(
    model: StateSpaceModel,
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n m"], Float[np.ndarray, "p n"], Float[np.ndarray, "p m"]]:
    """Return A, B, C, D of dx/dt = Ax + Bu, y = Cx + Du, whose samples are those of the model.

    Raises:
        PeriodMismatch: If the model has no continuous counterpart (a real pole at or below zero).
        ModelError: If an input has a dead time, for which continuous time has no states.
    """
    if any(model.input_delay):
        raise ModelError(
            f"input_delay is {list(model.input_delay)} samples: a dead time has no states in continuous time; leave it out with "
            "dataclasses.replace(model, input_delay=()), and delay the inputs"
        )
    n, rates = model.order, _rates(model)
    return rates[:n, :n], rates[:n, n:], model.C, model.D


def _rates(model: StateSpaceModel) -> Float[np.ndarray, "nm nm"]:
    """Return the logarithm of [A B; 0 I] over the period: [A B; 0 0] in continuous time [1/s]."""
    n, m = model.B.shape
    poles = np.linalg.eigvals(model.A)
    if np.any((np.abs(poles.imag) < 1e-12) & (poles.real <= 1e-9)):
        raise PeriodMismatch(
            f"the model at {model.dt_s:g} s has a pole at or below zero, and no counterpart at another period; identify it again "
            "with --resample and the --period that is wanted"
        )
    whole = np.eye(n + m)
    whole[:n, :n], whole[:n, n:] = model.A, model.B
    return np.asarray(np.real(logm(whole)) / model.dt_s)
