"""Refinement follows the true derivatives, stays stable, and reaches the Cramér–Rao bound."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from scipy.linalg import block_diag
from systems import STEPS, fit, markov_error, oscillation, system, white_record

from treadline.core.linear_system_kernels import free_run
from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._affine import Affine
from treadline.identification._gram import Units
from treadline.identification._modes import Experiment
from treadline.identification._refine import (
    cost,
    directions,
    experiments_of,
    jacobian,
    predictors_of,
    refined,
    refit,
)

FREE = np.zeros((2, 3), dtype=bool)
"""Mask without fixed entries of D: two outputs, two inputs and a constant."""
OF_ONE = Units(shift=np.zeros(4), scale=np.ones(4), input_count=2)


def spring(seed: int = 0) -> Affine:
    """Return a system with a complex pair, 0.9 e^(±0.5i), a real pole 0.6, and offsets."""
    rng = np.random.default_rng(seed)
    A = block_diag(oscillation(0.9, 0.5), 0.6)
    T = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    B, C, D = rng.standard_normal((3, 3)), rng.standard_normal((2, 3)), rng.standard_normal((2, 3))
    return Affine(A=T @ A @ np.linalg.inv(T), B=T @ B, C=C @ np.linalg.inv(T), D=D)


def run_of(model: Affine, seed: int, *, samples: int = 300, noise: float = 0.0, gaps: bool = False) -> Experiment:
    """Return a run of a model from a random initial state."""
    rng = np.random.default_rng(seed)
    u = np.column_stack([rng.standard_normal((samples, 2)), np.ones(samples)])
    y = free_run(model.A, model.B, model.C, model.D, rng.standard_normal(model.order), u)
    y += noise * rng.standard_normal(y.shape)
    there = np.ones(samples, dtype=bool)
    if gaps:
        there[rng.integers(0, samples, 20)] = False
        y[~there] = 0.0
    return Experiment(u=u, y=y, there=there)


def nearby(model: Affine, seed: int, size: float) -> Affine:
    """Return a slightly perturbed model."""
    rng = np.random.default_rng(seed)
    A, B, C, D = (item + size * rng.standard_normal(item.shape) for item in (model.A, model.B, model.C, model.D))
    return Affine(A=A, B=B, C=C, D=D)


def test_entries_of_D_that_are_zero_by_choice_stay_zero() -> None:
    fixed = FREE.copy()
    fixed[:, :2] = True
    model = spring()
    D = model.D * ~fixed
    start = replace(model, D=D, A=0.98 * model.A)
    found = refined(start, [run_of(replace(model, D=D), 8, noise=0.1)], fixed=fixed)
    np.testing.assert_array_equal(found.D[:, :2], 0.0)
    assert cost(found, [run_of(replace(model, D=D), 8, noise=0.1)]) < 1.1 * 0.01 * 600


@pytest.mark.parametrize("seed", range(6))
def test_refinement_never_raises_the_cost_and_never_leaves_the_unit_circle(seed: int) -> None:
    # A slow pair close to the circle, few samples and much noise: growing modes would reduce the cost.
    true = replace(spring(seed), A=spring(seed).A / 0.91)
    start = replace(nearby(true, seed + 10, 0.03), A=0.97 * true.A)
    runs = [run_of(true, seed + 20, samples=60, noise=2.0)]
    found = refined(start, runs, fixed=FREE)
    assert cost(found, runs) <= cost(start, runs)
    assert start.radius < 1.0
    assert found.radius <= 1.0


def test_refinement_without_noise_ends_at_the_system() -> None:
    true = spring()
    runs = [run_of(true, 30), run_of(true, 31, samples=100)]
    found = refined(nearby(true, 32, 0.02), runs, fixed=FREE)
    # Only rounding remains: 300 samples of about ten, squared.
    assert cost(found, runs) < 1e-18 * sum(float(np.vdot(run.y, run.y)) for run in runs)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(found.A)), np.sort_complex(np.linalg.eigvals(true.A)), atol=1e-10)


def test_poles_stay_within_the_bound_and_the_rest_is_fitted_to_them() -> None:
    true = replace(spring(), A=spring().A * (0.995 / 0.9))
    runs = [run_of(true, 33, noise=0.1)]

    def bounded(now: Affine) -> Affine:
        return replace(now, A=now.A * min(1.0, 0.97 / now.radius))

    found, free = refined(bounded(true), runs, fixed=FREE, bounded=bounded), refined(bounded(true), runs, fixed=FREE)
    assert found.radius <= 0.97 + 1e-12
    assert cost(found, runs) < min(cost(bounded(true), runs), cost(bounded(free), runs))


def test_the_steps_do_not_depend_on_the_basis_of_the_directions() -> None:
    runs, start = [run_of(spring(), 34, noise=0.5)], nearby(spring(), 35, 0.05)
    turned = np.linalg.qr(np.random.default_rng(36).standard_normal((directions(start, FREE).shape[2],) * 2))[0]
    one = refined(start, runs, fixed=FREE)
    other = refit(start, runs, lambda now: directions(now, FREE) @ turned)
    # Rounding alone separates them; damped by the diagonal of J'J the costs differ by 4e-6.
    np.testing.assert_allclose(cost(one, runs), cost(other, runs), rtol=1e-9)


def test_missing_inputs_and_outputs_do_not_contribute_to_the_residual() -> None:
    record = InputOutputRecord(u=np.ones((6, 2)), y=np.ones((6, 2)), dt_s=1.0)
    record.y[2, 0] = np.nan
    item = experiments_of([record], OF_ONE)[0]
    np.testing.assert_array_equal(item.there, [True, True, False, True, True, True])
    assert np.isfinite(item.y).all()
    # Predictions need the preceding outputs and are split at gaps.
    assert [len(run.y) for run in predictors_of([item], 1)] == [2, 3]


def cramer_rao(true: Affine, run: Experiment, noise: Float[np.ndarray, " p"]) -> float:
    """Return the Cramér–Rao bound on the relative RMS error of the Markov parameters; x₀ and offsets unknown."""
    ways = directions(true, FREE)
    J, _ = jacobian(true, run, ways)
    J = J.reshape(len(run.y), 2, -1) / noise[:, None]
    covariance = np.linalg.inv(np.einsum("tpi,tpj->ij", J, J))
    values, V = np.linalg.eigh(covariance)
    spread = ways @ (V * np.sqrt(np.maximum(values, 0.0)))
    h = 1e-4
    ends = [[true.with_block(true.block + spread @ step) for step in (h * e, -h * e)] for e in np.eye(len(values))]
    moved = [markov(one) - markov(other) for one, other in ends]
    return float(np.linalg.norm(moved) / (2 * h) / np.linalg.norm(markov(true)))


def markov(plant: Affine) -> Float[np.ndarray, "steps 2 2"]:
    return impulse_response(system(plant.A, plant.B[:, :2], plant.C, plant.D[:, :2]), STEPS)


def affine(model: LinearModel) -> Affine:
    """Return a model without offsets, in its own units."""
    return Affine(A=model.A, B=np.pad(model.B, ((0, 0), (0, 1))), C=model.C, D=np.pad(model.D, ((0, 0), (0, 1))))


def simulated(true: LinearModel, seed: int, samples: int, noise: float) -> tuple[InputOutputRecord, float]:
    """Return a record under white inputs and the Cramér–Rao bound on the RMS error of the Markov parameters."""
    record = white_record(true, seed, samples, noise)
    run = Experiment(u=np.column_stack([record.u, np.ones(samples)]), y=record.y, there=np.ones(samples, dtype=bool))
    return record, cramer_rao(affine(true), run, noise * simulate(true, record.u, np.zeros(true.order)).std(axis=0))


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_the_selected_model_reaches_the_cramer_rao_bound(eq_12: LinearModel, noise: float) -> None:
    records, bounds = zip(*(simulated(eq_12, seed, 1000, noise) for seed in range(16)), strict=True)
    errors = [markov_error(fit(record, order=2).model, eq_12) for record in records]
    # Over 40 seeds the ratio is 1.03; each error scatters by a quarter, the RMS of 16 by 6 %.
    assert np.sqrt(np.mean(np.square(errors))) < 1.1 * np.sqrt(np.mean(np.square(bounds)))


def test_ten_lightly_damped_states_reach_the_cramer_rao_bound() -> None:
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        modes = zip((0.35, 0.8, 1.3, 1.9, 2.5), (0.004, 0.005, 0.006, 0.007, 0.008), strict=True)
        A = block_diag(*(oscillation(np.exp(-zeta * omega), omega * np.sqrt(1.0 - zeta**2)) for omega, zeta in modes))
        true = system(A, rng.standard_normal((10, 2)), rng.standard_normal((2, 10)))
        record, bound = simulated(true, seed, 1000, 0.01)
        ratios.append(markov_error(fit(record, order=10).model, true) / bound)
    # 1.03 and 1.01 were measured. Other packages reach 1.2; a single error scatters by a tenth.
    assert np.sqrt(np.mean(np.square(ratios))) < 1.1
