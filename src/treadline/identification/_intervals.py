"""Confidence intervals, to first order: of poles, impulse response and frequency response, and of functions of parameters.

A model carries directions: changes of (A, B, C, D) per unit of independent standard normal variables. For OKID/ERA the
directions follow from the covariance of the regression, propagated through Markov parameters and realisation. For refined
models they follow from the curvature of the cost. Both include the correlation of the residuals by a sandwich estimator
(Newey and West, 1987). The intervals do not include the effects of a wrong order, of nonlinearity, of the bias of a subspace
method with few lags, or of the model selection.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag
from scipy.special import gammaincinv

from treadline.core.arrays import CONFIDENCE, NORMAL_95, markov_parameters
from treadline.core.linear_systems import TESTED_LAGS, whiteness_p
from treadline.identification._affine import Affine
from treadline.identification._era import HankelSvd
from treadline.identification._factor import inverse
from treadline.identification._gram import Gram, Units
from treadline.identification._modes import Experiment
from treadline.identification._okid import ObserverMarkov, regression
from treadline.identification._recursion_kernels import tangents, unroll
from treadline.identification._refine import Directions, directions, jacobian

PORTION = 256
"""Number of directions propagated through the Hankel matrix at once."""
ENTRIES_MOST = 2_000_000
"""Largest number of derivatives in the curvature; the result is scaled to longer data."""
MATRIX_ENTRIES_MOST = 1_500
"""Largest number of entries of A, B, C and D with intervals; the gauge of more takes seconds to remove."""
SANDWICH_MOST = 400
"""Largest number of coefficients with a sandwich covariance, whose size is the square of this number."""
MEMORY_PER_LAG = 2
"""Lags of residual correlation per observer lag; white output noise leaves a moving average of the observer's length."""
MEMORY = 1.3
"""Lags of residual correlation per cube root of the number of samples (rate for Bartlett weights)."""


Linearisation = tuple[Float[np.ndarray, "_ d"], Float[np.ndarray, " _"]]
"""Derivatives along d parameters, and residuals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Value with the bounds of its interval of 95 %."""

    value: float
    low: float
    high: float


def estimate(
    value: Callable[[Float[np.ndarray, " k"]], float], theta: Float[np.ndarray, " k"], covariance: Float[np.ndarray, "k k"]
) -> Estimate:
    """Return a function of parameters with its interval."""
    at, steps = value(theta), 1e-6 * np.maximum(np.abs(theta), 1e-6)
    slope = np.array([(value(theta + step) - at) / step.sum() for step in np.diag(steps)])
    reach = NORMAL_95 * float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
    return Estimate(value=at, low=at - reach, high=at + reach)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConfidenceIntervals:
    """Standard deviations of poles and responses of a model."""

    system: Affine
    ways: Directions
    """Changes per standard normal variable; the sum of their squares is the variance."""
    units: Units

    def through(self, mixing: Float[np.ndarray, "m v"], units: Units) -> "ConfidenceIntervals":
        """Return the intervals after a change of inputs u = mixing·v, both in standard deviations.

        Args:
            mixing: Matrix from the new inputs to the old.
            units: Units with the new inputs.
        """
        # States and the constant stay as they are.
        turn = block_diag(np.eye(self.system.order), mixing, np.eye(1))
        ways = np.einsum("acd,cb->abd", self.ways, turn)
        return ConfidenceIntervals(system=self.system.with_block(self.system.block @ turn), ways=ways, units=units)

    def pole_radii(self) -> Float[np.ndarray, " n"]:
        """Return the radius of the disc about each pole that contains the true pole with 95 % probability.

        A real pole varies along the real axis; its disc is an interval. The squared distance of a complex pole, a sum of two
        squares, is approximated by its first two moments (Satterthwaite, 1946).
        """
        _, V = np.linalg.eig(self.system.A)
        W = np.linalg.inv(V)
        moves = np.einsum("in,nmk,mi->ik", W, self.ways[: len(V), : len(V)], V, optimize=True)
        parts = np.stack([moves.real, moves.imag], axis=1)
        S = parts @ parts.transpose(0, 2, 1)
        mean, square = np.trace(S, axis1=1, axis2=2), np.einsum("iab,iba->i", S, S)
        freedom = np.where(square > 0.0, mean**2 / np.maximum(square, 1e-300), 1.0)
        return np.sqrt(np.maximum(square, 0.0) / np.maximum(mean, 1e-300) * 2.0 * gammaincinv(0.5 * freedom, CONFIDENCE))

    def impulse(self, steps: int) -> Float[np.ndarray, "steps p m"]:
        """Return the standard deviation of the impulse response, in the record's units."""
        m, system = self.units.input_count, self.system
        found = np.empty((steps, len(system.C), m))
        for j in range(m):
            u = np.zeros((steps, system.B.shape[1]))
            u[0, j] = 1.0
            found[:, :, j] = np.linalg.norm(tangents(system.block, self.ways, u), axis=2)
        return found * self._gain_units()

    def frequency(self, omega: Float[np.ndarray, " w"]) -> Float[np.ndarray, "w p m"]:
        """Return the standard deviation of the magnitude of the frequency response, in the record's units.

        Args:
            omega: Frequencies [rad per sample].
        """
        s, m, n, p = self.system, self.units.input_count, self.system.order, len(self.system.C)
        std = np.empty((len(omega), p, m))
        for at, frequency in enumerate(omega):
            Phi = np.linalg.inv(np.exp(1j * frequency) * np.eye(n) - s.A)
            left, right = np.hstack([s.C @ Phi, np.eye(p)]), np.vstack([Phi @ s.B[:, :m], np.eye(m)])
            G = s.C @ right[:n] + s.D[:, :m]
            change = np.einsum("pn,nmk,mj->pjk", left, self.ways[:, : n + m], right, optimize=True)
            along = np.conj(G) / np.maximum(np.abs(G), 1e-300)
            std[at] = np.linalg.norm((along[:, :, None] * change).real, axis=2)
        return std * self._gain_units()

    def _gain_units(self) -> Float[np.ndarray, "p m"]:
        return self.units.output_scale[:, None] / self.units.input_scale


def of_observer(observer: ObserverMarkov, svd: HankelSvd, system: Affine, units: Units, data: Gram) -> ConfidenceIntervals:
    """Return the intervals of ERA's realisation of an observer, in standard deviations.

    With H = O·R of rank n, O and R fixed, perturbations dH and dH' change A by O⁺(dH' - dH·A)R⁺: the second term removes the
    change of state coordinates caused by dH.
    """
    n, (p, m) = system.order, observer.D.shape
    O, s, R = svd.leading(n)
    left, right = (O / s).T, R.T / s
    blocks, columns = left.shape[1] // p, right.shape[0] // m
    changes = markov_changes(observer, system, data, blocks + columns + 1)
    at = 1 + np.arange(blocks)[:, None] + np.arange(columns)
    parts = []
    for start in range(0, changes.shape[3], PORTION):
        Y = changes[:, :, :, start : start + PORTION]
        k = Y.shape[3]
        H, shifted = (Y[at + shift].transpose(0, 2, 1, 3, 4).reshape(blocks * p, columns * m, k) for shift in (0, 1))
        turn, moved = (right.T @ np.tensordot(left, h, axes=1) for h in (H, shifted))
        entering = np.tensordot(left, H[:, :m], axes=1)
        into_states = np.concatenate([moved - system.A.T @ turn, entering - system.B[:, :m].T @ turn], axis=1)
        into_outputs = np.concatenate([right.T @ H[:p], Y[0]], axis=1)
        parts.append(np.concatenate([into_states, into_outputs]))
    ways = np.pad(np.concatenate(parts, axis=2), ((0, 0), (0, 1), (0, 0)))  # the constant stays as it is
    return ConfidenceIntervals(system=system, ways=ways, units=units)


def _coefficient_changes(observer: ObserverMarkov, data: Gram) -> Float[np.ndarray, "q p k"]:
    """Return the changes of the regression coefficients per standard normal variable.

    Few lags leave correlated residuals. The covariance is then the sandwich ``P (Σ_l w_l R_l ⊗ Γ_l) P`` with P the inverse Gram
    matrix of the regressors, R_l its lagged version and Γ_l the residual autocovariance, all available from a Gram matrix with
    more lags. The weights are flat up to half the memory (Politis and Romano, 1995): near a lightly damped mode the residuals
    have no power, and weights decaying from lag zero would leak power from neighbouring frequencies.
    """
    lags, p, m = observer.alpha.shape
    found = regression(data, lags, feedthrough=observer.feedthrough)
    P, theta = inverse(found.information), found.theta
    q, r = len(P), m + p
    memory = min(data.lags - lags, MEMORY_PER_LAG * lags)
    if memory < 1 or q * p > SANDWICH_MOST:
        return np.einsum("qa,ps->qpas", _root(P), _root(observer.residual_covariance)).reshape(q, p, q * p)
    width = len(data.sums)
    columns = np.concatenate([np.arange(1 + m if observer.feedthrough else 1), np.arange(1 + r, 1 + r * (lags + 1))])
    S = np.zeros((q, p, q, p))
    for lag in range(memory + 1):
        later = columns + np.where(columns > 0, r * lag, 0)
        residual = np.zeros((2, p, width))
        for row, (at, y) in zip(residual, ((columns, 1 + m), (later, 1 + m + r * lag)), strict=True):
            row[:, at] = -theta.T
            row[np.arange(p), y + np.arange(p)] += 1.0
        cross = residual[0] @ data.sums @ residual[1].T / max(data.count - q, 1.0)
        term = np.einsum("ab,ij->aibj", data.sums[np.ix_(columns, later)], cross)
        S += term if lag == 0 else min(1.0, 2.0 - 2.0 * lag / (memory + 1.0)) * (term + term.transpose(2, 3, 0, 1))
    covariance = np.einsum("ab,bicj,cd->aidj", P, S, P, optimize=True).reshape(q * p, q * p)
    return _root(covariance).reshape(q, p, q * p)


def markov_changes(observer: ObserverMarkov, system: Affine, data: Gram, count: int) -> Float[np.ndarray, "count p m k"]:
    """Return the changes of the Markov parameters per standard normal variable.

    Y_k = α_k + Σ β_i Y_{k-i}: a change of α and β enters at k and propagates through the β.
    """
    lags, p, m = observer.alpha.shape
    changes = _coefficient_changes(observer, data)
    # Use the model's Markov parameters, not the observer's. Along directions that change the observer but not its system,
    # which are wide for any noise level, the derivative is zero only at an exact response.
    Y = markov_parameters(system.A, system.B[:, :m], system.C, system.D[:, :m], count)
    first, k = 1 + (m if observer.feedthrough else 0), changes.shape[2]
    entering = np.zeros((count, p, m, k))
    if observer.feedthrough:
        entering[0] = changes[1:first].transpose(1, 0, 2)
    lagged = changes[first:].reshape(lags, m + p, p, k)
    for at in range(1, count):
        reach = min(at, lags)
        if at <= lags:
            entering[at] = lagged[at - 1, :m].transpose(1, 0, 2)
        fed_back = np.tensordot(lagged[:reach, m:], Y[at - reach : at][::-1], axes=([0, 1], [0, 1]))
        entering[at] += fed_back.transpose(0, 2, 1)
    answers = unroll(np.eye(p), np.zeros_like(observer.beta), observer.beta, count)
    for at in range(count - 1, 0, -1):
        entering[at] = np.tensordot(answers[: at + 1], entering[at::-1], axes=([0, 2], [0, 1]))
    return entering


def of_refined(
    system: Affine, experiments: Sequence[Experiment], fixed: Bool[np.ndarray, "p m1"], units: Units
) -> ConfidenceIntervals | None:
    """Return the intervals of an output-error model; None for data too short to estimate them."""
    ways = _spread(system, experiments, fixed)
    return None if ways is None else ConfidenceIntervals(system=system, ways=ways, units=units)


def of_predicting(
    system: Affine, experiments: Sequence[Experiment], fixed: Bool[np.ndarray, "p m1"], units: Units
) -> ConfidenceIntervals | None:
    """Return the intervals of a prediction-error model; its experiments have the outputs as additional inputs."""
    p, n, K = len(system.C), system.order, system.K
    w = _spread(system.predictor(), experiments, np.hstack([fixed, np.ones((p, p), dtype=bool)]))
    if w is None or K is None:
        return None
    own, dK = w[:, :-p], w[:n, -p:]
    # A and B of the model are those of its predictor, and K [C, D].
    back = np.einsum("npk,pm->nmk", dK, system.block[n:]) + np.einsum("np,pmk->nmk", K, own[n:])
    return ConfidenceIntervals(system=system, ways=own + np.pad(back, ((0, p), (0, 0), (0, 0))), units=units)


def _spread(system: Affine, experiments: Sequence[Experiment], fixed: Bool[np.ndarray, "p m1"]) -> Directions | None:
    """Return the changes of a fit per standard normal variable, by the curvature of its cost.

    None for too few data or too large a model.
    """
    p = len(system.C)
    if (system.order + p) * (system.order + system.B.shape[1]) > MATRIX_ENTRIES_MOST:
        return None
    ways = directions(system, fixed)
    d = ways.shape[2]
    total, rows = sum(len(item.y) for item in experiments), ENTRIES_MOST // (p * d)
    shares = [max(rows * len(item.y) // max(total, rows), 1) for item in experiments]
    kept = [item.part(max(len(item.y) - share, 0), len(item.y)) for item, share in zip(experiments, shares, strict=True)]
    seen = sum(int(item.there.sum()) for item in kept)
    if seen * p <= 2 * d:
        return None
    scale = total / max(sum(len(item.y) for item in kept), 1)
    return np.asarray(ways @ _root(covariance_of([jacobian(system, item, ways) for item in kept], p, seen) / scale))


def covariance_of(pairs: Sequence[Linearisation], p: int, seen: int) -> Float[np.ndarray, "d d"]:
    """Return the covariance of coefficients by least squares; residuals may be correlated over samples.

    Args:
        pairs: Derivatives and residuals of each run; p rows are a sample.
        p: Number of outputs.
        seen: Number of samples without gaps.
    """
    d = pairs[0][0].shape[1]
    H = np.sum([J.T @ J for J, _ in pairs], axis=0)
    errors = [e.reshape(-1, p) for _, e in pairs]
    freedom = seen / (seen - d / p)
    memory = 0 if _white(errors) else min(int(MEMORY * seen ** (1.0 / 3.0)), seen // 4)
    S = np.zeros((d, d))
    for lag in range(memory + 1):
        cross = freedom * sum(e[lag:].T @ e[: len(e) - lag] for e in errors if len(e) > lag) / seen
        for J, e in pairs:
            steps = len(e) // p
            if steps <= lag:
                continue
            G = J.reshape(steps, p, d)
            late = np.ascontiguousarray(G[lag:].transpose(0, 2, 1)) @ cross
            term = late.transpose(1, 0, 2).reshape(d, -1) @ G[: steps - lag].reshape(-1, d)
            S += term if lag == 0 else (1.0 - lag / (memory + 1.0)) * (term + term.T)
    P = inverse(H)
    return np.asarray(P @ (0.5 * (S + S.T)) @ P)


def _white(errors: Sequence[Float[np.ndarray, "_ p"]]) -> bool:
    longest = max(errors, key=len)
    return len(longest) > 4 * TESTED_LAGS and whiteness_p(longest) > 1.0 - CONFIDENCE


def _root(covariance: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d d"]:
    """Return L with LL' = covariance; negative eigenvalues from rounding count as zero."""
    values, V = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(V * np.sqrt(np.maximum(values, 0.0)))
