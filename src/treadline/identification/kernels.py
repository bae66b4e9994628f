"""Loops of identification that arrays cannot express: recursions in time, compiled.

``no_type_check`` keeps the tests' shape checker from wrapping what numba compiles.
"""

from typing import no_type_check

import numpy as np
from numba import njit


@njit(cache=True)
@no_type_check
def slide(first, head, tail, into):
    """Fill a Gram matrix of windows from its first block row.

    Block (i+1, j+1) is block (i, j) with the window one sample earlier: one product enters, one leaves.

    Args:
        first: Block row 0, (r, q) with q = r (p + 1).
        head: Samples p-1, …, 0 of the segment, (p·r): what enters.
        tail: Samples N-1, …, N-p of the segment, (p·r): what leaves.
        into: (q, q); the sums are added.
    """
    r, q = first.shape
    work = np.empty((q, q))
    for a in range(r):
        for b in range(q):
            work[a, b] = first[a, b]
    for a in range(r, q):
        for b in range(a - a % r, q):
            work[a, b] = work[a - r, b - r] + head[a - r] * head[b - r] - tail[a - r] * tail[b - r]
    for a in range(q):
        for b in range(q):
            into[a, b] += work[a, b] if b >= a else work[b, a]


@njit(cache=True)
@no_type_check
def lagged_products(z, start, stop, limit, sums):
    """Add Σ z_t z'_{t-l} over t = start … stop-1 and t-l < limit to ``sums[l]``, for every lag that stays within z."""
    lags, r = sums.shape[0] - 1, z.shape[1]
    for t in range(start, stop):
        for l in range(max(0, t - limit + 1), min(lags, t) + 1):
            for a in range(r):
                for b in range(r):
                    sums[l, a, b] += z[t, a] * z[t - l, b]


@njit(cache=True)
@no_type_check
def normalise(u, y, shift, scale, z):
    """Write (u, y) less shift over scale into z; return the number of samples that are not finite."""
    m, p, gaps = u.shape[1], y.shape[1], 0
    for t in range(len(u)):
        whole = True
        for j in range(m):
            z[t, j] = (u[t, j] - shift[j]) / scale[j]
            whole &= np.isfinite(z[t, j])
        for j in range(p):
            z[t, m + j] = (y[t, j] - shift[m + j]) / scale[m + j]
            whole &= np.isfinite(z[t, m + j])
        gaps += not whole
    return gaps


@njit(cache=True)
@no_type_check
def column_moments(x, about, into):
    """Add number, sum and sum of squares of each column about a value to ``into``; a NaN does not count."""
    for t in range(len(x)):
        for j in range(x.shape[1]):
            v = x[t, j] - about[j]
            if v == v:
                into[0, j] += 1.0
                into[1, j] += v
                into[2, j] += v * v


@njit(cache=True)
@no_type_check
def fold(within, across, lags, r, sums):
    """Add up the blocks of X'X and of X'X₊ (X: rows of b samples, X₊: the rows after) along equal lags."""
    b = within.shape[0] // r
    for i in range(b):
        for j in range(b):
            later = i - j
            if 0 <= later <= lags:
                for c in range(r):
                    for d in range(r):
                        sums[later, c, d] += within[i * r + c, j * r + d]
            later = b + j - i
            if later <= lags:
                for c in range(r):
                    for d in range(r):
                        sums[later, d, c] += across[i * r + c, j * r + d]


@njit(cache=True)
@no_type_check
def unroll(direct, alpha, beta, count):
    """Return Y_0 = D, Y_k = α_k + Σ β_i Y_{k-i}."""
    lags, p, m = alpha.shape
    Y = np.zeros((count, p, m))
    Y[0] = direct
    for k in range(1, count):
        if k <= lags:
            Y[k] = alpha[k - 1]
        for i in range(1, min(k, lags) + 1):
            for a in range(p):
                for c in range(p):
                    for b in range(m):
                        Y[k, a, b] += beta[i - 1, a, c] * Y[k - i, c, b]
    return Y


@njit(cache=True)
@no_type_check
def hankel_matrix(markov, rows, columns, shift):
    """Return the matrix whose block (i, j) is Y_{1 + shift + i + j}."""
    _, p, m = markov.shape
    H = np.empty((rows * p, columns * m))
    for i in range(rows):
        for a in range(p):
            for j in range(columns):
                for b in range(m):
                    H[i * p + a, j * m + b] = markov[1 + shift + i + j, a, b]
    return H


@njit(cache=True)
@no_type_check
def free_run(A, B, C, D, x0, u):
    """Return the outputs of x⁺ = Ax + Bu, y = Cx + Du from x0."""
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
@no_type_check
def observability(A, C, steps):
    """Return C, CA, CA², …, (steps, p, n)."""
    n, p = A.shape[0], C.shape[0]
    rows = np.empty((steps, p, n))
    for o in range(p):
        for i in range(n):
            rows[0, o, i] = C[o, i]
    for k in range(1, steps):
        for o in range(p):
            for i in range(n):
                total = 0.0
                for j in range(n):
                    total += rows[k - 1, o, j] * A[j, i]
                rows[k, o, i] = total
    return rows


@njit(cache=True)
@no_type_check
def observer_run(A, closed, drive, correction, whole, x0):
    """Return the states of x⁺ = (A - LC) x + drive + correction; where y is missing, of x⁺ = Ax + drive."""
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


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
@no_type_check
def tangents(A, B, C, u, dA, dB, dC, dD):
    """Return a free run from zero and its derivatives along directions.

    Args:
        dA, dB, dC, dD: Changes of the matrices per unit of each of d parameters: (n, n, d), (n, m, d), (p, n, d), (p, m, d).

    Returns:
        States (N, n) and derivatives of the outputs (N, p, d).
    """
    n, m, p, d, steps = A.shape[0], B.shape[1], C.shape[0], dA.shape[2], len(u)
    states, J = np.empty((steps, n)), np.empty((steps, p, d))
    x, following = np.zeros(n), np.zeros(n)
    dx, next_dx = np.zeros((n, d)), np.zeros((n, d))
    for k in range(steps):
        for o in range(p):
            row = J[k, o]
            for e in range(d):
                row[e] = 0.0
            for i in range(n):
                c, v = C[o, i], x[i]
                for e in range(d):
                    row[e] += c * dx[i, e] + v * dC[o, i, e]
            for j in range(m):
                v = u[k, j]
                for e in range(d):
                    row[e] += v * dD[o, j, e]
        for i in range(n):
            states[k, i] = x[i]
            total = 0.0
            row = next_dx[i]
            for e in range(d):
                row[e] = 0.0
            for j in range(n):
                a, v = A[i, j], x[j]
                total += a * v
                for e in range(d):
                    row[e] += a * dx[j, e] + v * dA[i, j, e]
            for j in range(m):
                v = u[k, j]
                total += B[i, j] * v
                for e in range(d):
                    row[e] += v * dB[i, j, e]
            following[i] = total
        x, following = following, x
        dx, next_dx = next_dx, dx
    return states, J


@njit(cache=True)
@no_type_check
def modal_filters(poles, u):
    """Return the states of x⁺ = λx + u from zero, and λ^k, for each pole: (N, poles, inputs + 1)."""
    n, m, steps = len(poles), u.shape[1], len(u)
    states = np.zeros((steps, n, m + 1), dtype=np.complex128)
    for i in range(n):
        states[0, i, m] = 1.0
    for k in range(1, steps):
        for i in range(n):
            for j in range(m):
                states[k, i, j] = poles[i] * states[k - 1, i, j] + u[k - 1, j]
            states[k, i, m] = poles[i] * states[k - 1, i, m]
    return states


@njit(cache=True)
@no_type_check
def modal_chain(poles, x):
    """Return the states of g⁺ = λg + x from zero, pole by pole: how an output answers to a change of λ."""
    steps, n = x.shape
    states = np.zeros((steps, n), dtype=np.complex128)
    for k in range(1, steps):
        for i in range(n):
            states[k, i] = poles[i] * states[k - 1, i] + x[k - 1, i]
    return states
