"""Static state reconstruction from one output, as in the paper (Eq. 11b)."""

import numpy as np
from jaxtyping import Float

from treadline.core.errors import NotInvertible

CONDITION_LIMIT = 1e6
"""Condition number above which one unit in the last place of a 16-bit sensor changes the state by its own size."""


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
