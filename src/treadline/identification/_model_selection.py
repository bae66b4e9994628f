"""Model selection by cross-validation: each candidate is scored on held-out data, each step kept only if it helps.

Experiments are cut into blocks; each block in turn validates models fitted to the others. Candidate families (a method
and a number of lags each) grow in order until the error stops falling. The best candidates of different order are
refined. Offsets of rate channels are fixed at zero unless the held-out data contradict it. The candidate with the
smallest error is selected, the smaller order at a tie, and fitted to all data. No setting is chosen per data set.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from treadline.core.errors import PoorExcitation
from treadline.core.linear_system_kernels import observability, observer_run
from treadline.core.linear_systems import most_recent, part
from treadline.core.models import InputOutputRecord
from treadline.identification._affine import Affine
from treadline.identification._fitting import GROWTH, Candidate, Fitting
from treadline.identification._gram import gram_of
from treadline.identification._model_order import ORDER_MOST
from treadline.identification._pole_intervals import of_observer
from treadline.identification._refine import BRIEF, Experiment, cost, initial_state, residual

FOLDS = 5
"""Number of cross-validation folds."""
FOLDS_IF_CLEAR = 3
"""Number of folds where the singular values show the order clearly and few candidates remain."""
VALUES_PER_STATE = 8
"""Output values of a held-out block of median length per state of the largest order tried."""
PATIENCE = 3
"""Consecutive orders without improvement after which a candidate family ends."""
LAGS = (10, 20, 40)
"""Lags tried in addition to the BIC lags, up to the largest number of lags the data support."""
DESCENT_PATIENCE = 2
"""Consecutive smaller orders that may score worse before the descent ends: modes come in pairs."""
SCREENING_RATIO = 1.5
"""Ratio of screening errors above which a smaller order is not tried again."""
TIE_RATIO = 1.005
"""Ratio of errors within which two orders tie; the smaller order is taken."""
RATE_SUFFIXES = ("_m_s", "_rad_s")
"""Unit suffixes of rates. If all channels are rates, offsets are fixed at zero unless the data contradict it."""
OFFSET_ERROR_RATIO = 1.25
"""Ratio of errors without and with offsets above which the data contradict zero offsets."""
FREE_RUN_ERROR_LIMIT = 0.95
"""Free-run error above which forecasts replace free runs as the criterion: no free run explains the data."""
HORIZON = 10
"""Forecast horizon of that criterion in samples."""
CV_SAMPLES_MAX = 20_000
"""Largest number of samples used for cross-validation; more samples would hardly change the selection."""

REFINEMENTS = ("output-error", "prediction-error")


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchBudget:
    """Budget of the candidate search."""

    finalists: int
    """Candidates scored on all folds; screening uses every second fold."""
    refined_orders: int
    """Orders with a refined candidate."""
    tie_ratio: float
    """Ratio of errors within which the smaller order is selected."""


WIDE = SearchBudget(finalists=8, refined_orders=3, tie_ratio=TIE_RATIO)
NARROW = SearchBudget(finalists=3, refined_orders=1, tie_ratio=1.02)
"""Budget where the singular values show the order clearly: the search covers that order and its neighbours."""

Squares = Float[np.ndarray, "2 p"]
"""Sums of squares of a model's output residuals, and of the outputs about the data's mean."""
Criterion = Callable[[Affine, Fitting, Candidate], Squares]


@dataclass(frozen=True, slots=True, kw_only=True)
class CvScore:
    """Candidate and its cross-validation error relative to the outputs' deviation."""

    candidate: Candidate
    error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fold:
    """Training data and the held-out validation block."""

    training: Fitting
    validation: Fitting


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selection:
    """Selected candidate, its model fitted to all data, and all scores."""

    candidate: Candidate
    system: Affine
    scores: list[CvScore]


def select_model(
    whole: Fitting,
    *,
    lags: int,
    order: int | None,
    suggested_order: int,
    order_is_clear: bool,
    names: Sequence[str],
    on_progress: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Return the model selected by cross-validation.

    Args:
        whole: All data.
        lags: Number of lags at the smallest BIC.
        order: Number of states; selected when left out.
        suggested_order: Order suggested by the singular values; always among the candidates.
        order_is_clear: Whether the singular values show the order clearly; the search is then limited to its neighbours.
        names: Channel names; their suffixes give the units. Without names rest is not at zero.
        on_progress: Called with a line of text per scored candidate.
    """
    neighbours_only = order is None and order_is_clear
    folds = folds_of(whole, FOLDS_IF_CLEAR if neighbours_only or order is not None else FOLDS)
    orders = range(1, _max_states(folds) + 1) if order is None else range(order, order + 1)
    if neighbours_only:
        orders = range(max(1, suggested_order - 1), suggested_order + 2)
    first = Candidate(method="okid-era", lags=lags, order=0)
    all_lags = {lags, min(LAGS[0], whole.data.lags), *(n for n in LAGS if n <= whole.data.lags)}
    families = [Candidate(method="pbsid", lags=other, order=0) for other in sorted(all_lags)]
    budget = NARROW if neighbours_only or order is not None else WIDE
    if budget is WIDE:
        families = [first, *families]
    search = Search(folds=folds, criterion=free_run_squares, budget=budget, on_progress=on_progress)
    expected_order = suggested_order if order is None else order
    if not (
        (order_is_clear and _may_integrate(whole, replace(first, order=expected_order)))
        or _grows(whole, [first, *families], expected_order)
    ):
        search.grow_order([replace(family, step="inputs-again") for family in families], orders)
    by_forecasts = not search.scores or search.lowest_error > FREE_RUN_ERROR_LIMIT
    if by_forecasts:
        search = Search(folds=folds, criterion=forecast_squares, budget=budget, on_progress=on_progress)
        search.grow_order(families, orders)
    if not search.scores and order is not None:
        raise PoorExcitation(
            f"order {order} is above the largest order that {whole.data.lags} lags of these data support; ask for less"
        )
    if not search.scores or not np.isfinite(search.lowest_error):
        raise PoorExcitation("no model explains held-out data; give a longer record, or inputs that vary more")
    search.refine("prediction-error" if by_forecasts else "output-error", suggested_order if order is None else None)
    if not by_forecasts and names and all(name.endswith(RATE_SUFFIXES) for name in names):
        search.select_constants(lambda candidate: _does_not_decay(whole, candidate))
    candidate = search.select()
    system = whole.with_gain(_fit_to_all(whole, candidate, families if budget is WIDE else []), constants=candidate.constants)
    return Selection(candidate=candidate, system=system, scores=search.scores)


def _max_states(folds: Sequence[Fold]) -> int:
    """Return the largest order tried, limited because a large initial state would explain any short validation block."""
    blocks = [item.y.size for fold in folds for item in fold.validation.experiments()]
    return max(1, min(ORDER_MOST, int(np.median(blocks)) // VALUES_PER_STATE))


def _does_not_decay(whole: Fitting, candidate: Candidate) -> bool:
    """Whether the candidate's model has a state that persists over the whole record."""
    system = whole.model(candidate, effort=BRIEF)
    return system is None or system.radius > 1.0 - 1.0 / max(len(record) for record in whole.records)


def _may_integrate(whole: Fitting, candidate: Candidate) -> bool:
    """Whether a pole may be an integrator (chair heading): its free run drifts with the smallest disturbance."""
    system = whole.model(candidate)
    if system is None:
        return False
    observer, svd = whole.observer(candidate.lags, candidate.order)
    radii = of_observer(observer, svd, system, whole.units(), whole.data).pole_radii()
    return bool((np.abs(np.linalg.eigvals(system.A) - 1.0) <= radii).any())


def _grows(whole: Fitting, families: Sequence[Candidate], order: int) -> bool:
    """Whether, for every method and number of lags, a mode grows so fast over a record that it dominates the free run."""
    systems = [whole.model(replace(family, order=order)) for family in families]
    longest = max(len(record) for record in whole.records)
    return all(system is not None and longest * np.log(system.radius) > np.log(GROWTH) for system in systems)


@dataclass(slots=True, kw_only=True, eq=False)
class Search:
    """Search over candidates: scores so far and the rules for trying more."""

    folds: Sequence[Fold]
    criterion: Criterion
    budget: SearchBudget
    on_progress: Callable[[str], None]
    scores: list[CvScore] = field(default_factory=list)
    screened: dict[int, float] = field(default_factory=dict)
    """Smallest screening error (every second fold) of each order."""

    @property
    def lowest_error(self) -> float:
        """Smallest cross-validation error so far."""
        return min(scored.error for scored in self.scores)

    def grow_order(self, families: Sequence[Candidate], orders: range) -> None:
        """Screen rising orders of each family until the error stops falling; then score the finalists on all folds."""
        screened: list[CvScore] = []
        for family in families:
            lowest_error, since = float("inf"), 0
            for order in orders:
                scored = self._score_on(replace(family, order=order), self.folds[1::2])
                if scored is None:
                    break
                screened.append(scored)
                since = 0 if scored.error * TIE_RATIO < lowest_error else since + 1
                lowest_error = min(lowest_error, scored.error)
                if since >= PATIENCE:
                    break
        self.screened = {scored.candidate.order: scored.error for scored in reversed(_of_each_order(screened))}
        for scored in sorted(screened, key=lambda scored: scored.error)[: self.budget.finalists]:
            self.score(scored.candidate)

    def refine(self, step: str, suggested_order: int | None) -> None:
        """Score a refinement of the best candidate of each leading order, then smaller orders while they score as well.

        Args:
            step: Refinement step.
            suggested_order: Order scored in any case; None for a given order.
        """
        leading = _of_each_order(self.scores)[: self.budget.refined_orders]
        tried: dict[int, CvScore | None] = {
            scored.candidate.order: self.score(replace(scored.candidate, step=step)) for scored in leading
        }
        leader = min((scored for scored in tried.values() if scored is not None), key=lambda scored: scored.error, default=None)
        if leader is None or suggested_order is None:
            return
        if suggested_order not in tried:
            tried[suggested_order] = self.score(replace(leader.candidate, order=suggested_order))
        worse = 0
        for order in range(leader.candidate.order - 1, 0, -1):
            screened_out = self.screened.get(order, 0.0) > SCREENING_RATIO * self.screened.get(leader.candidate.order, float("inf"))
            smaller = tried.get(order) if order in tried or screened_out else self.score(replace(leader.candidate, order=order))
            worse = 0 if smaller is not None and smaller.error <= TIE_RATIO * leader.error else worse + 1
            if worse >= DESCENT_PATIENCE:
                return

    def select_constants(self, holds: Callable[[Candidate], bool]) -> None:
        """Score the best candidate of each step without offsets and keep either the candidates with or those without offsets.

        Args:
            holds: Whether a candidate's model has a state that does not decay over the data.
        """
        best_per_step = {scored.candidate.step: scored for scored in sorted(self.scores, key=lambda scored: -scored.error)}
        free_error = self.lowest_error
        without_constants = [self.score(replace(scored.candidate, constants=False)) for scored in best_per_step.values()]
        # A pole at one keeps its initial state, which acts as an offset.
        decaying_errors = [scored.error for scored in without_constants if scored is not None and not holds(scored.candidate)]
        constants = not decaying_errors or min(decaying_errors) > OFFSET_ERROR_RATIO * free_error
        self.scores = [scored for scored in self.scores if constants or scored.candidate.constants or not holds(scored.candidate)]
        self.scores.sort(key=lambda scored: scored.candidate.constants is not constants)
        self._running = sum(scored.candidate.constants is constants for scored in self.scores)

    _running: int | None = None

    def select(self) -> Candidate:
        """Return the candidate with the smallest error; at a tie a refined candidate, because refinement uses all data."""
        running = self.scores[: self._running]
        tie_ratio = self.budget.tie_ratio
        refined = _smallest_order([scored for scored in running if scored.candidate.step in REFINEMENTS], tie_ratio)
        unrefined = _smallest_order([scored for scored in running if scored.candidate.step not in REFINEMENTS], tie_ratio)
        if refined is None or unrefined is None:
            return (refined or unrefined or running[0]).candidate
        return (refined if refined.error <= TIE_RATIO * unrefined.error else unrefined).candidate

    def score(self, candidate: Candidate) -> CvScore | None:
        """Return the candidate's score and record it; None if the data of a fold do not support its order."""
        scored = self._score_on(candidate, self.folds)
        if scored is not None:
            self.scores.append(scored)
            self.on_progress(
                f"{candidate.method}, {candidate.lags} lags, order {candidate.order}, {candidate.step}: {scored.error:.3f}"
            )
        return scored

    def _score_on(self, candidate: Candidate, folds: Sequence[Fold]) -> CvScore | None:
        total = []
        with np.errstate(all="ignore"):
            for fold in folds:
                system = fold.training.model(candidate, effort=BRIEF)
                if system is None:
                    return None
                total.append(self.criterion(system, fold.validation, candidate))
            residual_ss, output_ss = np.sum(total, axis=0)
            error = float(np.mean(np.sqrt(residual_ss / np.maximum(output_ss, 1e-300))))
        return CvScore(candidate=candidate, error=error if np.isfinite(error) else float("inf"))


def _smallest_order(scores: Sequence[CvScore], tie_ratio: float) -> CvScore | None:
    """Return the score of the smallest order among those within the tie ratio of the smallest error."""
    lowest_error = min((scored.error for scored in scores), default=float("inf"))
    near = [scored for scored in scores if scored.error <= tie_ratio * lowest_error]
    return min(near, key=lambda scored: (scored.candidate.order, scored.error), default=None)


def _of_each_order(scores: Sequence[CvScore]) -> list[CvScore]:
    """Return the best score of each order, sorted by error."""
    by_order: dict[int, CvScore] = {}
    for scored in sorted(scores, key=lambda scored: scored.error):
        by_order.setdefault(scored.candidate.order, scored)
    return list(by_order.values())


def free_run_squares(system: Affine, validation: Fitting, candidate: Candidate) -> Squares:
    """Return the squares for free runs with estimated initial states."""
    runs = validation.experiments(constants=candidate.constants)
    residual_ss = sum(np.sum(residual(system, item) ** 2, axis=0) for item in runs)
    return np.stack([residual_ss / _free_share(system, runs), _output_ss(validation.experiments())])


def forecast_squares(system: Affine, validation: Fitting, candidate: Candidate) -> Squares:
    """Return the squares for multi-step forecasts, for plants without a usable free run."""
    del candidate
    runs = validation.predictors(2 * HORIZON)
    residual_ss = sum(np.sum(_forecast_errors(system, item) ** 2, axis=0) for item in runs)
    return np.stack([residual_ss / _free_share(system, runs), _output_ss(runs)])


def _free_share(system: Affine, runs: Sequence[Experiment]) -> float:
    """Return the share of the residual not absorbed by the initial states, which are fitted to the validation data.

    A model with more states absorbs more noise of a validation block; without this correction large orders would win.
    """
    values = sum(int(item.there.sum()) for item in runs) * len(system.C)
    return max(1.0 - system.order * len(runs) / max(values, 1), 1e-9)


def folds_of(whole: Fitting, most: int = FOLDS) -> list[Fold]:
    """Return the cross-validation folds: consecutive blocks of the most recent data."""
    records = most_recent(whole.records, CV_SAMPLES_MAX)
    total = sum(len(record) for record in records)
    lowest_error = 4 * (whole.data.lags + 1)
    blocks = max(2, min(most, total // lowest_error))
    cuts = np.linspace(0, total, blocks + 1).round().astype(int)
    folds = []
    for start, stop in pairwise(cuts.tolist()):
        training, validation = [], []
        begin = 0
        for record in records:
            a, b = (min(max(edge - begin, 0), len(record)) for edge in (start, stop))
            pieces = [(0, a), (b, len(record))] if b > a else [(0, len(record))]
            training += [part(record, *piece) for piece in pieces if piece[1] > piece[0]]
            validation += [part(record, a, b)] if b > a else []
            begin += len(record)
        folds.append(Fold(training=_fitting(training, whole), validation=_fitting(validation, whole)))
    return folds


def _fitting(records: Sequence[InputOutputRecord], whole: Fitting) -> Fitting:
    data = whole.data
    return Fitting(data=gram_of(records, data.lags, data.units), records=records, feedthrough=whole.feedthrough)


def _fit_to_all(whole: Fitting, candidate: Candidate, families: Sequence[Candidate]) -> Affine:
    """Return the candidate's model fitted to all data; refinements start from several models to avoid local minima."""
    refines = candidate.step in REFINEMENTS
    all_lags = [replace(candidate, method=family.method, lags=family.lags) for family in families] if refines else []
    candidates = [candidate, *(other for other in all_lags if other != candidate)]
    starts = [start for start in (whole.model(item, effort=BRIEF) for item in candidates) if start is not None]
    if not starts:
        raise PoorExcitation(f"order {candidate.order} is above the rank of the data; give a smaller --order")
    first = min(starts, key=_training_cost(whole, candidate)) if refines else starts[0]
    return whole.model(candidate, first) or first


def _training_cost(whole: Fitting, candidate: Candidate) -> Callable[[Affine], float]:
    if candidate.step == "prediction-error":
        runs = whole.predictors(4 * candidate.order + 4)
        return lambda system: cost(system.predictor(), runs)
    experiments = whole.experiments(constants=candidate.constants)
    return lambda system: cost(system, experiments)


def _output_ss(experiments: Sequence[Experiment]) -> Float[np.ndarray, " p"]:
    return np.asarray(sum(np.sum(item.y**2, axis=0) for item in experiments))


def _forecast_errors(system: Affine, run: Experiment) -> Float[np.ndarray, "T2 p"]:
    """Return the errors of forecasts ``HORIZON`` steps ahead by the model's observer."""
    predictor = system.predictor()
    m1, p = system.B.shape[1], len(system.C)
    K, u, steps = predictor.B[:, -p:], run.u[:, :m1], len(run.y) - HORIZON
    # With little noise the observer is slow, so its initial state is estimated from the run.
    x0 = initial_state(predictor, run)
    drive, correction = u @ system.B.T, (run.y - u @ system.D.T) @ K.T
    x = observer_run(*(np.ascontiguousarray(item) for item in (system.A, predictor.A, drive, correction)), run.there, x0)[:steps]
    # y = C A^h x + Σ C A^(h-1-j) B u_j + D u_h as one matrix product with the inputs in between.
    O = observability(system.A, system.C, HORIZON + 1)
    answers = np.concatenate([(O[HORIZON - 1 :: -1] @ system.B), system.D[None]])
    between = sliding_window_view(u, HORIZON + 1, axis=0).transpose(0, 2, 1).reshape(steps, -1)
    return np.asarray(run.y[HORIZON:] - x @ O[HORIZON].T - between @ answers.transpose(0, 2, 1).reshape(-1, p))
