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


@njit(cache=True)
@no_type_check
def run_residual(A, B, C, D, u, y, there, last):
    """Return the residual e of a free run from zero, and O'O and O'e over the first ``last`` steps with O the rows CA^k."""
    n, m, p, steps = A.shape[0], B.shape[1], C.shape[0], len(u)
    e, x, following = np.empty((steps, p)), np.zeros(n), np.empty(n)
    square, right = np.zeros((n, n)), np.zeros(n)
    rows, later = C.copy(), np.empty((p, n))
    for k in range(steps):
        for o in range(p):
            total = y[k, o]
            for i in range(n):
                total -= C[o, i] * x[i]
            for j in range(m):
                total -= D[o, j] * u[k, j]
            e[k, o] = total if there[k] else 0.0
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += A[i, j] * x[j]
            for j in range(m):
                total += B[i, j] * u[k, j]
            following[i] = total
        x[:] = following
        if k >= last:
            continue
        if there[k]:
            for o in range(p):
                for i in range(n):
                    right[i] += rows[o, i] * e[k, o]
                    for j in range(i + 1):
                        square[i, j] += rows[o, i] * rows[o, j]
        for o in range(p):
            for i in range(n):
                total = 0.0
                for j in range(n):
                    total += rows[o, j] * A[j, i]
                later[o, i] = total
        rows[:] = later
    for i in range(n):
        for j in range(i):
            square[j, i] = square[i, j]
    return e, square, right


@njit(cache=True)
@no_type_check
def subtract_initial_response(A, C, x0, there, last, e):
    """Subtract the response of x⁺ = Ax, y = Cx to an initial state from the first ``last`` residuals."""
    n, p = A.shape[0], C.shape[0]
    x, following = x0.copy(), np.empty(n)
    for k in range(last):
        for o in range(p):
            if there[k]:
                for i in range(n):
                    e[k, o] -= C[o, i] * x[i]
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += A[i, j] * x[j]
            following[i] = total
        x[:] = following


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
@no_type_check
def tangents(A, B, C, u, dA, dB, dC, dD):
    """Return a free run from zero and its derivatives along directions.

    Args:
        A, B, C: System matrices.
        u: Inputs (N, m).
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


@njit(cache=True, fastmath={"contract"})
@no_type_check
def modal_filters(real, imag, u, signals, decay_at):
    """Write the states of f⁺ = λf + u from zero and the decays λ^k, per pole and input, into columns of ``signals``.

    For a conjugate pair the first pole's columns hold the real part, the second's the imaginary part.

    Args:
        real, imag: Real and imaginary parts of the poles; conjugates are adjacent, positive imaginary part first.
        u: Inputs (N, m).
        signals: Output array; columns (pole, input) first, λ^k from column ``decay_at`` on.
        decay_at: First column of the decays.
    """
    n, m, steps = len(real), u.shape[1], len(u)
    i = 0
    while i < n:
        a, b = real[i], imag[i]
        here, there = i * m, (i + 1) * m
        if b == 0.0:
            for j in range(m):
                signals[0, here + j] = 0.0
            signals[0, decay_at + i] = 1.0
            for k in range(1, steps):
                for j in range(m):
                    signals[k, here + j] = a * signals[k - 1, here + j] + u[k - 1, j]
                signals[k, decay_at + i] = a * signals[k - 1, decay_at + i]
            i += 1
            continue
        for j in range(m):
            signals[0, here + j] = signals[0, there + j] = 0.0
        signals[0, decay_at + i], signals[0, decay_at + i + 1] = 1.0, 0.0
        for k in range(1, steps):
            for j in range(m):
                re, im = signals[k - 1, here + j], signals[k - 1, there + j]
                signals[k, here + j] = a * re - b * im + u[k - 1, j]
                signals[k, there + j] = a * im + b * re
            re, im = signals[k - 1, decay_at + i], signals[k - 1, decay_at + i + 1]
            signals[k, decay_at + i], signals[k, decay_at + i + 1] = a * re - b * im, a * im + b * re
        i += 2


@njit(cache=True, fastmath={"contract"})
@no_type_check
def modal_run(real, imag, B, C, D, u, y, there, signals, state_at, error_at):
    """Write the modal states and the output residuals into columns, from the filter states in the first columns."""
    n, m, p, steps = len(real), u.shape[1], y.shape[1], len(u)
    for k in range(steps):
        for o in range(p):
            total = y[k, o]
            for j in range(m):
                total -= D[o, j] * u[k, j]
            signals[k, error_at + o] = total
        i = 0
        while i < n:
            re, im, pair = 0.0, 0.0, imag[i] != 0.0
            for j in range(m):
                f = signals[k, i * m + j]
                if pair:
                    g = signals[k, (i + 1) * m + j]
                    re += B[i, j].real * f - B[i, j].imag * g
                    im += B[i, j].real * g + B[i, j].imag * f
                else:
                    re += B[i, j].real * f
            signals[k, state_at + i] = re
            if pair:
                signals[k, state_at + i + 1] = im
            for o in range(p):
                signals[k, error_at + o] -= 2.0 * (C[o, i].real * re - C[o, i].imag * im) if pair else C[o, i].real * re
            i += 2 if pair else 1
        if not there[k]:
            for o in range(p):
                signals[k, error_at + o] = 0.0


@njit(cache=True, fastmath={"contract"})
@no_type_check
def modal_chain(real, imag, start, C, there, signals, chain_at, decay_at, state_at, error_at):
    """Add the response to the initial state ``start`` and write the sensitivities to λ, the states of g⁺ = λg + x."""
    n, p, steps = len(real), C.shape[0], len(signals)
    for k in range(steps):
        i = 0
        while i < n:
            pair = imag[i] != 0.0
            re, im = signals[k, decay_at + i], signals[k, decay_at + i + 1] if pair else 0.0
            dx, dy = start[i].real * re - start[i].imag * im, start[i].real * im + start[i].imag * re
            signals[k, state_at + i] += dx
            a, b = real[i], imag[i]
            if pair:
                signals[k, state_at + i + 1] += dy
                if k == 0:
                    signals[k, chain_at + i] = signals[k, chain_at + i + 1] = 0.0
                else:
                    g, h = signals[k - 1, chain_at + i], signals[k - 1, chain_at + i + 1]
                    signals[k, chain_at + i] = a * g - b * h + signals[k - 1, state_at + i]
                    signals[k, chain_at + i + 1] = a * h + b * g + signals[k - 1, state_at + i + 1]
            elif k == 0:
                signals[k, chain_at + i] = 0.0
            else:
                signals[k, chain_at + i] = a * signals[k - 1, chain_at + i] + signals[k - 1, state_at + i]
            if there[k]:
                for o in range(p):
                    signals[k, error_at + o] -= 2.0 * (C[o, i].real * dx - C[o, i].imag * dy) if pair else C[o, i].real * dx
            i += 2 if pair else 1


@njit(cache=True)
@no_type_check
def modal_products(products, partner, C, mode, own):
    """Return J'J and J'e of complex columns from the products of their real and imaginary parts.

    The first columns act on all outputs through C (``mode``: column of C); the next ``own`` columns act on a single output
    each; the last columns are the residuals e.

    Args:
        products: Products of the real columns.
        partner: Offset from a column to its imaginary part (first of a pair) or, negative, to its real part (second).
        C: Modal output matrix.
        mode: Mode of each shared column.
        own: Number of columns that act on a single output.
    """
    p, shared, size = C.shape[0], len(mode), len(products)
    half = np.empty((size, size), dtype=np.complex128)
    for a in range(size):
        k = partner[a]
        for b in range(size):
            if k > 0:
                half[a, b] = complex(products[a, b], -products[a + k, b])
            elif k < 0:
                half[a, b] = complex(products[a + k, b], products[a, b])
            else:
                half[a, b] = products[a, b]
    whole = np.empty((size, size), dtype=np.complex128)
    for b in range(size):
        k = partner[b]
        for a in range(size):
            if k > 0:
                whole[a, b] = half[a, b] + 1j * half[a, b + k]
            elif k < 0:
                whole[a, b] = half[a, b + k] - 1j * half[a, b]
            else:
                whole[a, b] = half[a, b]
    width = shared + p * own
    square, right = np.zeros((width, width), dtype=np.complex128), np.zeros(width, dtype=np.complex128)
    for a in range(shared):
        for b in range(shared):
            weight = 0.0j
            for o in range(p):
                weight += np.conj(C[o, mode[a]]) * C[o, mode[b]]
            square[a, b] = weight * whole[a, b]
        for o in range(p):
            c = np.conj(C[o, mode[a]])
            right[a] += c * whole[a, shared + own + o]
            for b in range(own):
                square[a, shared + o * own + b] = c * whole[a, shared + b]
                square[shared + o * own + b, a] = np.conj(square[a, shared + o * own + b])
    for o in range(p):
        for a in range(own):
            right[shared + o * own + a] = whole[shared + a, shared + own + o]
            for b in range(own):
                square[shared + o * own + a, shared + o * own + b] = whole[shared + a, shared + b]
    return square, right


@njit(cache=True)
@no_type_check
def without_columns(square, right, start, stop, inverse):
    """Return normal equations with some columns eliminated (Schur complement), given the inverse of their block."""
    width, n = len(right), stop - start
    kept = width - n
    left, rest = np.empty((kept, kept), dtype=np.complex128), np.empty(kept, dtype=np.complex128)
    cross = np.empty(n, dtype=np.complex128)
    for a in range(kept):
        row = a if a < start else a + n
        for i in range(n):
            total = 0.0j
            for j in range(n):
                total += square[row, start + j] * inverse[j, i]
            cross[i] = total
        total = right[row]
        for i in range(n):
            total -= cross[i] * right[start + i]
        rest[a] = total
        for b in range(kept):
            column = b if b < start else b + n
            total = square[row, column]
            for i in range(n):
                total -= cross[i] * square[start + i, column]
            left[a, b] = total
    return left, rest


@njit(cache=True)
@no_type_check
def gauge_directions(A, B, C, constant):
    """Return the changes of (A, B, C, D) under dx = Xx, one column per entry of X, and under a shift of each state.

    Rows hold A, B, C and D in this order; ``constant`` is the index of the constant input.
    """
    n, m, p = A.shape[0], B.shape[1], C.shape[0]
    at_B, at_C, at_D = n * n, n * n + n * m, n * n + n * m + p * n
    found = np.zeros((at_D + p * m, n * n + n))
    for i in range(n):
        for j in range(n):
            column = i * n + j
            for k in range(n):
                found[i * n + k, column] += A[j, k]
                found[k * n + j, column] -= A[k, i]
            for k in range(m):
                found[at_B + i * m + k, column] = B[j, k]
            for o in range(p):
                found[at_C + o * n + j, column] = -C[o, i]
            found[at_B + i * m + constant, n * n + j] = (1.0 if i == j else 0.0) - A[i, j]
        for o in range(p):
            found[at_D + o * m + constant, n * n + i] = -C[o, i]
    return found


@njit(cache=True)
@no_type_check
def all_pole(a, x):
    """Return the columns of x filtered by 1 / (1 + a_1 q⁻¹ + … + a_n q⁻ⁿ)."""
    made = x.copy()
    for t in range(1, len(x)):
        for k in range(1, min(len(a), t) + 1):
            for c in range(x.shape[1]):
                made[t, c] -= a[k - 1] * made[t - k, c]
    return made
