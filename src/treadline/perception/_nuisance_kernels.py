"""Normal equations under many covariances, compiled."""

import math

import numpy as np

from treadline.core.kernel_cache import njit


@njit(cache=True, error_model="numpy")
def normal_equations(noise, shared, squares, right):
    """Return -½ log |S| and rightᵀ S⁻¹ right for each covariance S = diag(noise) + Σ_m squares[g, m] shared[m].

    Args:
        squares: One row for each covariance.
    """
    k, n = right.shape
    logs, products = np.zeros(squares.shape[0]), np.zeros((squares.shape[0], n, n))
    rows = np.empty((k, k + n))
    for g in range(squares.shape[0]):
        rows[:, :k], rows[:, k:] = 0.0, right
        for m in range(shared.shape[0]):
            for i in range(k):
                for j in range(i, k):
                    rows[i, j] += squares[g, m] * shared[m, i, j]
        # Elimination of the upper half: the right-hand sides become those of Cholesky's factor, times its diagonal.
        for i in range(k):
            rows[i, i] += noise[i]
        for i in range(k):
            pivot = rows[i, i]
            logs[g] -= 0.5 * math.log(pivot)
            for r in range(i + 1, k):
                factor = rows[i, r] / pivot
                for c in range(r, k + n):
                    rows[r, c] -= factor * rows[i, c]
            for a in range(n):
                for b in range(n):
                    products[g, a, b] += rows[i, k + a] * rows[i, k + b] / pivot
    return logs, products
