"""The method ``best``: many subspace models of one record, and of them the one nearest to their median.

A few hundred samples cannot rank a hundred candidate models; choosing among them by held-out data costs more than it brings.
Instead all candidates are fitted to all data: PBSID states from regressions with slowly, quickly and not decaying priors, for
orders about the one of smallest BIC and for small ones. The pointwise median of their free runs and of their impulse responses is a
robust estimate. The members nearest to both medians, and the nearest of each order, get the inputs, the feedthrough, the offset and
the initial state that fit their free run. The result is the medoid of these, or the smallest that predicts each output as well:
white residuals under one joint noise, which the BIC asks for, take many states where one output is noisier than another.

Two questions remain that only other data answer, each asked once: both ends of the record are predicted from the rest.
Slow poles, which may be drift instead of a property of the plant, are kept, and the output error is refined, only if that
lowers the error in both directions. Outputs of which the inputs explain no more than chance are shrunk to their mean.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from operator import lt

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import betaincinv

from treadline.core.arrays import finite_or_none, markov_parameters
from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import most_recent
from treadline.core.model_scores import GROWTH
from treadline.identification._affine import Affine, stabilised
from treadline.identification._decaying_ridge import DECAYS, decaying_ridge
from treadline.identification._fitting import CandidateScore, Fitting
from treadline.identification._limits import LAGS_MOST, RECENT, SIGNIFICANCE
from treadline.identification._model_order import bic_order
from treadline.identification._modes import Experiment, with_inputs_again
from treadline.identification._realisation import StateMap, pbsid, state_map
from treadline.identification._refine import experiments_of, fair_residual, refined, residual

ORDERS_TRIED = 12
"""Orders per decay, spread evenly over the range: 1 to 12, or from half to one and a half times the order of smallest BIC."""
VALUES_PER_COEFFICIENT = 10
"""Output values per coefficient of the largest order."""
IMPULSE_STEPS, IMPULSE_WEIGHT = 200, 0.1
"""Longest impulse response compared, and its weight: it decides where the inputs of the record leave the models alike."""
JUDGED = 0.3
"""Share of the record at its beginning, and at its end, that judges a model fitted to the rest, as for the benchmark's peers."""
REFITTED = 10
"""Members nearest to the median whose inputs are fitted again. With all of them, the fits of 26 cuts differ by at most 0.9 points,
but for a swept sine that depends on the order of summation (flutter, 2.5)."""
SAME_FIT = 0.005
"""Difference of two root mean square errors that does not count, in standard deviations: half a point of fit, a quarter of what
peers differ by without a meaning (docs/evidence/identification.md)."""
SMALL_ORDERS = 8
"""Orders from 1 that are tried in every case: a vehicle's turn has two lags, an integrator and some dead time. Of 39 cuts, 4 change
the fit of one by more than 0.3 points (0.8 less), 16 that of two (docs/evidence/identification.md)."""
AGREEING = 0.1
"""Share of the members that may disagree with it."""
ENTRIES_MOST = 450
"""Entries of A, B and C above which a refinement takes longer than all other steps: two thirds of a fit's time at 456 entries, nine
tenths at 532 (CD arm turned and steam generator, docs/evidence/identification.md)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """One model of the ensemble."""

    decay: float
    realised: Affine
    """Model as PBSID realises it."""
    votes: bool
    """Whether it counts for the median: small models of a large plant do not."""
    system: Affine
    """Model with bounded poles, later with refitted inputs; of an unstable plant as realised."""
    run: Float[np.ndarray, " values"] = field(default_factory=lambda: np.empty(0))
    """Free run on the data in standard deviations; empty for an unstable plant."""

    @property
    def order(self) -> int:
        """Number of states."""
        return self.realised.order

    def with_run(self, system: Affine, experiments: Sequence[Experiment]) -> "Member":
        """Return the member with another model and its free run."""
        run = np.concatenate([(item.y - residual(system, item))[item.there].ravel() for item in experiments])
        return replace(self, system=system, run=run)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selection:
    """Members, their distance from the median, and the one chosen."""

    members: Sequence[Member]
    distances: Float[np.ndarray, " members"]
    chosen: Member


def candidates_of(selection: Selection) -> list[CandidateScore]:
    """Return the members, nearest to the median first."""
    nearest = sorted(zip(selection.members, selection.distances.tolist(), strict=True), key=lambda item: item[1])
    return [
        CandidateScore(order=one.order, decay=one.decay, distance=finite_or_none(far), chosen=one is selection.chosen)
        for one, far in nearest
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ensemble:
    """Model made of the medoid, or of the member of smallest order that the data do not distinguish from it."""

    selection: Selection
    system: Affine
    step: str
    """Last fitting step of the model: ``subspace``, ``inputs-again`` or ``output-error``."""
    explained: Bool[np.ndarray, " p"]
    """Whether the inputs explain more of an output than chance does; the response of any other is zero."""


def ensemble(fitting: Fitting, orders: Sequence[int] | None, on_progress: Callable[[str], None] = lambda _: None) -> Ensemble:
    """Return the ensemble of a record and its model.

    Args:
        fitting: Data of the fit.
        orders: Orders to try; the data decide when None.
        on_progress: Called with a line of text per decay.

    Raises:
        PoorExcitation: If no order has a model.
    """
    units = fitting.data.units
    # The values of ``RECENT`` samples of two outputs; more would hardly change the medoid.
    experiments = experiments_of(most_recent(fitting.records, 2 * RECENT // len(units.output_scale)), units)
    found: list[Member] = []
    for decay in DECAYS:
        on_progress(f"models with a prior that decays by {decay:g} a lag")
        found += _realised(fitting, decay, orders)
    if not found:
        raise PoorExcitation(
            f"order {min(orders or [1])} is above the largest order that {fitting.data.lags} lags of these data support; "
            "ask for less"
        )
    length = float(max(len(item.y) for item in experiments))
    # A plant is unstable if it grows over the record as much as a slow mode has to decay.
    if np.quantile([one.realised.radius for one in found if one.votes], AGREEING) > 1.0 + GROWTH / length:
        return _unstable(fitting, found)
    again = partial(with_inputs_again, fixed=fitting.fixed)

    @cache
    def errors(realised: Affine, length: float) -> list[float]:
        return list(_errors(stabilised(realised, samples=length), experiments, again))

    selection = _selection(fitting, experiments, found, length)
    # Slow poles are kept as realised if both ends of the record are then predicted better.
    realised = selection.chosen.realised
    slow = not np.array_equal(stabilised(realised).A, selection.chosen.system.A)
    if slow and all(map(lt, errors(realised, math.inf), errors(realised, length))):
        length = math.inf
        selection = _selection(fitting, experiments, found, length)
    system, step = _refined(fitting, experiments, selection.chosen, length, errors)
    if step == "inputs-again" and sum(len(item.y) for item in experiments) < fitting.data.count:
        # In pieces with a start of their own: the filters of a long record would not fit into memory.
        pieces = [item.part(at, at + RECENT) for item in fitting.experiments for at in range(0, len(item.y), RECENT)]
        system = with_inputs_again(system, pieces, fitting.fixed)
    explained = _explained(experiments, system)
    if not explained.all():
        system = replace(system, C=system.C * explained[:, None], D=system.D * explained[:, None], K=None)
    return Ensemble(selection=selection, system=system, step=step, explained=explained)


def _realised(fitting: Fitting, decay: float, orders: Sequence[int] | None) -> Iterator[Member]:
    """Yield the PBSID models of a prior, one for each order that the data support."""
    data, has_d = fitting.data, fitting.feedthrough
    theta, _ = decaying_ridge(data, decay, feedthrough=has_d)
    states = state_map(data, data.lags, theta)
    spread = _orders(fitting, states) if orders is None else list(orders)
    small = range(1, min(SMALL_ORDERS + 1, *spread)) if orders is None else ()
    for order in (*small, *spread):
        if order <= len(states.s):
            system = pbsid(data, states, order, data.lags, feedthrough=has_d)
            yield Member(decay=decay, realised=system, votes=order not in small, system=system)


def _orders(fitting: Fitting, states: StateMap) -> list[int]:
    """Return the orders whose models vote: about the one of smallest BIC, as far as the samples allow."""
    data = fitting.data
    m, p = data.units.input_count, len(data.units.output_scale)
    central = bic_order(data, states, data.lags, feedthrough=fitting.feedthrough)
    most = max(1, int((data.count * p / VALUES_PER_COEFFICIENT - m * p) / (m + p)))
    upper = min(max(ORDERS_TRIED, round(1.5 * central)), LAGS_MOST, most, len(states.s))
    lower = 1 if upper <= ORDERS_TRIED else min(max(central // 2, 1), upper)
    return sorted({int(order) for order in np.linspace(lower, upper, min(ORDERS_TRIED, upper - lower + 1)).round()})


def _selection(fitting: Fitting, experiments: Sequence[Experiment], found: Sequence[Member], length: float) -> Selection:
    """Return the members worth a refit of their inputs, with poles that decay over a length, and the one chosen."""
    bounded = [one.with_run(stabilised(one.realised, samples=length), experiments) for one in found]
    by_distance = np.argsort(_distances(fitting, bounded), kind="stable").tolist()
    orders = {bounded[at].order: at for at in reversed(by_distance)}  # the nearest of each order
    near = [bounded[at] for at in sorted({*by_distance[:REFITTED], *orders.values()})]
    members = [one.with_run(with_inputs_again(one.system, experiments, fitting.fixed), experiments) for one in near]
    distances = _distances(fitting, members)
    return Selection(members=members, distances=distances, chosen=_smallest(experiments, members, distances))


def _distances(fitting: Fitting, members: Sequence[Member]) -> Float[np.ndarray, " members"]:
    """Return each member's squared distance from the median free run and the median impulse response, relative to their size."""
    steps = min(IMPULSE_STEPS, max(2, len(members[0].run) // (4 * len(fitting.data.units.output_scale))))
    voters = np.array([one.votes for one in members])
    runs, responses = np.stack([one.run for one in members]), _impulses(fitting, members, steps)
    from_run = np.mean((runs - np.median(runs[voters], axis=0)) ** 2, axis=1)  # channels have deviation one
    distances = from_run + IMPULSE_WEIGHT * _from_median(responses, voters)
    return np.where(np.isfinite(distances), distances, np.inf)


def _smallest(experiments: Sequence[Experiment], members: Sequence[Member], distances: Float[np.ndarray, " members"]) -> Member:
    """Return the medoid, or the member of smallest order that predicts each output as well.

    As well: its prediction error is above the medoid's by at most ``SAME_FIT``, or by the standard error of that.
    """
    medoid = members[int(np.argmin(distances))]
    y = np.vstack([item.y[item.there] for item in experiments])
    least = _prediction_error(medoid, y)
    most = least + np.maximum(SAME_FIT, least / np.sqrt(2.0 * len(y)))
    near = [at for at, one in enumerate(members) if one.order < medoid.order and (_prediction_error(one, y) <= most).all()]
    return members[min(near, key=lambda at: (members[at].order, distances[at]))] if near else medoid


def _prediction_error(member: Member, y: Float[np.ndarray, "T p"]) -> Float[np.ndarray, " p"]:
    """Return the root mean square error of each output that a free run on new data would have, in standard deviations.

    The final prediction error (Akaike, 1969): a model of d coefficients fitted to N values errs by (1 + d/N) / (1 - d/N) times its
    residual variance.
    """
    share = min(_coefficients(member.system) / y.size, 0.5)
    squares = np.mean((y - member.run.reshape(y.shape)) ** 2, axis=0)
    return np.asarray(np.sqrt(squares * (1.0 + share) / (1.0 - share)))


def _coefficients(system: Affine) -> int:
    """Return the number of coefficients that change what a model does."""
    return system.order * (system.B.shape[1] + len(system.C)) + system.D.size


def _impulses(fitting: Fitting, members: Sequence[Member], steps: int) -> Float[np.ndarray, "members values"]:
    m, systems = fitting.data.units.input_count, [one.system for one in members]
    return np.stack([markov_parameters(one.A, one.B[:, :m], one.C, one.D[:, :m], steps).ravel() for one in systems])


def _from_median(
    responses: Float[np.ndarray, "members values"], voters: Bool[np.ndarray, " members"]
) -> Float[np.ndarray, " members"]:
    median = np.median(responses[voters], axis=0)
    return np.asarray(((responses - median) ** 2).sum(axis=1) / max(float(median @ median), np.finfo(float).tiny))


def _unstable(fitting: Fitting, members: Sequence[Member]) -> Ensemble:
    """Return the ensemble of an unstable plant: without free runs, which no data of finite precision allow."""
    distances = _from_median(_impulses(fitting, members, fitting.data.lags + 1), np.array([one.votes for one in members]))
    medoid = members[int(np.argmin(distances))]
    selection = Selection(members=members, distances=distances, chosen=medoid)
    explained = np.ones(len(medoid.system.C), dtype=np.bool_)
    return Ensemble(selection=selection, system=medoid.system, step="subspace", explained=explained)


def _refined(
    fitting: Fitting,
    experiments: Sequence[Experiment],
    chosen: Member,
    length: float,
    errors: Callable[[Affine, float], list[float]],
) -> tuple[Affine, str]:
    """Return the model of the chosen member, its output error refined where both ends agree; and the last step."""
    system = chosen.system

    def refinement(system: Affine, part: Sequence[Experiment]) -> Affine:
        start = with_inputs_again(system, part, fitting.fixed)
        return refined(start, part, fixed=fitting.fixed, bounded=partial(stabilised, samples=length))

    if system.order * (system.order + system.B.shape[1] + len(system.C)) >= ENTRIES_MOST:
        return system, "inputs-again"
    # The member has its poles from all data; a refinement to the rest alone may err by its coefficients' share of chance.
    chance = 1.0 + _coefficients(system) / ((1.0 - JUDGED) * sum(item.y.size for item in experiments))
    allowed = [chance * one for one in errors(chosen.realised, length)]
    if all(map(lt, _errors(system, experiments, refinement), allowed)):
        return refinement(system, experiments), "output-error"
    return system, "inputs-again"


def _errors(
    system: Affine, experiments: Sequence[Experiment], fit: Callable[[Affine, Sequence[Experiment]], Affine]
) -> Iterator[float]:
    """Yield the squared error of the free run of each end by the model fitted to the rest; infinite if it diverges."""
    for share, begins in ((1.0 - JUDGED, False), (JUDGED, True)):
        cuts = [(item, round(share * len(item.y))) for item in experiments]
        before, after = [item.part(0, at) for item, at in cuts], [item.part(at, len(item.y)) for item, at in cuts]
        rest, judged = (after, before) if begins else (before, after)
        fitted = fit(system, rest)
        with np.errstate(over="ignore", invalid="ignore"):
            error = sum(float(np.sum(fair_residual(fitted, item) ** 2)) for item in judged)
        yield error if np.isfinite(error) else np.inf


def _explained(experiments: Sequence[Experiment], system: Affine) -> Bool[np.ndarray, " p"]:
    """Return whether the free run explains more of each output than coefficients fitted to noise would.

    Of white noise, d coefficients explain a share of the variance that has a beta distribution with d/2 and (N - d)/2.
    """
    y = np.vstack([item.y[item.there] for item in experiments])
    errors = np.vstack([residual(system, item)[item.there] for item in experiments])
    unexplained = (errors**2).sum(axis=0) / np.maximum(((y - y.mean(axis=0)) ** 2).sum(axis=0), np.finfo(float).tiny)
    coefficients = system.order * (system.B.shape[1] + 1) + system.B.shape[1]
    by_chance = betaincinv(0.5 * coefficients, 0.5 * max(len(y) - coefficients, 1), 1.0 - SIGNIFICANCE)
    return ~(1.0 - unexplained < by_chance)
