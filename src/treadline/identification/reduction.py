"""Stabilisation and reduction of models."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import schur, solve_discrete_lyapunov

from treadline.core.errors import ModelError
from treadline.core.models import LinearModel
from treadline.identification._affine import Affine

ON_CIRCLE = 1.0 - 1e-9
"""Modulus above which a pole counts as on the unit circle, with a margin for rounding."""
INSIDE = 1.0 - 1e-4
"""Largest modulus of a pole after reflection into the unit circle."""


def stabilised(system: Affine) -> Affine:
    """Return the system with poles outside the unit circle reflected, and poles on the circle moved just inside.

    The reflection 1/λ* preserves the magnitude of the frequency response. Only the diagonal of the real Schur form changes,
    so that equal poles stay coupled.
    """
    if system.radius < ON_CIRCLE:
        return system
    T, Q = schur(system.A, output="real")
    at = 0
    while at < len(T):
        size = 2 if at + 1 < len(T) and T[at + 1, at] != 0.0 else 1
        block = slice(at, at + size)
        modulus = float(np.sqrt(abs(np.linalg.det(T[block, block])))) if size == 2 else abs(float(T[at, at]))
        if modulus >= ON_CIRCLE:
            T[block, block] *= min(1.0 / modulus, INSIDE) / modulus
        at += size
    return replace(system, A=np.asarray(Q @ T @ Q.T))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reduced:
    """Reduced model, the Hankel singular values of the full model and the error bound."""

    model: LinearModel
    hankel_values: Float[np.ndarray, " n"]
    bound: float
    """H∞ bound on the error: twice the sum of the truncated Hankel singular values (Al-Saggaf and Franklin, 1987)."""


def balanced_truncation(model: LinearModel, order: int) -> Reduced:
    """Return the model truncated to its ``order`` strongest balanced states.

    Moore, 1981: in balanced coordinates each state is equally controllable and observable; its Hankel singular value
    measures the contribution to the response.

    Raises:
        ModelError: If the model is not stable, or not larger than the order.
    """
    radius = float(np.abs(np.linalg.eigvals(model.A)).max())
    if radius >= 1.0:
        raise ModelError(f"balanced truncation needs a stable model, this one's spectral radius is {radius:.4f}")
    if not 1 <= order <= model.order:
        raise ModelError(f"the model has {model.order} states; it cannot be cut to {order}")
    reach = _root(solve_discrete_lyapunov(model.A, model.B @ model.B.T))
    see = _root(solve_discrete_lyapunov(model.A.T, model.C.T @ model.C))
    U, s, Vt = np.linalg.svd(see.T @ reach)
    root = np.sqrt(np.maximum(s[:order], 1e-300))
    T, left = reach @ Vt[:order].T / root, (see @ U[:, :order] / root).T
    gain = None if model.observer_gain is None else left @ model.observer_gain
    if gain is not None and np.abs(np.linalg.eigvals(left @ model.A @ T - gain @ model.C @ T)).max() >= 1.0:
        gain = None
    smaller = replace(model, A=left @ model.A @ T, B=left @ model.B, C=model.C @ T, observer_gain=gain)
    return Reduced(model=smaller, hankel_values=s, bound=2.0 * float(s[order:].sum()))


def _root(square: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    values, V = np.linalg.eigh(0.5 * (square + square.T))
    return np.asarray(V * np.sqrt(np.maximum(values, 0.0)))
