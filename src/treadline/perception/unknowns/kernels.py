"""The edges' direction with what nobody knows of stair and camera integrated out, compiled.

Rows ``by · x = value`` with a noise each; x holds the warp's terms first and α and ρ last. All rows of a step turn with it by
one angle of variance τ² and tilt by another of variance κ², which Woodbury's identity takes out of the covariance; the warp's terms
have a prior of one size. τ, κ and that size run over grids and count by their evidence, beforehand by a small power of their size.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

SCEPTICISM = 0.2
"""Power of its size by which each irregularity and warp is the likelier beforehand."""
FLAT = 4.0
"""Prior precision of α and ρ: half a radian, next to nothing."""


@njit(cache=True, error_model="numpy")
@no_type_check
def integrated_out(by, value, noise, turn_by, tilt_by, step, steps, turns, tilts, warps, covariance):
    """Return the mean of x, and the variances and covariance of α and ρ; fill ``covariance`` with x's at the likeliest guess.

    Args:
        noise: Variance of each row.
        turn_by: How a row's value changes with the turn of its step, and ``tilt_by`` with its tilt.
        step: Number of each row's step, below ``steps``; -1 for a row that belongs to none.
        turns: Standard deviations τ, ``tilts`` κ and ``warps`` of the warp's terms that are tried.
    """
    n = by.shape[1]
    size = turns.size * tilts.size * warps.size
    logs, means, spreads = np.empty(size), np.empty((size, n)), np.empty((size, 3))
    M, L, x = np.zeros((n + 1, n + 1)), np.zeros((n, n)), np.empty(n)
    plain, turned, tilted = np.zeros((n + 1, n + 1)), np.zeros((steps, n + 1)), np.zeros((steps, n + 1))
    own = np.zeros((steps, 3))
    _gather(by, value, noise, turn_by, tilt_by, step, plain, turned, tilted, own)
    _try_all(plain, turned, tilted, own, turns, tilts, warps, M, L, x, logs, means, spreads)
    best = np.argmax(logs)
    belief = np.exp(logs - logs[best])
    belief /= belief.sum()
    mean, spread = np.zeros(n), np.zeros(3)
    for k in range(size):
        mean += belief[k] * means[k]
    for k in range(size):
        a, r = means[k, n - 2] - mean[n - 2], means[k, n - 1] - mean[n - 1]
        spread[0] += belief[k] * (spreads[k, 0] + a * a)
        spread[1] += belief[k] * (spreads[k, 1] + r * r)
        spread[2] += belief[k] * (spreads[k, 2] + a * r)
    pair = best // warps.size
    turn, tilt = turns[pair // tilts.size], tilts[pair % tilts.size]
    _take_out(plain, turned, tilted, own, turn * turn, tilt * tilt, M)
    _solved(M, warps[best % warps.size], L, x)
    inverse = np.linalg.inv(L)
    covariance[:] = inverse.T @ inverse
    return mean, spread


@njit(cache=True, error_model="numpy")
@no_type_check
def strays(by, value, noise, turn_by, tilt_by, step, steps, turns, tilts, warps, penalty, kept):
    """Clear ``kept`` of the rows that the evidence says belong to something else, one after the other, the plainest first.

    Args:
        penalty: What the log evidence loses by calling a row a stray; infinite for one that cannot be.
    """
    rows, size = value.size, by.shape[1] + 1
    whole = noise.copy()
    plain, turned, tilted = np.zeros((size, size)), np.zeros((steps, size)), np.zeros((steps, size))
    own, M, L, x = np.zeros((steps, 3)), np.zeros((size, size)), np.zeros((size - 1, size - 1)), np.empty(size - 1)
    for _ in range(rows // 3):
        least, stray = 0.0, -1
        for k in range(-1, rows):
            if k >= 0 and (not kept[k] or not np.isfinite(penalty[k])):
                continue
            if k >= 0:
                whole[k] = np.inf
            plain[:], turned[:], tilted[:], own[:] = 0.0, 0.0, 0.0, 0.0
            _gather(by, value, whole, turn_by, tilt_by, step, plain, turned, tilted, own)
            log = _evidence(plain, turned, tilted, own, turns, tilts, warps, M, L, x)
            if k < 0:
                least = log
                continue
            whole[k] = noise[k]
            # What the row itself adds by its noise; a stray may be anywhere.
            log += 0.5 * math.log(2.0 * math.pi * noise[k]) - penalty[k]
            if log > least:
                least, stray = log, k
        if stray < 0:
            break
        kept[stray] = False
        whole[stray] = np.inf


@njit(cache=True, error_model="numpy")
@no_type_check
def _evidence(plain, turned, tilted, own, turns, tilts, warps, M, L, x):
    """Return the log evidence of all rows, up to their noise, with the irregularities and the warp integrated out."""
    logs = np.empty(turns.size * tilts.size * warps.size)
    none = np.empty((0, 0))
    _try_all(plain, turned, tilted, own, turns, tilts, warps, M, L, x, logs, none, none)
    best = logs.max()
    return best + math.log(np.exp(logs - best).mean())


@njit(cache=True, error_model="numpy")
@no_type_check
def _try_all(plain, turned, tilted, own, turns, tilts, warps, M, L, x, logs, means, spreads):
    """Fill ``logs`` with the log evidence of each guess at τ, κ and the warp's size.

    Args:
        means: Filled with x of each, ``spreads`` with the variances and covariance of α and ρ; empty where nobody asks.
    """
    n, at = L.shape[0], 0
    for turn in turns:
        for tilt in tilts:
            log = _take_out(plain, turned, tilted, own, turn * turn, tilt * tilt, M)
            for warp in warps:
                logs[at] = log + _solved(M, warp, L, x) + SCEPTICISM * math.log(turn * tilt * warp)
                if means.size:
                    means[at] = x
                    # The last two unknowns' part of the inverse needs the last corner of L alone.
                    first, last = 1.0 / L[n - 2, n - 2], 1.0 / L[n - 1, n - 1]
                    both = -L[n - 1, n - 2] * first * last
                    spreads[at, 0], spreads[at, 1], spreads[at, 2] = first * first + both * both, last * last, both * last
                at += 1


@njit(cache=True, error_model="numpy")
@no_type_check
def _gather(by, value, noise, turn_by, tilt_by, step, plain, turned, tilted, own):
    """Add up the normal equations without turns and tilts, values in the last row, and what each step has in common.

    Args:
        plain: Filled in its lower half.
        turned: Filled with each step's sums that a turn takes part in, ``tilted`` a tilt, ``own`` the squares and product of both.
    """
    rows, n = by.shape
    full = np.empty(n + 1)
    for k in range(rows):
        P = 1.0 / noise[k]
        full[:n] = by[k]
        full[n] = value[k]
        for i in range(n + 1):
            for j in range(i + 1):
                plain[i, j] += P * full[i] * full[j]
        s = step[k]
        if s >= 0:
            a, d = turn_by[k], tilt_by[k]
            own[s, 0] += P * a * a
            own[s, 1] += P * d * d
            own[s, 2] += P * a * d
            for i in range(n + 1):
                turned[s, i] += P * a * full[i]
                tilted[s, i] += P * d * full[i]


@njit(cache=True, error_model="numpy")
@no_type_check
def _take_out(plain, turned, tilted, own, turn, tilt, M):
    """Fill the lower half of ``M`` with the normal equations under variances of turn and tilt; return the log evidence of these."""
    size = M.shape[0]
    M[:] = plain
    log = 0.0
    for s in range(own.shape[0]):
        a, d, both = 1.0 + turn * own[s, 0], 1.0 + tilt * own[s, 1], own[s, 2]
        det = a * d - turn * tilt * both * both
        log -= 0.5 * math.log(det)
        a, d, both = tilt * a / det, turn * d / det, -turn * tilt * both / det
        for i in range(size):
            for j in range(i + 1):
                M[i, j] -= (
                    d * turned[s, i] * turned[s, j]
                    + a * tilted[s, i] * tilted[s, j]
                    + both * (turned[s, i] * tilted[s, j] + tilted[s, i] * turned[s, j])
                )
    return log


@njit(cache=True, error_model="numpy")
@no_type_check
def _solved(M, warp, L, x):
    """Fill ``L`` with the Cholesky factor under a prior of the warp's terms, ``x`` with the solution; return its log evidence."""
    n = L.shape[0]
    prior = 1.0 / (warp * warp)
    log, misfit = 0.5 * (n - 2) * math.log(prior), M[n, n]
    for i in range(n + 1):
        # The last row is the right-hand side: its factor is L⁻¹ times it.
        for j in range(min(i, n - 1) + 1):
            s = M[i, j]
            if i == j:
                s += prior if i < n - 2 else FLAT
            for k in range(j):
                s -= (L[i, k] if i < n else x[k]) * L[j, k]
            if i == j:
                L[i, i] = math.sqrt(s)
                log -= math.log(L[i, i])
            elif i < n:
                L[i, j] = s / L[j, j]
            else:
                x[j] = s / L[j, j]
                misfit -= x[j] * x[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return log - 0.5 * misfit


@njit(cache=True, error_model="numpy")
@no_type_check
def fitted_terms(columns, top, bottom, points, width, height, fx, fy, cx, cy, turns):
    """Fill ``turns`` with the n that fits each Legendre product best at the top, middle and bottom of ``points`` columns."""
    M, right = np.zeros((3, 3)), np.zeros((3, turns.shape[1]))
    ray, across, down = np.ones(3), np.ones(4), np.ones(4)
    points = min(points, columns.shape[0])
    for point in range(points):
        k = point * (columns.shape[0] - 1) // (points - 1)
        ray[0] = (columns[k] - cx) / fx
        _legendre(2.0 * columns[k] / (width - 1.0) - 1.0, across)
        for part in range(3):
            v = top[k] + 0.5 * part * (bottom[k] - top[k])
            ray[1] = (v - cy) / fy
            _legendre(2.0 * v / (height - 1.0) - 1.0, down)
            for a in range(3):
                for b in range(3):
                    M[a, b] += ray[a] * ray[b]
                term = 0
                for i in range(4):
                    for j in range(4):
                        if 0 < i + j <= 3:
                            right[a, term] += ray[a] * down[i] * across[j]
                            term += 1
    turns[:] = np.linalg.solve(M, right)


@njit(cache=True, error_model="numpy")
@no_type_check
def _legendre(x, values):
    values[1], values[2], values[3] = x, 1.5 * x * x - 0.5, (2.5 * x * x - 1.5) * x
