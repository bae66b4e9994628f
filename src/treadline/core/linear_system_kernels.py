"""Compiled recursions of a linear system: free run and observer, which array operations cannot express."""

import numpy as np

from treadline.core.kernel_cache import njit


@njit(cache=True)
def free_run(A, B, C, D, x0, u):
    """Return the outputs of x⁺ = Ax + Bu, y = Cx + Du from the initial state x0."""
    n, m, p, steps = A.shape[0], B.shape[1], C.shape[0], len(u)
    y, x, following = np.empty((steps, p)), x0.copy(), np.empty(n)
    for k in range(steps):
        for o in range(p):
            total = 0.0
            for i in range(n):
                total += C[o, i] * x[i]
            for j in range(m):
                total += D[o, j] * u[k, j]
            y[k, o] = total
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += A[i, j] * x[j]
            for j in range(m):
                total += B[i, j] * u[k, j]
            following[i] = total
        x[:] = following
    return y


@njit(cache=True)
def observer_run(A, closed, drive, correction, whole, x0):
    """Return the states of x⁺ = (A - LC) x + drive + correction, or of x⁺ = Ax + drive at a missing y."""
    steps, n = drive.shape
    states, x, following = np.empty((steps, n)), x0.copy(), np.empty(n)
    for k in range(steps):
        states[k] = x
        M = closed if whole[k] else A
        for i in range(n):
            total = drive[k, i] + correction[k, i]
            for j in range(n):
                total += M[i, j] * x[j]
            following[i] = total
        x[:] = following
    return states
