"""The best model the data can tell: recipes are judged on data they have not seen, each step kept only if it helps.

Experiments are cut into blocks; each block in turn judges what was fitted to the others (cross-validation). Rows of
recipes, a method and a number of lags each, climb in order until nothing is gained; the leaders of different order are
refined; constants of rates are taken for zero unless held-out data speak against it. The recipe with the smallest error
wins, a smaller order where two are equal, and is run on all data. One rule for all data: nothing is chosen by hand.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from treadline.errors import PoorExcitation
from treadline.identification.affine import Affine
from treadline.identification.fitting import GROWTH, Fitting, Recipe
from treadline.identification.gram import gram_of
from treadline.identification.intervals import of_observer
from treadline.identification.kernels import observability, observer_run
from treadline.identification.refine import BRIEF, Experiment, cost, initial_state, misfit
from treadline.identification.structure import ORDER_MOST
from treadline.identification.validate import most_recent, part
from treadline.models import InputOutputRecord

BLOCKS = 5
"""Blocks that judge in turn."""
BLOCKS_IF_SURE = 3
"""The same where the order is beyond doubt, so that little is left to judge."""
ROWS_PER_STATE = 8
"""Numbers of a block held out, at its middle length, per state that is estimated at its start."""
PATIENCE = 3
"""Orders that may pass without gain before a row ends."""
LAGS = (10, 20, 40)
"""Lags tried beside those of Schwarz's criterion, as far as the data carry them; short data as many as they do."""
DESCENT = 2
"""Smaller orders that may do worse before the descent ends: modes come in pairs."""
FAR = 1.5
"""Ratio of errors by every other block from which a smaller order is not tried again."""
EQUAL = 1.005
"""Ratio of errors within which the smaller order is taken."""
RATES = ("_m_s", "_rad_s")
"""Units whose zero is rest. Where all channels have one, constants are zero unless the data speak against it."""
ZERO_COSTS = 1.25
"""Ratio of errors beyond which they do."""
HOPELESS = 0.95
"""Error of free runs from which forecasts judge instead: no free run explains anything."""
HORIZON = 10
"""Steps of those forecasts."""
JUDGED_MOST = 20_000
"""Samples that are cut into blocks; more would not change the choice."""

REFINEMENTS = ("output-error", "prediction-error")


@dataclass(frozen=True, slots=True, kw_only=True)
class Breadth:
    """How widely recipes are tried."""

    foremost: int
    """Recipes that are judged by all blocks; the others by every other one."""
    leaders: int
    """Orders whose best recipe is refined."""
    equal: float
    """Ratio of errors within which the smaller order wins."""


WIDE = Breadth(foremost=8, leaders=3, equal=EQUAL)
NARROW = Breadth(foremost=3, leaders=1, equal=1.02)
"""Where the singular values show the order clearly: there it is, or next to it."""

Squares = Float[np.ndarray, "2 p"]
"""Sums of squares of what a model leaves of some outputs, and of those outputs about the data's mean."""
Criterion = Callable[[Affine, Fitting, Recipe], Squares]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A recipe and its error on data held out, over the outputs' spread."""

    recipe: Recipe
    error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fold:
    """What is fitted, and the block that judges it."""

    fitted: Fitting
    held: Fitting


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """The recipe that won, its model of all data, and all that were tried."""

    recipe: Recipe
    system: Affine
    trials: list[Trial]


def best(
    whole: Fitting,
    *,
    lags: int,
    order: int | None,
    guess: int,
    sure: bool,
    names: Sequence[str],
    told: Callable[[str], None] = lambda _: None,
) -> Choice:
    """Return the best model of some data.

    Args:
        lags: Lags of Schwarz's criterion.
        order: Number of states; chosen when left out.
        guess: Order that the singular values show; it is tried in any case.
        sure: Whether they show it beyond doubt: then only its neighbours are tried.
        names: Channel names, for the units among them.
        told: Is told what is tried.
    """
    around = order is None and sure
    folds = folds_of(whole, BLOCKS_IF_SURE if around or order is not None else BLOCKS)
    orders = range(1, _most_states(folds) + 1) if order is None else range(order, order + 1)
    if around:
        orders = range(max(1, guess - 1), guess + 2)
    first = Recipe(method="okid-era", lags=lags, order=0)
    others = {lags, min(LAGS[0], whole.data.lags), *(n for n in LAGS if n <= whole.data.lags)}
    rows = [Recipe(method="pbsid", lags=other, order=0) for other in sorted(others)]
    breadth = NARROW if around or order is not None else WIDE
    if breadth is WIDE:
        rows = [first, *rows]
    search = Search(folds=folds, criterion=free_runs, breadth=breadth, told=told)
    about = guess if order is None else order
    if not ((sure and _may_integrate(whole, replace(first, order=about))) or _grows(whole, [first, *rows], about)):
        search.climb([replace(row, step="inputs-again") for row in rows], orders)
    by_forecasts = not search.trials or search.least > HOPELESS
    if by_forecasts:
        search = Search(folds=folds, criterion=forecasts, breadth=breadth, told=told)
        search.climb(rows, orders)
    if not search.trials and order is not None:
        raise PoorExcitation(f"order {order} is above what {whole.data.lags} lags of these data show; ask for less")
    if not search.trials or not np.isfinite(search.least):
        raise PoorExcitation("no model explains data that it has not seen; give a longer record, or inputs that move more")
    search.refine("prediction-error" if by_forecasts else "output-error", guess if order is None else None)
    if not by_forecasts and all(name.endswith(RATES) for name in names):
        search.settle_constants(lambda recipe: _does_not_decay(whole, recipe))
    recipe = search.winner()
    system = whole.with_gain(_on_all(whole, recipe, rows if breadth is WIDE else []), constants=recipe.constants)
    return Choice(recipe=recipe, system=system, trials=search.trials)


def _most_states(folds: Sequence[Fold]) -> int:
    """Return the largest order tried: of an initial state as large as a short block, any block would be explained."""
    blocks = [item.y.size for fold in folds for item in fold.held.experiments()]
    return max(1, min(ORDER_MOST, int(np.median(blocks)) // ROWS_PER_STATE))


def _does_not_decay(whole: Fitting, recipe: Recipe) -> bool:
    """Whether a state of a recipe's model lasts for the whole record."""
    system = whole.model(recipe, effort=BRIEF)
    return system is None or system.radius > 1.0 - 1.0 / max(len(record) for record in whole.records)


def _may_integrate(whole: Fitting, recipe: Recipe) -> bool:
    """Whether a pole may be an integrator, as a chair's heading: its free run drifts with the smallest disturbance."""
    system = whole.model(recipe)
    if system is None:
        return False
    observer, svd = whole.observer(recipe.lags, recipe.order)
    radii = of_observer(observer, svd, system, whole.units(), whole.data).pole_radii()
    return bool((np.abs(np.linalg.eigvals(system.A) - 1.0) <= radii).any())


def _grows(whole: Fitting, rows: Sequence[Recipe], order: int) -> bool:
    """Whether, whatever the method and the lags, a mode grows so much over a record that a free run shows nothing else."""
    systems = [whole.model(replace(row, order=order)) for row in rows]
    longest = max(len(record) for record in whole.records)
    return all(system is not None and longest * np.log(system.radius) > np.log(GROWTH) for system in systems)


@dataclass(slots=True, kw_only=True, eq=False)
class Search:
    """Recipes tried so far."""

    folds: Sequence[Fold]
    criterion: Criterion
    breadth: Breadth
    told: Callable[[str], None]
    trials: list[Trial] = field(default_factory=list)
    screened: dict[int, float] = field(default_factory=dict)
    """Error of the best recipe of each order by every other block."""

    @property
    def least(self) -> float:
        """Smallest error."""
        return min(trial.error for trial in self.trials)

    def climb(self, rows: Sequence[Recipe], orders: range) -> None:
        """Try rising orders of each row until they bring nothing more; then judge the foremost by all folds."""
        seen: list[Trial] = []
        for row in rows:
            least, since = float("inf"), 0
            for order in orders:
                trial = self._judged(replace(row, order=order), self.folds[1::2])
                if trial is None:
                    break
                seen.append(trial)
                since = 0 if trial.error * EQUAL < least else since + 1
                least = min(least, trial.error)
                if since >= PATIENCE:
                    break
        self.screened = {trial.recipe.order: trial.error for trial in reversed(_of_each_order(seen))}
        for trial in sorted(seen, key=lambda trial: trial.error)[: self.breadth.foremost]:
            self.judge(trial.recipe)

    def refine(self, step: str, guess: int | None) -> None:
        """Try a further step on the best recipe of each leading order, then on smaller orders while they do as well.

        Args:
            guess: An order to be tried in any case; None where the order is settled.
        """
        foremost = _of_each_order(self.trials)[: self.breadth.leaders]
        tried: dict[int, Trial | None] = {trial.recipe.order: self.judge(replace(trial.recipe, step=step)) for trial in foremost}
        leader = min((trial for trial in tried.values() if trial is not None), key=lambda trial: trial.error, default=None)
        if leader is None or guess is None:
            return
        if guess not in tried:
            tried[guess] = self.judge(replace(leader.recipe, order=guess))
        worse = 0
        for order in range(leader.recipe.order - 1, 0, -1):
            far = self.screened.get(order, 0.0) > FAR * self.screened.get(leader.recipe.order, float("inf"))
            smaller = tried.get(order) if order in tried or far else self.judge(replace(leader.recipe, order=order))
            worse = 0 if smaller is not None and smaller.error <= EQUAL * leader.error else worse + 1
            if worse >= DESCENT:
                return

    def settle_constants(self, holds: Callable[[Recipe], bool]) -> None:
        """Try the best of each step with rest at zero, and leave in the running the kind that is to be believed.

        Args:
            holds: Whether a recipe's model has a state that does not decay over the data.
        """
        leaders = {trial.recipe.step: trial for trial in sorted(self.trials, key=lambda trial: -trial.error)}
        free = self.least
        zero = [self.judge(replace(trial.recipe, constants=False)) for trial in leaders.values()]
        # A pole at one keeps what its initial state says: a constant by another name.
        sound = [trial.error for trial in zero if trial is not None and not holds(trial.recipe)]
        constants = not sound or min(sound) > ZERO_COSTS * free
        self.trials = [trial for trial in self.trials if constants or trial.recipe.constants or not holds(trial.recipe)]
        self.trials.sort(key=lambda trial: trial.recipe.constants is not constants)
        self._running = sum(trial.recipe.constants is constants for trial in self.trials)

    _running: int | None = None

    def winner(self) -> Recipe:
        """Return the recipe with the smallest error; of equals a refined one, which uses the data fully."""
        running = self.trials[: self._running]
        equal = self.breadth.equal
        refined = _smallest([trial for trial in running if trial.recipe.step in REFINEMENTS], equal)
        plain = _smallest([trial for trial in running if trial.recipe.step not in REFINEMENTS], equal)
        if refined is None or plain is None:
            return (refined or plain or running[0]).recipe
        return (refined if refined.error <= EQUAL * plain.error else plain).recipe

    def judge(self, recipe: Recipe) -> Trial | None:
        """Add the trial of a recipe; None where the data of a fold do not show as many states."""
        trial = self._judged(recipe, self.folds)
        if trial is not None:
            self.trials.append(trial)
            self.told(f"{recipe.method}, {recipe.lags} lags, order {recipe.order}, {recipe.step}: {trial.error:.3f}")
        return trial

    def _judged(self, recipe: Recipe, folds: Sequence[Fold]) -> Trial | None:
        total = []
        with np.errstate(all="ignore"):
            for fold in folds:
                system = fold.fitted.model(recipe, effort=BRIEF)
                if system is None:
                    return None
                total.append(self.criterion(system, fold.held, recipe))
            left, spread = np.sum(total, axis=0)
            error = float(np.mean(np.sqrt(left / np.maximum(spread, 1e-300))))
        return Trial(recipe=recipe, error=error if np.isfinite(error) else float("inf"))


def _smallest(trials: Sequence[Trial], equal: float) -> Trial | None:
    """Return the trial of the smallest order among those with the smallest error."""
    least = min((trial.error for trial in trials), default=float("inf"))
    near = [trial for trial in trials if trial.error <= equal * least]
    return min(near, key=lambda trial: (trial.recipe.order, trial.error), default=None)


def _of_each_order(trials: Sequence[Trial]) -> list[Trial]:
    """Return the best trial of each order, the best order first."""
    by_order: dict[int, Trial] = {}
    for trial in sorted(trials, key=lambda trial: trial.error):
        by_order.setdefault(trial.recipe.order, trial)
    return list(by_order.values())


def free_runs(system: Affine, held: Fitting, recipe: Recipe) -> Squares:
    """Judge by free runs, initial states estimated."""
    runs = held.experiments(constants=recipe.constants)
    left = sum(np.sum(misfit(system, item) ** 2, axis=0) for item in runs)
    return np.stack([left / _not_fitted(system, runs), _spread(held.experiments())])


def forecasts(system: Affine, held: Fitting, recipe: Recipe) -> Squares:
    """Judge by forecasts some steps ahead, for plants that no free run can follow."""
    del recipe
    runs = held.predictors(2 * HORIZON)
    left = sum(np.sum(_forecast_errors(system, item) ** 2, axis=0) for item in runs)
    return np.stack([left / _not_fitted(system, runs), _spread(runs)])


def _not_fitted(system: Affine, runs: Sequence[Experiment]) -> float:
    """Return the share of what is judged that the initial states, which are fitted to it, leave.

    A model of more states takes more of a held-out block's noise up by its start: unless that is counted, it is preferred.
    """
    values = sum(int(item.there.sum()) for item in runs) * len(system.C)
    return max(1.0 - system.order * len(runs) / max(values, 1), 1e-9)


def folds_of(whole: Fitting, most: int = BLOCKS) -> list[Fold]:
    """Return the data cut into blocks that judge in turn; each fits with what the others hold."""
    records = most_recent(whole.records, JUDGED_MOST)
    total = sum(len(record) for record in records)
    least = 4 * (whole.data.lags + 1)
    blocks = max(2, min(most, total // least))
    cuts = np.linspace(0, total, blocks + 1).round().astype(int)
    folds = []
    for start, stop in pairwise(cuts.tolist()):
        fitted, held = [], []
        begin = 0
        for record in records:
            a, b = (min(max(edge - begin, 0), len(record)) for edge in (start, stop))
            pieces = [(0, a), (b, len(record))] if b > a else [(0, len(record))]
            fitted += [part(record, *piece) for piece in pieces if piece[1] > piece[0]]
            held += [part(record, a, b)] if b > a else []
            begin += len(record)
        folds.append(Fold(fitted=_fitting(fitted, whole), held=_fitting(held, whole)))
    return folds


def _fitting(records: Sequence[InputOutputRecord], whole: Fitting) -> Fitting:
    data = whole.data
    return Fitting(data=gram_of(records, data.lags, data.units), records=records, feedthrough=whole.feedthrough)


def _on_all(whole: Fitting, recipe: Recipe, rows: Sequence[Recipe]) -> Affine:
    """Return the recipe's model of all data; where a step may end in a side valley, from several starts."""
    refines = recipe.step in REFINEMENTS
    others = [replace(recipe, method=row.method, lags=row.lags) for row in rows] if refines else []
    recipes = [recipe, *(other for other in others if other != recipe)]
    starts = [start for start in (whole.model(item, effort=BRIEF) for item in recipes) if start is not None]
    if not starts:
        raise PoorExcitation(f"order {recipe.order} is above what the whole data show; give a smaller --order")
    first = min(starts, key=_training_cost(whole, recipe)) if refines else starts[0]
    return whole.model(recipe, first) or first


def _training_cost(whole: Fitting, recipe: Recipe) -> Callable[[Affine], float]:
    if recipe.step == "prediction-error":
        runs = whole.predictors(4 * recipe.order + 4)
        return lambda system: cost(system.predictor(), runs)
    experiments = whole.experiments(constants=recipe.constants)
    return lambda system: cost(system, experiments)


def _spread(experiments: Sequence[Experiment]) -> Float[np.ndarray, " p"]:
    return np.asarray(sum(np.sum(item.y**2, axis=0) for item in experiments))


def _forecast_errors(system: Affine, run: Experiment) -> Float[np.ndarray, "T2 p"]:
    """Return the errors of forecasts ``HORIZON`` steps ahead, by the model's observer."""
    predictor = system.predictor()
    m1, p = system.B.shape[1], len(system.C)
    K, u, steps = predictor.B[:, -p:], run.u[:, :m1], len(run.y) - HORIZON
    # Where noise is small the observer is slow: its initial state is estimated, not waited for.
    x0 = initial_state(predictor, run)
    drive, correction = u @ system.B.T, (run.y - u @ system.D.T) @ K.T
    x = observer_run(*(np.ascontiguousarray(item) for item in (system.A, predictor.A, drive, correction)), run.there, x0)[:steps]
    # y = C A^h x + Σ C A^(h-1-j) B u_j + D u_h: as one product with the inputs in between.
    O = observability(np.ascontiguousarray(system.A), np.ascontiguousarray(system.C), HORIZON + 1)
    answers = np.concatenate([(O[HORIZON - 1 :: -1] @ system.B), system.D[None]])
    between = sliding_window_view(u, HORIZON + 1, axis=0).transpose(0, 2, 1).reshape(steps, -1)
    return np.asarray(run.y[HORIZON:] - x @ O[HORIZON].T - between @ answers.transpose(0, 2, 1).reshape(-1, p))
