"""Posterior of the edge direction with the nuisance parameters of stair and camera marginalised, compiled.

Equations ``by · x = value`` with known noise; x holds the warp coefficients first and α and ρ last. All equations of a step share
one rotation of variance τ² and one tilt of variance κ², which are eliminated from the covariance by Woodbury's identity; the warp
coefficients have a common prior scale. τ, κ and that scale run over grids, weighted by their evidence and by ``prior``.
"""

import math
from typing import no_type_check

import numpy as np

from treadline.core.fma import dot
from treadline.core.kernel_cache import njit

LEFT_OUT = 0.05
"""Probability below which a hypothesis does not enter the moments: what the data do not determine, such as a curvature seen at one
step only, would otherwise dominate the variance with its tail."""
FLAT = 4.0
"""Prior precision of α and ρ [1/rad²]: half a radian, nearly uninformative."""


@njit(cache=True, error_model="numpy")
@no_type_check
def marginal_posterior(
    by, value, noise, turn_by, tilt_by, step, steps, turns, tilts, warps, prior, present, logs_of, scales, terms, covariance
):
    """Return the posterior of x: its mean, variances and covariance of α and ρ, probabilities of hypotheses, square of the warp.

    ``covariance`` is filled with the covariance of x at the mode.

    Args:
        noise: Variance of each equation.
        turn_by: Derivative of each value with respect to the rotation of its step, and ``tilt_by`` to its tilt.
        step: Step index of each equation, below ``steps``; -1 for none.
        turns: Grid of standard deviations τ, ``tilts`` of κ and ``warps`` of the warp coefficients.
        prior: Logarithm of the prior, one row per pair of τ and κ.
        present: Mask of the nuisance directions of each hypothesis, ``logs_of`` its log prior, and
            ``scales`` a factor on the sizes of its warp.
        terms: Number of warp coefficients.
    """
    n, kinds = by.shape[1], present.shape[0]
    pairs = turns.size * tilts.size
    size = pairs * warps.size * kinds
    logs, means, spreads = np.empty(size), np.zeros((size, n)), np.empty((size, 3))
    M, L, of_pair, of_warp = _room(n, pairs)
    plain, turned, tilted = np.zeros((n + 1, n + 1)), np.zeros((steps, n + 1)), np.zeros((steps, n + 1))
    own = np.zeros((steps, 3))
    _gather(by, value, noise, turn_by, tilt_by, step, plain, turned, tilted, own)
    _take_out(plain, turned, tilted, own, turns, tilts, M, of_pair)
    for kind in range(kinds):
        active = _active(present[kind])
        m = active.size
        for w in range(warps.size):
            _solved(M, active, terms, scales[kind] * warps[w], L, of_warp)
            for pair in range(pairs):
                at = (kind * pairs + pair) * warps.size + w
                logs[at] = of_pair[pair] + of_warp[pair] + prior[pair, w] + logs_of[kind]
                for i in range(m):
                    means[at, active[i]] = L[m, i, pair]
                # The block of the inverse for the last two unknowns depends on the last corner of L only.
                first, last = 1.0 / L[m - 2, m - 2, pair], 1.0 / L[m - 1, m - 1, pair]
                both = -L[m - 1, m - 2, pair] * first * last
                spreads[at, 0], spreads[at, 1], spreads[at, 2] = first * first + both * both, last * last, both * last
    best = np.argmax(logs)
    belief = np.exp(logs - logs[best])
    belief /= belief.sum()
    mean, spread, of_kind, warp = np.zeros(n), np.zeros(3), np.zeros(kinds), 0.0
    each = pairs * warps.size
    for k in range(size):
        of_kind[k // each] += belief[k]
    # An interval of 95 % leaves out hypotheses that are less likely than the rest of it.
    for k in range(size):
        if of_kind[k // each] < LEFT_OUT:
            belief[k] = 0.0
    belief /= belief.sum()
    for k in range(size):
        mean += belief[k] * means[k]
        warp += belief[k] * (scales[k // each] * warps[k % warps.size]) ** 2
    for k in range(size):
        a, r = means[k, n - 2] - mean[n - 2], means[k, n - 1] - mean[n - 1]
        spread[0] += belief[k] * (spreads[k, 0] + a * a)
        spread[1] += belief[k] * (spreads[k, 1] + r * r)
        spread[2] += belief[k] * (spreads[k, 2] + a * r)
    kind = best // each
    active = _active(present[kind])
    pair, m = best // warps.size % pairs, active.size
    turn, tilt = pair // tilts.size, pair % tilts.size
    M, L, of_pair, of_warp = _room(n, 1)
    _take_out(plain, turned, tilted, own, turns[turn : turn + 1], tilts[tilt : tilt + 1], M, of_pair)
    _solved(M, active, terms, scales[kind] * warps[best % warps.size], L, of_warp)
    inverse = np.linalg.inv(L[:m, :m, 0].copy())
    inverse = inverse.T @ inverse
    covariance[:] = 0.0
    for i in range(m):
        for j in range(m):
            covariance[active[i], active[j]] = inverse[i, j]
    return mean, spread, of_kind, warp


@njit(cache=True, error_model="numpy")
@no_type_check
def _active(present):
    """Return the indices of the unknowns of a hypothesis: its nuisance directions, α and ρ."""
    active, count = np.empty(present.size + 2, dtype=np.int64), 0
    for i in range(present.size):
        if present[i]:
            active[count] = i
            count += 1
    active[count], active[count + 1] = present.size, present.size + 1
    return active[: count + 2]


@njit(cache=True, error_model="numpy")
@no_type_check
def reject_outliers(by, value, noise, turn_by, tilt_by, step, steps, turns, tilts, warps, prior, terms, penalty, kept):
    """Clear ``kept`` of the equations rejected by the evidence, one after the other, the clearest first.

    Args:
        penalty: Loss of log evidence by the rejection of an equation; infinite for one that must be kept.
    """
    rows, size = value.size, by.shape[1] + 1
    whole = noise.copy()
    plain, turned, tilted = np.zeros((size, size)), np.zeros((steps, size)), np.zeros((steps, size))
    own, room = np.zeros((steps, 3)), _room(size - 1, turns.size * tilts.size)
    active = np.arange(size - 1)
    for _ in range(rows // 3):
        least, stray = 0.0, -1
        for k in range(-1, rows):
            if k >= 0 and (not kept[k] or not np.isfinite(penalty[k])):
                continue
            if k >= 0:
                whole[k] = np.inf
            plain[:], turned[:], tilted[:], own[:] = 0.0, 0.0, 0.0, 0.0
            _gather(by, value, whole, turn_by, tilt_by, step, plain, turned, tilted, own)
            log = _evidence(plain, turned, tilted, own, turns, tilts, warps, prior, active, terms, room)
            if k < 0:
                least = log
                continue
            whole[k] = noise[k]
            # Evidence of the single equation: Gaussian noise, or uniform for an outlier.
            log += 0.5 * math.log(2.0 * math.pi * noise[k]) - penalty[k]
            if log > least:
                least, stray = log, k
        if stray < 0:
            break
        kept[stray] = False
        whole[stray] = np.inf


@njit(cache=True, error_model="numpy")
@no_type_check
def _room(n, pairs):
    """Return work arrays for ``n`` unknowns under each pair of irregularities: normal equations, factors, two log evidences.

    Pairs are the last axis for vectorisation.
    """
    return np.zeros((n + 1, n + 1, pairs)), np.zeros((n + 1, n, pairs)), np.empty(pairs), np.empty(pairs)


@njit(cache=True, error_model="numpy")
@no_type_check
def _evidence(plain, turned, tilted, own, turns, tilts, warps, prior, active, terms, room):
    """Return the log evidence of all equations, up to their noise, with irregularities and warp marginalised."""
    M, L, of_pair, of_warp = room
    logs = np.empty(turns.size * tilts.size * warps.size)
    _take_out(plain, turned, tilted, own, turns, tilts, M, of_pair)
    for w in range(warps.size):
        _solved(M, active, terms, warps[w], L, of_warp)
        for pair in range(of_pair.size):
            logs[pair * warps.size + w] = of_pair[pair] + of_warp[pair] + prior[pair, w]
    best = logs.max()
    return best + math.log(np.exp(logs - best).sum())


@njit(cache=True, error_model="numpy")
@no_type_check
def _gather(by, value, noise, turn_by, tilt_by, step, plain, turned, tilted, own):
    """Accumulate the normal equations without rotations and tilts, values in the last row, and the common sums of each step.

    Args:
        plain: Filled in its lower half.
        turned: Filled with each step's sums with the rotation, ``tilted`` with the tilt, ``own`` the squares and product of both.
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
def _take_out(plain, turned, tilted, own, turns, tilts, M, logs):
    """Fill the lower half of ``M`` with the normal equations for each pair of rotation and tilt, ``logs`` with log evidences."""
    steps, size, pairs = own.shape[0], M.shape[0], logs.size
    of_turn, of_tilt, of_both = np.empty((steps, pairs)), np.empty((steps, pairs)), np.empty((steps, pairs))
    logs[:] = 0.0
    for s in range(steps):
        for pair in range(pairs):
            turn, tilt = turns[pair // tilts.size] ** 2, tilts[pair % tilts.size] ** 2
            a, d, both = 1.0 + turn * own[s, 0], 1.0 + tilt * own[s, 1], own[s, 2]
            det = a * d - turn * tilt * both * both
            logs[pair] -= 0.5 * math.log(det)
            of_turn[s, pair], of_tilt[s, pair], of_both[s, pair] = turn * d / det, tilt * a / det, -turn * tilt * both / det
    for i in range(size):
        for j in range(i + 1):
            sums = M[i, j]
            sums[:] = plain[i, j]
            for s in range(steps):
                a, b, c, d = turned[s, i], turned[s, j], tilted[s, i], tilted[s, j]
                both = a * d + c * b
                for pair in range(pairs):
                    sums[pair] -= of_turn[s, pair] * a * b + of_tilt[s, pair] * c * d + of_both[s, pair] * both


@njit(cache=True, error_model="numpy")
@no_type_check
def _solved(M, active, terms, warp, L, logs):
    """Fill ``L`` with Cholesky factors for some of the unknowns, its last row with the solutions; ``logs`` as above.

    Args:
        active: Indices of the unknowns, increasing: warp coefficients with a prior of size ``warp``, directions with a prior of
            one, α and ρ.
    """
    n, pairs, last = active.size, logs.size, M.shape[0] - 1
    least = 1.0 / (warp * warp)
    for i in range(n + 1):
        # The last row is the right-hand side: its factor is L⁻¹ times the right-hand side.
        row = active[i] if i < n else last
        for j in range(min(i, n - 1) + 1):
            s, add = L[i, j], 0.0
            if i == j:
                add = least if row < terms else FLAT if i >= n - 2 else 1.0
            for pair in range(pairs):
                s[pair] = M[row, active[j], pair] + add
            for k in range(j):
                for pair in range(pairs):
                    s[pair] -= L[i, k, pair] * L[j, k, pair]
            for pair in range(pairs):
                s[pair] = math.sqrt(s[pair]) if i == j else s[pair] / L[j, j, pair]
    for pair in range(pairs):
        log, residual = 0.5 * terms * math.log(least), M[last, last, pair]
        for i in range(n):
            log -= math.log(L[i, i, pair])
            residual -= L[n, i, pair] * L[n, i, pair]
        logs[pair] = log - 0.5 * residual
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for pair in range(pairs):
                L[n, i, pair] -= L[k, i, pair] * L[n, k, pair]
        for pair in range(pairs):
            L[n, i, pair] /= L[i, i, pair]


@njit(cache=True, error_model="numpy")
@no_type_check
def variances(covariances, direction):
    """Return the variance along a direction for each covariance."""
    found, row = np.empty(covariances.shape[0]), np.empty(3)
    for k in range(covariances.shape[0]):
        for i in range(3):
            row[i] = dot(direction, covariances[k, :, i])
        found[k] = dot(row, direction)
    return found


@njit(cache=True, error_model="numpy")
@no_type_check
def turns_of_plane(columns, top, bottom, points, width, height, pinhole, plane, sizes, readout, rate, drift, turns):
    """Fill ``turns`` with the change of n that fits each direction best at the top, middle and bottom of ``points`` columns.

    Args:
        plane: n of the surface.
        sizes: Standard deviations of the warp terms, ``rate`` of the angular rates.
        drift: Velocity of the camera for each unit of motion.
        turns: Columns as in ``nuisance``; those of spread, detour and curvature are left at zero.
    """
    fx, fy, cx, cy = pinhole
    terms = sizes.size
    M, right = np.zeros((3, 3)), np.zeros((3, turns.shape[1]))
    ray, across, down, error = np.ones(3), np.ones(4), np.ones(4), np.zeros(turns.shape[1])
    by_motion = np.empty((4, 3))
    for k in range(4):
        along = dot(plane, drift[k])
        for i in range(3):
            by_motion[k, i] = along * plane[i]
    # n × e_k for the rate about each axis.
    by_motion[0, 1] += rate * plane[2]
    by_motion[0, 2] -= rate * plane[1]
    by_motion[1, 0] -= rate * plane[2]
    by_motion[1, 2] += rate * plane[0]
    by_motion[2, 0] += rate * plane[1]
    by_motion[2, 1] -= rate * plane[0]
    points = min(points, columns.shape[0])
    for point in range(points):
        k = point * (columns.shape[0] - 1) // (points - 1)
        ray[0] = (columns[k] - cx) / fx
        _legendre(2.0 * columns[k] / (width - 1.0) - 1.0, across)
        for part in range(3):
            v = top[k] + 0.5 * part * (bottom[k] - top[k])
            ray[1] = (v - cy) / fy
            _legendre(2.0 * v / (height - 1.0) - 1.0, down)
            term = 0
            for i in range(4):
                for j in range(4):
                    if 0 < i + j <= 3:
                        error[term] = sizes[term] * down[i] * across[j]
                        term += 1
            after = readout * (v / height - 0.5)
            for i in range(4):
                error[terms + 3 + i] = after * dot(by_motion[i], ray)
            for a in range(3):
                for b in range(3):
                    M[a, b] += ray[a] * ray[b]
                for b in range(error.size):
                    right[a, b] += ray[a] * error[b]
    turns[:] = np.linalg.solve(M, right)


@njit(cache=True, error_model="numpy")
@no_type_check
def _legendre(x, values):
    values[1], values[2], values[3] = x, 1.5 * x * x - 0.5, (2.5 * x * x - 1.5) * x
