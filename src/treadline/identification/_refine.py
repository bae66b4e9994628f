"""Output-error and prediction-error refinement: Gauss–Newton on the free run or the one-step prediction.

Only directions that change the input-output behaviour are searched; similarity transforms and state shifts are excluded
(data-driven local coordinates: McKelvey, Helmersson and Ribarits, 2004). The initial state of each experiment enters
linearly and is eliminated exactly (variable projection: Golub and Pereyra, 1973). The prediction error of (A, B, C, D, K)
is the output error of its predictor with the outputs as additional inputs, so one routine serves both.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Num
from scipy.linalg import lapack

from treadline.core.arrays import store_contiguous
from treadline.core.linear_system_kernels import observability
from treadline.core.linear_systems import prefix
from treadline.core.models import InputOutputRecord
from treadline.identification._affine import ON_CIRCLE, WELL_SEEN, Affine, Modes, derivative_sums, modes_of
from treadline.identification._gram import Units, runs_of
from treadline.identification._recursion_kernels import (
    gauge_directions,
    run_residual,
    subtract_initial_response,
    tangents,
)

TRIES = 8
"""Largest number of damping increases per step before the refinement ends."""


STEPS_MOST = 60
"""Largest number of steps."""
CHANCE = 0.1
"""Relative tolerance: the refinement ends below this share of the gain of one random coefficient, 1/samples of the cost."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment:
    """Unbroken run in standard deviations: inputs with a column of ones, outputs, and a mask of valid samples."""

    u: Float[np.ndarray, "T m1"]
    y: Float[np.ndarray, "T p"]
    there: Bool[np.ndarray, " T"]

    def __post_init__(self) -> None:
        store_contiguous(self)

    def part(self, start: int, stop: int) -> "Experiment":
        """Return the samples ``start … stop - 1``."""
        at = slice(start, stop)
        return Experiment(u=self.u[at], y=self.y[at], there=self.there[at])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Directions:
    """Changes of (A, B, C, D) per unit of each of d parameters."""

    A: Float[np.ndarray, "n n d"]
    B: Float[np.ndarray, "n m1 d"]
    C: Float[np.ndarray, "p n d"]
    D: Float[np.ndarray, "p m1 d"]

    def __post_init__(self) -> None:
        store_contiguous(self)

    def along(self, root: Float[np.ndarray, "d k"]) -> "Directions":
        """Return the changes along each column of ``root``."""
        return Directions(A=self.A @ root, B=self.B @ root, C=self.C @ root, D=self.D @ root)

    def through(self, mixing: Float[np.ndarray, "m v"]) -> "Directions":
        """Return the changes after a change of inputs u = mixing·v."""
        return Directions(A=self.A, B=mixed(self.B, mixing), C=self.C, D=mixed(self.D, mixing))

    def moved(self, system: Affine, step: Float[np.ndarray, " d"]) -> Affine:
        """Return the system after a step along the directions."""
        return replace(
            system, A=system.A + self.A @ step, B=system.B + self.B @ step, C=system.C + self.C @ step, D=system.D + self.D @ step
        )


def mixed(matrix: Float[np.ndarray, "n m1 *d"], mixing: Float[np.ndarray, "m v"]) -> Float[np.ndarray, "n v1 *d"]:
    """Return the matrix for inputs v with u = mixing·v; the last column, for the offsets, is unchanged."""
    m = len(mixing)
    return np.concatenate([np.einsum("nm...,mv->nv...", matrix[:, :m], mixing), matrix[:, m:]], axis=1)


def experiments_of(records: Sequence[InputOutputRecord], units: Units) -> list[Experiment]:
    """Return the records in standard deviations, split at missing inputs; missing outputs are masked."""
    made = []
    m = units.input_count
    for record in records:
        u, y = (record.u - units.shift[:m]) / units.input_scale, (record.y - units.shift[m:]) / units.output_scale
        there = np.isfinite(y).all(axis=1)
        whole = Experiment(
            u=np.column_stack([u, np.ones(len(u))]),
            y=y if there.all() else np.where(there[:, None], y, 0.0),
            there=there,
        )
        known = np.isfinite(u).all(axis=1)
        made += [whole] if known.all() else [whole.part(*run) for run in runs_of(known)]
    return made


def predictors_of(experiments: Sequence[Experiment], least: int) -> list[Experiment]:
    """Return the experiments with the outputs as additional inputs, split at missing outputs."""
    made = []
    for item in experiments:
        for start, stop in runs_of(item.there):
            if stop - start >= least:
                run = item.part(start, stop)
                made.append(Experiment(u=np.hstack([run.u, run.y]), y=run.y, there=run.there))
    return made


def residual(system: Affine, experiment: Experiment) -> Float[np.ndarray, "T p"]:
    """Return the residual of a free run from the least-squares initial state; zero at a missing output."""
    x0, e, last = _from_best_start(system, experiment)
    subtract_initial_response(system.A, system.C, x0, experiment.there, last, e)
    return e


def fair_residual(system: Affine, experiment: Experiment) -> Float[np.ndarray, "T p"]:
    """Return the residual of a free run whose initial state fits the first samples alone (``prefix``); zero at a missing output."""
    steps = len(experiment.y)
    x0 = initial_state(system, experiment.part(0, prefix(steps, system.order, len(system.C))))
    e, _, _ = run_residual(system.A, system.B, system.C, system.D, experiment.u, experiment.y, experiment.there, 1)
    subtract_initial_response(system.A, system.C, x0, experiment.there, _lasting(system, steps), e)
    return e


def _from_best_start(system: Affine, experiment: Experiment) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "T p"], int]:
    """Return the least-squares initial state, the residual of a run from zero, and the steps over which the start matters."""
    last = _lasting(system, len(experiment.y))
    e, square, right = run_residual(system.A, system.B, system.C, system.D, experiment.u, experiment.y, experiment.there, last)
    return _solution(square, right[:, None])[:, 0], e, last


def cost(system: Affine, experiments: Sequence[Experiment]) -> float:
    """Return the sum of squared free-run residuals; infinite for a diverging run."""
    with np.errstate(all="ignore"):
        total = sum(float(np.vdot(e, e)) for e in (residual(system, item) for item in experiments))
    return total if np.isfinite(total) else float("inf")


def refined(system: Affine, experiments: Sequence[Experiment], *, fixed: Bool[np.ndarray, "p m1"]) -> Affine:
    """Return the local minimum of the output error.

    Args:
        system: Initial model.
        experiments: Data.
        fixed: Mask of the entries of D that stay unchanged.
    """
    return descended(system, experiments, lambda now: directions(now, fixed))


def descended(
    system: Affine,
    experiments: Sequence[Experiment],
    ways_from: Callable[[Affine], Directions],
    *,
    ceiling: float = 1.0,
) -> Affine:
    """Return the minimum of the output error along directions that may depend on the current system.

    Args:
        system: Initial model.
        experiments: Data.
        ways_from: Function from a system to its search directions.
        ceiling: Largest allowed spectral radius of a stable system.
    """
    # A stable system stays stable: a growing mode would fit only these data.
    # A system on the unit circle may move by an amount without visible effect over the record.
    radius, rows = system.radius, sum(item.y.size for item in experiments)
    bound = ceiling if radius < 1.0 - ON_CIRCLE else radius * (1.0 + 1.0 / rows)
    best, now = system, cost(system, experiments)
    damping, rise = 1e-3, 2.0
    enough = CHANCE / rows
    for _ in range(STEPS_MOST if np.isfinite(now) else 0):
        ways = ways_from(best)
        H, g = normal_equations(best, experiments, ways)
        if not np.trace(H) > 0.0:  # no direction changes the outputs
            break
        before = now
        for _ in range(TRIES):
            step = np.linalg.solve(H + damping * np.trace(H) / len(H) * np.eye(len(H)), g)
            trial = ways.moved(best, step)
            there = cost(trial, experiments) if trial.radius <= bound else float("inf")
            if there < now:
                # Nielsen (1999): the better the quadratic model predicted the gain, the smaller the next damping.
                predicted_gain = float(2.0 * step @ g - step @ H @ step)
                damping *= max(0.1, 1.0 - (2.0 * (now - there) / predicted_gain - 1.0) ** 3)
                best, now, rise = trial, there, 2.0
                break
            damping, rise = damping * rise, rise * 2.0
        if before - now <= enough * before:
            break
    return best


def normal_equations(
    system: Affine, experiments: Sequence[Experiment], ways: Directions
) -> tuple[Float[np.ndarray, "d d"], Float[np.ndarray, " d"]]:
    """Return J'J and J'e with initial states eliminated, in modal coordinates or, for nearly equal poles, by recursion."""
    modes = modes_of(system)
    if modes is not None and np.abs(modes.poles).max() < 1.0 + 1e-9:
        M = _modal_changes(modes, system, ways)
        sums = [derivative_sums(modes, system, item.u, item.y, item.there) for item in experiments]
        square, right = sum(item.square for item in sums), sum(item.right for item in sums)
        if not np.iscomplexobj(M):  # real poles: the imaginary part is zero
            return M.T @ square.real @ M, M.T @ right.real
        across = M.conj().T
        return (across @ square @ M).real, (across @ right).real
    d = ways.A.shape[2]
    H, g = np.zeros((d, d)), np.zeros(d)
    for item in experiments:
        J, e = jacobian(system, item, ways)
        H += J.T @ J
        g += J.T @ e
    return H, g


def _modal_changes(modes: Modes, system: Affine, ways: Directions) -> Num[np.ndarray, "w d"]:
    """Return the changes of modal B, of λ, and of C and D per output, along directions.

    The diagonal of dA in modal coordinates moves the poles; the off-diagonal part rotates the modes (first order in both).
    """
    n, m1, p, d = system.order, system.B.shape[1], len(system.C), ways.A.shape[2]
    dA = (modes.W @ ways.A.reshape(n, n * d)).reshape(n, n, d)
    dA = (modes.V.T @ dA.transpose(1, 0, 2).reshape(n, n * d)).reshape(n, n, d).transpose(1, 0, 2)
    apart = modes.poles[None, :] - modes.poles[:, None]
    np.fill_diagonal(apart, 1.0)
    turn = dA / apart[:, :, None]
    turn[np.arange(n), np.arange(n)] = 0.0
    B = modes.W @ system.B
    dB = (modes.W @ ways.B.reshape(n, m1 * d)).reshape(n, m1, d) - B.T @ turn
    dC = modes.V.T @ ways.C + (modes.C @ turn.reshape(n, n * d)).reshape(p, n, d)
    own = np.concatenate([dC, ways.D], axis=1).reshape(p * (n + m1), d)
    return np.concatenate([dB.reshape(n * m1, d), dA[np.arange(n), np.arange(n)], own])


def jacobian(
    system: Affine, experiment: Experiment, ways: Directions
) -> tuple[Float[np.ndarray, "rows d"], Float[np.ndarray, " rows"]]:
    """Return the derivatives of a free run along directions and its residual; the initial state is eliminated."""
    run_from = initial_state(system, experiment)
    n, d = system.order, ways.A.shape[2]
    # The initial state acts as an impulse on an additional input, one sample earlier.
    u = np.vstack([np.zeros((1, experiment.u.shape[1])), experiment.u])
    u = np.column_stack([u, np.zeros(len(u))])
    u[0, -1] = 1.0
    B = np.column_stack([system.B, run_from])
    dB = np.concatenate([ways.B, np.zeros((n, 1, d))], axis=1)
    dD = np.concatenate([ways.D, np.zeros((len(system.C), 1, d))], axis=1)
    states, J = tangents(system.A, B, system.C, u, ways.A, dB, ways.C, dD)
    states, J = states[1:], J[1:]
    e = experiment.y - states @ system.C.T - experiment.u @ system.D.T
    if not experiment.there.all():
        J[~experiment.there] = 0.0
        e[~experiment.there] = 0.0
    O = _start_rows(system, experiment).reshape(-1, n)
    flat = J.reshape(-1, d)
    flat[: len(O)] -= O @ _solution(O.T @ O, O.T @ flat[: len(O)])
    return flat, e.ravel()


def directions(system: Affine, fixed: Bool[np.ndarray, "p m1"]) -> Directions:
    """Return the directions that change the system's behaviour, orthogonal to changes of state coordinates."""
    n, m1, p = system.order, system.B.shape[1], len(system.C)
    constant = system.D.shape[1] - 1 if not fixed[:, -1].all() else int(np.flatnonzero(~fixed.all(axis=0))[-1])
    free = np.flatnonzero(~fixed.ravel())
    sizes = np.cumsum([n * n, n * m1, p * n, free.size])
    gauge = gauge_directions(system.A, system.B, system.C, constant)
    if free.size < p * m1:
        gauge = gauge[np.concatenate([np.arange(sizes[2]), sizes[2] + free])]
    Q = _complement(gauge)
    D = Q[sizes[2] :]
    if free.size < p * m1:
        D = np.zeros((p * m1, Q.shape[1]))
        D[free] = Q[sizes[2] :]
    return Directions(
        A=Q[: sizes[0]].reshape(n, n, -1),
        B=Q[sizes[0] : sizes[1]].reshape(n, m1, -1),
        C=Q[sizes[1] : sizes[2]].reshape(p, n, -1),
        D=D.reshape(p, m1, -1),
    )


def _complement(columns: Float[np.ndarray, "a b"]) -> Float[np.ndarray, "a c"]:
    """Return an orthonormal basis of the orthogonal complement of the columns."""
    a, b = columns.shape
    whole = np.zeros((a, a), order="F")
    whole[:, :b], tau, _, _ = lapack.dgeqrf(columns)
    Q, _, _ = lapack.dorgqr(whole, np.concatenate([tau, np.zeros(a - b)]), overwrite_a=1)
    return np.ascontiguousarray(Q[:, b:])


def initial_state(system: Affine, experiment: Experiment) -> Float[np.ndarray, " n"]:
    """Return the least-squares initial state of a free run."""
    return _from_best_start(system, experiment)[0]


def _lasting(system: Affine, steps: int) -> int:
    """Return the number of steps over which an initial state affects the outputs."""
    if system.radius >= 0.999:
        return steps
    # Below 1e-9 the initial state is negligible; 20 n allows for transient growth before the decay.
    return min(steps, int(20.0 * system.order + math.log(1e-9) / math.log(max(system.radius, 1e-3))))


def _start_rows(system: Affine, experiment: Experiment) -> Float[np.ndarray, "K p n"]:
    """Return the effect of the initial state on the outputs over its significant steps."""
    last = _lasting(system, len(experiment.y))
    O = observability(system.A, system.C, last)
    if not experiment.there[:last].all():
        O[~experiment.there[:last]] = 0.0
    return np.asarray(O)


def _solution(square: Float[np.ndarray, "n n"], right: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Return the solution of normal equations; unobservable directions stay zero."""
    L, failed = lapack.dpotrf(square, lower=1, clean=0)
    pivots = np.diag(L)
    if not failed and pivots.min() > WELL_SEEN * pivots.max():
        return np.asarray(lapack.dpotrs(L, right, lower=1)[0])
    if not np.isfinite(square).all():
        return np.full(right.shape, np.nan)  # a diverging system has infinite cost
    values, V = np.linalg.eigh(square)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.asarray((V[:, kept] / values[kept]) @ (V[:, kept].T @ right))
