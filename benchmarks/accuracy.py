"""Accuracy on systems with known ground truth, next to the Cramér–Rao bound for the same inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ours
from bounds import pole_bound, relative_bound
from jaxtyping import Float
from peers import Fit, PeerError
from scipy.optimize import linear_sum_assignment
from score import relative_error
from systems import Experiment, driven, equation_12, in_closed_loop, light_damping, unstable
from tables import Row, table

from treadline.core import paper
from treadline.core.arrays import rms
from treadline.identification import IdentificationOptions, identify

STEPS = 20
"""Markov parameters compared: D, CB, … CA¹⁸B."""
SEEDS_OF_BOUND = 20
"""Number of seeds over which the bound of the poles is averaged; the bound hardly depends on the seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A system, how it is driven, and what peers may choose from."""

    name: str
    order: int
    make: Callable[[int], Experiment]
    block_rows: tuple[int, ...]
    """Candidate numbers of block rows for peers; the one with the least RMS error against ground truth is used."""
    noise: float


def cases() -> list[Case]:
    """Return the cases in the order of the tables."""
    plain = [
        Case(
            name=f"Eq. (12), {paper.SAMPLES} white inputs, noise {100 * noise:.0f} %",
            order=2,
            make=partial(driven, equation_12(), paper.SAMPLES, noise),
            block_rows=(5, 10, 20, 50),
            noise=noise,
        )
        for noise in (0.0, 0.01, 0.1)
    ]
    light = Case(
        name="ten lightly damped states (0.4–0.8 %), 4000 white inputs, noise 1 %",
        order=10,
        make=partial(driven, light_damping(), 4000, 0.01),
        block_rows=(20, 40, 60),
        noise=0.01,
    )
    loop = Case(
        name="integrator and pole 1.02 in closed loop, 1000 samples, noise 1 %",
        order=2,
        make=partial(in_closed_loop, unstable(), 1000, 0.01),
        block_rows=(5, 10, 20, 30),
        noise=0.01,
    )
    return [*plain, light, loop]


def markov_table(case: Case, fits: dict[str, Fit], seeds: range) -> None:
    """Print the errors of all methods on one case."""
    experiments = [case.make(seed) for seed in seeds]
    own = {name: (_errors_of_ours(arguments, case, experiments), "auto") for name, arguments in ours.WAYS.items()}
    peers = {name: _errors_of_peer(fit, case, experiments) for name, fit in fits.items()}
    unknown, known = (
        rms([relative_bound(e, STEPS, start_known=k) for e in experiments]) if case.noise else 0.0 for k in (False, True)
    )
    best = min((rms(errors) for errors, _ in peers.values()), default=np.nan)
    rows: list[Row] = [_row(name, errors, choice, best, unknown) for name, (errors, choice) in (own | peers).items()]
    if case.noise:
        rows.append(("Cramér–Rao, x0 and offset unknown", "", "", unknown, unknown / best, 1.0, ""))
        rows.append(("Cramér–Rao, x0 = 0 known", "", "", known, known / best, known / unknown, ""))
    title = (
        f"{case.name}: relative error of {STEPS} Markov parameters, order {case.order} given, seeds {seeds.start}…{seeds.stop - 1}"
    )
    table(title, ("method", "block rows", "median", "RMS", "/best peer", "/Cramér–Rao", "failed"), rows)


def _row(name: str, errors: list[float], choice: str, best: float, bound: float) -> Row:
    whole = [error for error in errors if np.isfinite(error)]
    failed = str(len(errors) - len(whole) or "")
    if not whole:
        return (name, choice, "–", "–", "–", "–", failed)
    spread = rms(errors if not failed else whole)
    return (name, choice, float(np.median(whole)), spread, spread / best, spread / bound if bound else "", failed)


def _errors_of_ours(arguments: dict[str, Any], case: Case, experiments: list[Experiment]) -> list[float]:
    errors = []
    for experiment in experiments:
        try:
            model = identify(experiment.record, IdentificationOptions(order=case.order, **arguments)).model
            errors.append(relative_error(model, experiment.system, STEPS))
        except ours.FAILURES:
            errors.append(np.inf)
    return errors


def _errors_of_peer(fit: Fit, case: Case, experiments: list[Experiment]) -> tuple[list[float], str]:
    """Return the errors with the block rows that suit the peer best."""
    tried = {rows: [_error(fit, case.order, rows, experiment) for experiment in experiments] for rows in case.block_rows}
    rows = min(tried, key=lambda choice: rms(tried[choice]))
    return tried[rows], str(rows)


def _error(fit: Fit, order: int, rows: int, experiment: Experiment) -> float:
    try:
        return relative_error(fit(experiment.record, order, rows), experiment.system, STEPS)
    except (PeerError, np.linalg.LinAlgError, ValueError):  # peers raise what their libraries raise
        return np.inf


def coverage_table(case: Case, seeds: range) -> None:
    """Print how often the 95 % interval of a pole holds the true one, and how sharp it is."""
    bound = rms([pole_bound(case.make(seed)) for seed in seeds[:SEEDS_OF_BOUND]])
    rows: list[Row] = []
    for name, arguments in ours.WAYS.items():
        found = [outcome for seed in seeds if (outcome := _poles(case.make(seed), case.order, arguments)) is not None]
        if not found:
            rows.append((name, 0, "–", "–", "–", "–", "–", "–"))
            continue
        error, width = (np.array(part) for part in zip(*found, strict=True))
        inside = 100.0 * (error <= width).mean(axis=0)
        rows.append((name, len(found), *_percents(inside), float(np.median(width)), rms(error), rms(error) / bound))
    title = f"{case.name}: coverage of the poles' 95 % intervals, order {case.order} given, seeds {seeds.start}…{seeds.stop - 1}"
    table(title, ("method", "runs", "mean", "least pole", "most pole", "half width", "RMS error", "/Cramér–Rao"), rows)


def _percents(inside: Float[np.ndarray, " n"]) -> tuple[str, str, str]:
    return f"{inside.mean():.1f} %", f"{inside.min():.1f} %", f"{inside.max():.1f} %"


def _poles(
    experiment: Experiment, order: int, arguments: dict[str, Any]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] | None:
    """Return |λ̂ - λ| and the declared half width of each true pole; None where no interval is offered."""
    try:
        report = identify(experiment.record, IdentificationOptions(order=order, **arguments)).report
    except ours.FAILURES:
        return None
    if report.pole_ci95 is None:
        return None
    found = np.array([complex(*pole) for pole in report.poles])
    true = np.linalg.eigvals(experiment.system.A)
    distance = np.abs(true[:, None] - found)
    mine, theirs = linear_sum_assignment(distance)
    return distance[mine, theirs], np.asarray(report.pole_ci95)[theirs]
