"""Output-error and prediction-error refinement: Gauss–Newton on the free run or the one-step prediction.

Only directions that change the input-output behaviour are searched; similarity transforms and state shifts are excluded
(data-driven local coordinates: McKelvey, Helmersson and Ribarits, 2004). The initial state of each experiment enters
linearly and is eliminated exactly (variable projection: Golub and Pereyra, 1973). The prediction error of (A, B, C, D, K)
is the output error of its predictor with the outputs as additional inputs, so one routine serves both.
"""

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.arrays import observability
from treadline.core.linear_system_kernels import free_run
from treadline.core.linear_systems import prefix
from treadline.core.models import InputOutputRecord
from treadline.identification._affine import Affine
from treadline.identification._factor import solved
from treadline.identification._gram import Units, runs_of
from treadline.identification._modes import Experiment
from treadline.identification._recursion_kernels import tangents

TRIES = 8
"""Largest number of damping increases per step before the descent ends."""
STEPS_MOST = 60
"""Largest number of steps."""

CHANCE = 0.1
"""Relative tolerance: the refinement ends below this share of the gain of one random coefficient, 1/samples of the cost."""

Point = TypeVar("Point")
Linearised = tuple[
    Float[np.ndarray, "d d"], Float[np.ndarray, " d"], Float[np.ndarray, " d"], Callable[[Float[np.ndarray, " d"]], Point]
]
"""J'J and J'e at a point, for which a full step would solve J'J step = J'e; the damping's diagonal; the point after a step.

Of parameters with units the diagonal is that of J'J (Marquardt); of parameters in a basis that means nothing it is the same for
all (Levenberg), so that the step does not depend on the basis.
"""


Directions = Float[np.ndarray, "n_and_p n_and_m1 d"]
"""Changes of the system matrix [[A, B], [C, D]] per unit of each of d parameters."""


def experiments_of(records: Sequence[InputOutputRecord], units: Units) -> list[Experiment]:
    """Return the records in standard deviations, split at missing inputs; missing outputs are masked."""
    made = []
    m = units.input_count
    for record in records:
        # In place, because temporary arrays of a long record are as large as the record.
        u, y = np.ones((len(record), m + 1)), record.y - units.shift[m:]
        np.subtract(record.u, units.shift[:m], out=u[:, :m])
        u[:, :m] /= units.input_scale
        y /= units.output_scale
        there = np.isfinite(y).all(axis=1)
        y[~there] = 0.0
        whole = Experiment(u=u, y=y, there=there)
        known = np.asarray(np.isfinite(u).all(axis=1))
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
    return _started(system, experiment, len(experiment.y))[0]


def fair_residual(system: Affine, experiment: Experiment) -> Float[np.ndarray, "T p"]:
    """Return the residual of a free run whose initial state fits the first samples alone (``prefix``); zero at a missing output."""
    return _started(system, experiment, prefix(len(experiment.y), system.order, len(system.C)))[0]


def _started(
    system: Affine, experiment: Experiment, first: int
) -> tuple[Float[np.ndarray, "T p"], Float[np.ndarray, " n"], Float[np.ndarray, "K n"]]:
    """Return the residual of a free run, its initial state, which fits the first samples, and the outputs' dependence on it."""
    n, p, there = system.order, len(system.C), experiment.there
    last = _lasting(system, len(experiment.y))
    e = experiment.y - free_run(system.A, system.B, system.C, system.D, np.zeros(n), experiment.u)
    O = observability(system.A, system.C, last)
    if not there.all():
        e[~there], O[~there[:last]] = 0.0, 0.0
    O, seen = O.reshape(-1, n), slice(0, min(first, last) * p)
    x0 = solved(O[seen].T @ O[seen], O[seen].T @ e.reshape(-1, 1)[seen])[:, 0]
    e[:last] -= (O @ x0).reshape(-1, p)
    return e, x0, O


def cost(system: Affine, experiments: Sequence[Experiment]) -> float:
    """Return the sum of squared free-run residuals; infinite for a diverging run."""
    with np.errstate(all="ignore"):
        total = sum(float(np.vdot(e, e)) for e in (residual(system, item) for item in experiments))
    return total if np.isfinite(total) else float("inf")


Bound = Callable[[Affine], Affine]
"""Function from a system to the nearest one with bounded poles."""


def refined(
    system: Affine, experiments: Sequence[Experiment], *, fixed: Bool[np.ndarray, "p m1"], bounded: Bound = lambda system: system
) -> Affine:
    """Return the local minimum of the output error.

    Args:
        system: Initial model.
        experiments: Data.
        fixed: Mask of the entries of D that stay unchanged.
        bounded: Bound of the poles, held at each step: a bound put on the minimum would leave B, C and D fitted to other poles.
    """
    return refit(system, experiments, lambda now: directions(now, fixed), bounded=bounded)


def refit(
    system: Affine,
    experiments: Sequence[Experiment],
    ways_from: Callable[[Affine], Directions],
    *,
    ceiling: float = 1.0,
    bounded: Bound = lambda system: system,
) -> Affine:
    """Return the minimum of the output error along directions that may depend on the current system.

    Args:
        system: Initial model.
        experiments: Data.
        ways_from: Function from a system to its search directions.
        ceiling: Largest allowed spectral radius; a growing mode would fit only these data.
        bounded: Bound of the poles, held at each step.
    """
    rows = sum(item.y.size for item in experiments)

    def allowed_cost(now: Affine) -> float:
        return cost(now, experiments) if now.radius <= ceiling else float("inf")

    def linearised(now: Affine) -> Linearised[Affine]:
        ways = ways_from(now)
        square, right = normal_equations(now, experiments, ways)
        same = np.full(len(right), square.trace() / len(right))
        return square, right, same, lambda step: bounded(now.with_block(now.block + ways @ step))

    return descended(system, allowed_cost, linearised, enough=CHANCE / rows)


def descended(
    start: Point,
    cost: Callable[[Point], float],
    linearised: Callable[[Point], Linearised[Point]],
    *,
    enough: float,
) -> Point:
    """Return the local minimum of a sum of squares, by damped Gauss-Newton steps (Levenberg, 1944; Marquardt, 1963).

    Args:
        start: Initial point.
        cost: Sum of squares at a point; infinite where it is not allowed.
        linearised: Normal equations at a point.
        enough: Relative decrease of the cost at which the descent ends.
    """
    best, now = start, cost(start)
    damping, rise = 1e-3, 2.0
    for _ in range(STEPS_MOST if np.isfinite(now) else 0):
        H, g, size, moved = linearised(best)
        if not size.sum() > 0.0:  # nothing changes the residuals
            break
        before, scale = now, np.diag(np.where(size > 0.0, size, 1.0))
        for _ in range(TRIES):
            step = np.linalg.solve(H + damping * scale, g)
            trial = moved(step)
            there = cost(trial)
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
    """Return J'J and J'e with initial states eliminated."""
    pairs = [jacobian(system, item, ways) for item in experiments]
    return np.sum([J.T @ J for J, _ in pairs], axis=0), np.sum([J.T @ e for J, e in pairs], axis=0)


def jacobian(
    system: Affine, experiment: Experiment, ways: Directions
) -> tuple[Float[np.ndarray, "rows d"], Float[np.ndarray, " rows"]]:
    """Return the derivatives of a free run along directions and its residual; the initial state is eliminated."""
    e, x0, O = _started(system, experiment, len(experiment.y))
    # The initial state acts as an impulse on an additional input, one sample earlier.
    u = np.vstack([np.zeros((1, experiment.u.shape[1])), experiment.u])
    u = np.column_stack([u, np.eye(1, len(u))[0]])
    start = np.concatenate([x0, np.zeros(len(system.C))])
    S, dS = np.column_stack([system.block, start]), np.pad(ways, ((0, 0), (0, 1), (0, 0)))
    J = tangents(S, dS, u)[1:]
    J[~experiment.there] = 0.0
    flat = J.reshape(-1, dS.shape[2])
    flat[: len(O)] -= O @ solved(O.T @ O, O.T @ flat[: len(O)])
    return flat, e.ravel()


def directions(system: Affine, fixed: Bool[np.ndarray, "p m1"]) -> Directions:
    """Return the directions that change the system's behaviour, orthogonal to changes of state coordinates and their origin."""
    n, S, constant = system.order, system.block, system.order + int(np.flatnonzero(~fixed.all(axis=0))[-1])
    at = np.arange(S.size).reshape(S.shape)
    free = np.concatenate([at[:n, :n].ravel(), at[:n, n:].ravel(), at[n:, :n].ravel(), at[n:, n:][~fixed]])
    # State coordinates dx = Xx change S by [X 0; 0 0] S - S [X 0; 0 0], a shift of the origin the offsets.
    turn, shift = np.zeros((*S.shape, n, n)), np.zeros((*S.shape, n))
    turn[:n] += np.einsum("ai,jc->acij", np.eye(n), S[:n])
    turn[:, :n] -= np.einsum("jb,ri->rbij", np.eye(n), S[:, :n])
    shift[:, constant] = np.eye(len(S), n) - S[:, :n]
    gauge = np.concatenate([turn.reshape(S.size, n * n), shift.reshape(S.size, n)], axis=1)[free]
    ways = np.zeros((S.size, len(free) - n * n - n))
    ways[free] = np.linalg.qr(gauge, mode="complete")[0][:, n * n + n :]
    return ways.reshape(*S.shape, -1)


def _lasting(system: Affine, steps: int) -> int:
    """Return the number of steps over which an initial state affects the outputs."""
    if system.radius >= 0.999:
        return steps
    # Below 1e-9 the initial state is negligible; 20 n allows for transient growth before the decay.
    return min(steps, int(20.0 * system.order + math.log(1e-9) / math.log(max(system.radius, 1e-3))))
