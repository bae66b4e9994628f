"""Compiled loops of identification: recursions in time that array operations cannot express.

``no_type_check`` keeps the tests' shape checker from wrapping functions compiled by numba.
"""

from typing import no_type_check

import numpy as np

from treadline.core.kernel_cache import njit


@njit(cache=True)
@no_type_check
def slide(first, head, tail, into):
    """Add the Gram matrix of windows with a given first block row.

    Block (i+1, j+1) is block (i, j) for the window one sample earlier: one product is added, one is subtracted.

    Args:
        first: Block row 0, (r, q) with q = r (p + 1).
        head: Samples p-1, …, 0 of the segment, (p·r), of the added products.
        tail: Samples N-1, …, N-p of the segment, (p·r), of the subtracted products.
        into: Matrix (q, q) to which the result is added.
    """
    r, q = first.shape
    work = np.empty((q, q))
    work[:r] = first
    for a in range(r, q):
        for b in range(a - a % r, q):
            work[a, b] = work[a - r, b - r] + head[a - r] * head[b - r] - tail[a - r] * tail[b - r]
    for a in range(q):
        for b in range(a, q):
            into[a, b] += work[a, b]
            if b > a:
                into[b, a] += work[a, b]


@njit(cache=True)
@no_type_check
def normalise(u, y, shift, scale, z):
    """Write the normalised (u, y) into z; return the number of samples with a non-finite value."""
    m, p, gaps = u.shape[1], y.shape[1], 0
    for t in range(len(u)):
        whole = True
        for j in range(m + p):
            z[t, j] = ((u[t, j] if j < m else y[t, j - m]) - shift[j]) / scale[j]
            whole &= np.isfinite(z[t, j])
        gaps += not whole
    return gaps


@njit(cache=True)
@no_type_check
def column_moments(x, about, into):
    """Add count, sum and sum of squares of each column about a value to ``into``; NaN values are left out."""
    for t in range(len(x)):
        for j in range(x.shape[1]):
            v = x[t, j] - about[j]
            if v == v:
                into[0, j] += 1.0
                into[1, j] += v
                into[2, j] += v * v


@njit(cache=True)
@no_type_check
def unroll(direct, alpha, beta, count):
    """Return the Markov parameters Y_0 = D, Y_k = α_k + Σ β_i Y_{k-i}."""
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
    """Return the block Hankel matrix with block (i, j) = Y_{1 + shift + i + j}."""
    _, p, m = markov.shape
    H = np.empty((rows * p, columns * m))
    for i in range(rows):
        for a in range(p):
            for j in range(columns):
                for b in range(m):
                    H[i * p + a, j * m + b] = markov[1 + shift + i + j, a, b]
    return H


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
@no_type_check
def tangents(A, B, C, u, dA, dB, dC, dD):
    """Return the derivatives of the outputs (N, p, d) of a free run from zero along directions.

    Args:
        A, B, C: System matrices.
        u: Inputs (N, m).
        dA, dB, dC, dD: Changes of the matrices per unit of each of d parameters: (n, n, d), (n, m, d), (p, n, d), (p, m, d).
    """
    n, m, p, d, steps = A.shape[0], B.shape[1], C.shape[0], dA.shape[2], len(u)
    J = np.empty((steps, p, d))
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
    return J


@njit(cache=True)
@no_type_check
def pole_filters(poles, x, each):
    """Return the states of f⁺ = λf + x from zero for each pole, of all columns or of each pole's own: (N, poles, columns)."""
    steps, k = x.shape[0], 1 if each else x.shape[1]
    states = np.zeros((steps, len(poles), k), dtype=np.complex128)
    for t in range(1, steps):
        for h in range(len(poles)):
            for j in range(k):
                states[t, h, j] = poles[h] * states[t - 1, h, j] + x[t - 1, h if each else j]
    return states
