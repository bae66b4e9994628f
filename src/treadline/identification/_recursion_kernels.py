"""Compiled loops of identification: recursions in time that array operations cannot express."""

import numpy as np

from treadline.core.kernel_cache import njit


@njit(cache=True)
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


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def tangents(S, dS, u):
    """Return the derivatives of the outputs (N, p, d) of a free run [x⁺; y] = S [x; u] from zero along directions.

    Args:
        S: System matrix [[A, B], [C, D]] (n + p, n + m).
        dS: Its changes per unit of each of d parameters (n + p, n + m, d).
        u: Inputs (N, m).
    """
    (rows, columns, d), steps = dS.shape, len(u)
    n = columns - u.shape[1]
    J, z, following = np.empty((steps, rows - n, d)), np.zeros(columns), np.zeros(rows)
    dx, moved = np.zeros((n, d)), np.zeros((rows, d))
    for k in range(steps):
        z[n:] = u[k]
        for a in range(rows):
            total, row = 0.0, moved[a]
            row[:] = 0.0
            for i in range(columns):
                v = z[i]
                total += S[a, i] * v
                for e in range(d):
                    row[e] += v * dS[a, i, e]
            for i in range(n):
                c = S[a, i]
                for e in range(d):
                    row[e] += c * dx[i, e]
            following[a] = total
        J[k] = moved[n:]
        dx[:], z[:n] = moved[:n], following[:n]
    return J


@njit(cache=True)
def pole_filters(poles, x):
    """Return the states of f⁺ = λf + x from zero for each pole and each column: (N, poles, columns)."""
    steps, k = x.shape
    states = np.zeros((steps, len(poles), k), dtype=np.complex128)
    for t in range(1, steps):
        for h in range(len(poles)):
            for j in range(k):
                states[t, h, j] = poles[h] * states[t - 1, h, j] + x[t - 1, j]
    return states
