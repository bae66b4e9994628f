"""LQR: the gain that trades heading error against belt speed (Eq. 10, 11a, 13, 14), and the state from one output (Eq. 11b)."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Complex, Float

from treadline.core.arrays import matrix, spectral_radius
from treadline.core.errors import NotDefinite, NotFinite, NotInvertible, NotStabilisable, ShapeMismatch, TreadlineError
from treadline.core.models import ControllerDesign

SYMMETRY = 1e-9
"""Relative asymmetry of a weight attributed to rounding."""
CONDITION_LIMIT = 1e6
"""Condition number above which one unit in the last place of a 16-bit sensor changes the state by its own size."""


def lqr_gain(
    A: Float[np.ndarray, "n n"],
    B: Float[np.ndarray, "k m"],
    Q: Float[np.ndarray, "q q"],
    R: Float[np.ndarray, "r r"],
) -> Float[np.ndarray, "m n"]:
    """Return the gain K whose control law ``u_k = -K x_k`` minimises the cost J.

    Paper: Eq. (10), (11a), (13), (14).

    Solves the Riccati equation for P, the cost-to-go from a state (``J = x' P x``), then ``K = (R + B'PB)^-1 B'PA``.

    Args:
        A: State transition, one control period per step.
        B: Effect of the belt speeds (left, right) [m/s] on the next state.
        Q: State weight, positive semi-definite.
        R: Input weight [1/(m/s)^2], positive definite.

    Returns:
        K: Belt speed per unit of state [m/s].

    Raises:
        RecordError: If an argument is not numeric.
        ShapeMismatch: If an argument is not a matrix, or the shapes do not match.
        NotFinite: If an argument contains NaN or Inf.
        NotDefinite: If Q is not positive semi-definite or R not positive definite.
        NotStabilisable: If no gain makes ``A - BK`` stable.
    """
    from scipy.linalg import solve_discrete_are  # here, because a climb, which loads this module, designs nothing

    A, B, Q, R = matrix("A", A), matrix("B", B), matrix("Q", Q), matrix("R", R)
    n, m = A.shape[0], B.shape[1]
    for name, given, shape in (("A", A, (n, n)), ("B", B, (n, m)), ("Q", Q, (n, n)), ("R", R, (m, m))):
        if given.shape != shape:
            raise ShapeMismatch(f"the weight or matrix {name} is {given.shape}, A and B ask for {shape}")
        if not np.isfinite(given).all():
            raise NotFinite(f"{name} holds NaN or Inf")
    _check_definite("Q", Q, strictly=False)
    _check_definite("R", R, strictly=True)
    unsolved = NotStabilisable(
        f"the Riccati equation has no stabilising solution (spectral radius of A is {spectral_radius(A):.3f}); "
        "identify the model again with inputs that excite both tracks"
    )
    with solvable(unsolved):
        P = solve_discrete_are(A, B, Q, R)
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    radius = spectral_radius(A - B @ K)
    if not radius < 1.0:
        raise NotStabilisable(
            f"no gain stabilises this model (spectral radius of A - BK is {radius:.3f}); "
            "identify it again with inputs that excite both tracks"
        )
    return np.asarray(K)


@contextmanager
def solvable(otherwise: TreadlineError) -> Iterator[None]:
    """Raise an error if a computation has no finite result, or a solver warns that its result is inaccurate."""
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"), warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    except (ArithmeticError, ValueError, Warning) as error:  # of these, LinAlgError is a ValueError
        raise otherwise from error


def _check_definite(name: str, weight: Float[np.ndarray, "n n"], *, strictly: bool) -> None:
    """Check that a weight is symmetric and positive (semi-)definite.

    Raises:
        NotDefinite: With the smallest eigenvalue.
    """
    scale = max(float(np.abs(weight).max()), 1e-300)
    if float(np.abs(weight - weight.T).max()) > SYMMETRY * scale:
        raise NotDefinite(f"{name} is not symmetric; give ({name} + {name}')/2")
    smallest = float(np.linalg.eigvalsh(weight).min())
    if strictly and smallest <= 0.0:
        raise NotDefinite(f"{name} is not positive definite (smallest eigenvalue {smallest:.3g}); raise its diagonal")
    if smallest < -SYMMETRY * scale:
        raise NotDefinite(f"{name} is not positive semi-definite (smallest eigenvalue {smallest:.3g})")


def closed_loop_poles(design: ControllerDesign) -> Complex[np.ndarray, " n"]:
    """Return the eigenvalues of ``A - BK``."""
    return np.asarray(np.linalg.eigvals(design.model.A - design.model.B @ design.K), dtype=complex)


def static_inverse(design: ControllerDesign) -> Float[np.ndarray, "n p"]:
    """Return the matrix of Eq. (11b) for a design.

    Raises:
        NotInvertible: If it does not exist, or the model has dead time: one output does not show the commands under way.
    """
    if any(design.model.input_delay):
        raise NotInvertible("Eq. (11b) has no memory of the commands under way in the dead time; use the observer")
    return static_reconstruction(design.model.C, design.model.D, design.K)


def static_reconstruction(
    C: Float[np.ndarray, "p n"], D: Float[np.ndarray, "p m"], K: Float[np.ndarray, "m n"]
) -> Float[np.ndarray, "n p"]:
    """Return the matrix that gives the state from an output: ``x_k = (C - DK)^-1 y_k``.

    Paper: Eq. (11b). Exists only with as many outputs as states; the noise is not filtered.

    Raises:
        NotInvertible: If C - DK is not square, or close to singular.
    """
    if C.shape[0] != C.shape[1]:
        raise NotInvertible(f"C - DK is {C.shape[0]}×{C.shape[1]}: Eq. (11b) needs as many outputs as states; use the observer")
    M = C - D @ K
    condition = float(np.linalg.cond(M))
    if not condition < CONDITION_LIMIT:
        raise NotInvertible(f"C - DK is singular to working precision (condition {condition:.1e}); use the observer")
    return np.asarray(np.linalg.inv(M))
