"""The Cramér–Rao bound: the least error that any unbiased estimate from the same inputs and noise can have.

The Jacobian is exact (sensitivities by recursion). A change of coordinates moves the parameters of a state-space model along n²
directions without effect on the outputs. These directions are projected out; the rest is a minimal parametrisation at ground truth.
"""

import numpy as np
from jaxtyping import Float, Shaped
from scipy.linalg import qr, solve_triangular
from score import markov
from systems import Experiment, StateSpace


def relative_bound(experiment: Experiment, steps: int, *, start_known: bool) -> float:
    """Return the bound of the root mean square of ‖Y - Ŷ‖/‖Y‖ over the first Markov parameters.

    With ``start_known`` neither x0 nor an offset of the outputs is estimated; without, both are.
    """
    deviation = _deviation(experiment, markov_jacobian(experiment.system, steps), start_known=start_known)
    return float(np.linalg.norm(deviation) / np.linalg.norm(markov(experiment.system, steps)))


def pole_bound(experiment: Experiment) -> float:
    """Return the bound of the root mean square of |λ̂ - λ| over all poles, x0 and offset unknown."""
    poles, right = np.linalg.eig(experiment.system.A)
    left = np.linalg.inv(right)
    J = np.array([np.outer(left[k], right[:, k]).ravel() for k in range(len(poles))])  # dλ = w' dA v
    count = sum(part.size for part in (experiment.system.B, experiment.system.C, experiment.system.D))
    J = np.hstack([J, np.zeros((len(poles), count + len(poles) + len(experiment.system.C)))])
    return float(np.linalg.norm(_deviation(experiment, J, start_known=False)) / np.sqrt(len(poles)))


def _deviation(experiment: Experiment, M: Shaped[np.ndarray, "r q"], *, start_known: bool) -> Shaped[np.ndarray, "k r"]:
    """Return a root V of the least covariance V'V of what depends on the parameters by the Jacobian M."""
    system = experiment.system
    J, T = output_jacobian(system, experiment.record.u), coordinate_changes(system)
    J = (J / experiment.noise_std[:, None]).reshape(-1, J.shape[2])
    if start_known:
        used = J.shape[1] - len(system.A) - len(system.C)
        J, M, T = J[:, :used], M[:, :used], T[:used]
    kept = np.linalg.qr(T, mode="complete")[0][:, T.shape[1] :]
    # An unstable system's last rows are the largest: taken first, with pivoting, they do not swamp the others.
    R, order = qr((J @ kept)[::-1], mode="r", pivoting=True)
    return np.asarray(solve_triangular(R[: kept.shape[1]], (M @ kept)[:, order].T, trans="T"))


def output_jacobian(system: StateSpace, u: Float[np.ndarray, "T m"]) -> Float[np.ndarray, "T p q"]:
    """Return dy/d(A, B, C, D, x0, offset) of a run from rest."""
    (n, m), p = system.B.shape, len(system.C)
    inner, J = n * n + n * m, np.zeros((len(u), p, n * n + n * m + p * n + p * m + n + p))
    x, S = np.zeros(n), np.hstack([np.zeros((n, inner)), np.eye(n)])
    J[:, :, -p:] = np.eye(p)
    for k in range(len(u)):
        J[k, :, :inner], J[k, :, -p - n : -p] = system.C @ S[:, :inner], system.C @ S[:, inner:]
        J[k, :, inner : -p - n] = np.hstack([np.kron(np.eye(p), x), np.kron(np.eye(p), u[k])])
        S = system.A @ S
        S[:, :inner] += np.hstack([np.kron(np.eye(n), x), np.kron(np.eye(n), u[k])])
        x = system.A @ x + system.B @ u[k]
    return J


def markov_jacobian(system: StateSpace, steps: int) -> Float[np.ndarray, "r q"]:
    """Return d(D, CB, CAB, …)/d(A, B, C, D, x0, offset): outputs of a run whose input is a unit impulse."""
    impulses = [np.eye(1, system.B.shape[1], i) for i in range(system.B.shape[1])]
    rest = np.zeros((steps - 1, system.B.shape[1]))
    J = np.concatenate([output_jacobian(system, np.vstack([impulse, rest])) for impulse in impulses])
    J[:, :, -len(system.A) - len(system.C) :] = 0.0
    return J.reshape(-1, J.shape[2])


def coordinate_changes(system: StateSpace) -> Float[np.ndarray, "q nn"]:
    """Return the directions dA = XA - AX, dB = XB, dC = -CX: they move no output that starts from rest."""
    n, p = len(system.A), len(system.C)
    columns = []
    for i in range(n * n):
        X = np.zeros((n, n))
        X.flat[i] = 1.0
        moved = (X @ system.A - system.A @ X, X @ system.B, -system.C @ X, np.zeros_like(system.D), np.zeros(n + p))
        columns.append(np.concatenate([part.ravel() for part in moved]))
    return np.array(columns).T
