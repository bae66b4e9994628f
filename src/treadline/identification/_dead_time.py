"""Dead time of each input, found in the data before a model is fitted.

Regressions of each output on its own past and on a window of each input's past (ARX) are compared over the windows' starts by the
BIC; past outputs make them valid in closed loop and for a start far from rest. To such a regression a slow plant under noise
resembles a late one, so a model without dead time, fitted to its free run, is tried once more before a dead time is accepted.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from treadline.core.errors import SettingsError
from treadline.core.linear_systems import most_recent, part
from treadline.core.models import InputOutputRecord
from treadline.identification._decaying_ridge import DECAYS, decaying_ridge
from treadline.identification._gram import gram_of, units_of
from treadline.identification._recursion_kernels import all_pole, slide
from treadline.identification.options import ROWS_PER_PARAMETER, max_supported_lags

DECISIVE = 10.0
"""Difference of the BIC that is very strong evidence (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995)."""
SAME = 1.0
"""Difference of the BIC that says nothing."""
SAMPLES_MOST = 4096
"""Samples that are searched; with 20 % noise 300 suffice, and ten times as many for an integrator in closed loop."""
VERIFIED_MOST = 1024
"""Samples of the fits to the free run, which cost the most."""
RANGE_SHARE = 4
"""Samples of the shortest record per sample of dead time: three quarters of each record remain to be explained."""
RANGE_MOST = 256
"""Largest dead time searched; the time of the search grows with it."""
WIDTH_MOST = 16
"""Largest number of lags of an input after its dead time, and of an output; 8 find the dead time of order 6 a sample late."""
ORDERS = range(1, 7)
"""Orders of models fitted to the free run."""
STEPS = 6
"""Most steps of such a fit."""
ROUNDING = 1e-12
"""Ridge relative to a channel's square, above the rounding errors of a Gram matrix."""

Starts = tuple[int, ...]
"""First lag at which each input acts: 1 without dead time."""


def dead_time(records: Sequence[InputOutputRecord]) -> list[int]:
    """Return the dead time of each input in samples; 0 where the data do not decide for one.

    The range of the search is a quarter of the shortest record, at most ``RANGE_MOST``.
    """
    moves = np.flatnonzero(np.max([np.nanstd(record.u, axis=0) for record in records], axis=0) > 0.0)
    found = np.zeros(records[0].u.shape[1], dtype=int)
    records = [replace(record, u=record.u[:, moves]) for record in records]
    signals = _signals(records)
    data, longest = Lagged.of(signals), max(signals, key=lambda pair: len(pair[0]))
    if data is not None:
        starts = _without_early_paths(data, _separate(data, _common(data)))
        delays = [start - 1 for start in _verified(*longest, starts)]
        found[moves] = delays if any(delays) and _supported(records, delays) else 0
    return [int(delay) for delay in found]


def without_delays(records: Sequence[InputOutputRecord], shifts: Sequence[int]) -> list[InputOutputRecord]:
    """Return the records with each input delayed by its dead time.

    Raises:
        SettingsError: If there is not one shift per input, or a shift is negative or as long as a record.
    """
    m, most = records[0].u.shape[1], max(shifts, default=0)
    whole = all(isinstance(shift, int | np.integer) for shift in shifts)
    if not whole or len(shifts) != m or min(shifts) < 0 or most >= min(len(record) for record in records):
        raise SettingsError(f"delays are {list(shifts)}; give one integer per input ({m}), from 0 to less than a record's length")
    return [part(record.delayed(shifts), most, len(record)) for record in records]


def _supported(records: Sequence[InputOutputRecord], delays: Sequence[int]) -> bool:
    """Whether the evidence of a regression under a prior that decays with the lag grows once the dead time is removed.

    The prior takes distant lags for small: of a late plant it holds only without its dead time, of any other plant with it.
    """
    most = max(delays)
    recent = [record for record in most_recent(records, SAMPLES_MOST) if len(record) > 2 * most]
    if not recent:
        return False
    begun = [part(record, most, len(record)) for record in recent]
    return _evidence(without_delays(recent, delays)) > _evidence(begun)


def _evidence(records: Sequence[InputOutputRecord]) -> float:
    data = gram_of(records, max_supported_lags(records, None, None, penalised=True), units_of(records))
    return max(decaying_ridge(data, decay, feedthrough=True)[1] for decay in DECAYS)


def _signals(records: Sequence[InputOutputRecord]) -> list[tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T p"]]]:
    """Return inputs and outputs in standard deviations, as many as decide; a missing sample is interpolated."""
    kept: list[tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T p"]]] = []
    for record in records:
        room = SAMPLES_MOST - sum(len(u) for u, _ in kept)
        # A piece shorter than every record would shorten the range of the search.
        if not kept or room >= min(len(other) for other in records):
            u, y = _filled(record.u), _filled(record.y)
            parts = max(1, len(u) // room)
            liveliest = int(np.argmax([np.ptp(u[k * room : (k + 1) * room], axis=0).sum() for k in range(parts)]))
            kept.append((u[liveliest * room :][:room], y[liveliest * room :][:room]))
    u, y = np.vstack([u for u, _ in kept]), np.vstack([y for _, y in kept])
    size_u, size_y = np.maximum(u.std(axis=0), 1e-300), np.maximum(y.std(axis=0), 1e-300)
    return [((a - u.mean(axis=0)) / size_u, (b - y.mean(axis=0)) / size_y) for a, b in kept]


def _filled(x: Float[np.ndarray, "T c"]) -> Float[np.ndarray, "T c"]:
    there, at = np.isfinite(x), np.arange(len(x))
    if there.all():
        return x
    return np.column_stack([np.interp(at, at[has], x[has, j]) if has.any() else np.zeros(len(x)) for j, has in enumerate(there.T)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lagged:
    """Gram matrix of a constant, each output's lags 0 … width, and each input's lags 0 … reach + width."""

    gram: Float[np.ndarray, "c c"]
    rows: int
    inputs: int
    outputs: int
    reach: int
    """Largest lag at which an input may first act."""
    width: int

    @classmethod
    def of(cls, signals: Sequence[tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T p"]]]) -> "Lagged | None":
        """Return the matrix of signals; None if they are too few."""
        (m, p), least = (signals[0][0].shape[1], signals[0][1].shape[1]), min(len(u) for u, _ in signals)
        reach = min(least // RANGE_SHARE, RANGE_MOST)
        width = min(WIDTH_MOST, ((least - reach) // ROWS_PER_PARAMETER - 1 - m) // (m + 1))
        if m == 0 or width < 1 or reach < 1:
            return None
        lags = reach + width + 1
        gram = reduce(np.add, (_lagged_gram(u, y, lags, width) for u, y in signals))
        rows = sum(len(u) - lags for u, _ in signals)
        gram[np.diag_indices_from(gram)] += ROUNDING * rows
        return cls(gram=gram, rows=rows, inputs=m, outputs=p, reach=reach, width=width)

    @property
    def lags(self) -> int:
        """Number of lags of an input."""
        return self.reach + self.width + 1

    def of_output(self, i: int, lag: int) -> int:
        """Return the column of an output's lag."""
        return 1 + i * (self.width + 1) + lag

    def of_input(self, j: int, lag: int) -> int:
        """Return the column of an input's lag."""
        return 1 + self.outputs * (self.width + 1) + lag * self.inputs + j

    def base(self, i: int, own: int) -> list[int]:
        """Return the columns that all regressions of an output share.

        The inputs of the same sample are among them: a controller without dead time makes them depend on the output's noise.
        """
        shared = [0, *(self.of_input(j, 0) for j in range(self.inputs))]
        return [*shared, *(self.of_output(i, lag) for lag in range(1, own + 1))]

    def windows(self, starts: Sequence[Starts], width: int) -> Int[np.ndarray, "f w m"]:
        """Return the columns of the inputs' windows for each of the starts, lag by lag."""
        lags = np.array(starts)[:, None, :] + np.arange(width)[None, :, None]
        return np.asarray(self.of_input(0, 0) + lags * self.inputs + np.arange(self.inputs))

    def bic(self, i: int, base: Sequence[int], added: Int[np.ndarray, "f s k"]) -> Float[np.ndarray, "f s1"]:
        """Return the BIC of regressions of an output on the base and on the first 0, 1, … groups of added columns."""
        count, groups, size = added.shape
        columns = np.hstack([added.reshape(count, -1), np.full((count, 1), self.of_output(i, 0))])
        needed, at = np.unique(columns, return_inverse=True)
        at, held = at.reshape(columns.shape), np.asarray(base, dtype=int)
        # The base, which all share, is eliminated once.
        factor = np.linalg.cholesky(self.gram[np.ix_(held, held)])
        through = solve_triangular(factor, self.gram[np.ix_(held, needed)], lower=True).T[at]
        left = self.gram[columns[:, :, None], columns[:, None, :]] - through @ np.swapaxes(through, 1, 2)
        last = np.linalg.cholesky(left)[:, -1]
        squares = np.cumsum((last**2)[:, ::-1], axis=1)[:, ::-1][:, size * np.arange(groups + 1)]
        unknowns = len(base) + size * np.arange(groups + 1)
        return np.asarray(self.rows * np.log(squares / self.rows) + math.log(self.rows) * unknowns)


def _lagged_gram(u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"], lags: int, width: int) -> Float[np.ndarray, "c c"]:
    """Return the products of one record's columns."""
    (T, m), rows = u.shape, len(u) - lags
    size = 2 ** math.ceil(math.log2(2 * T))
    spectrum = np.fft.rfft(u.T, size)

    def with_inputs(x: Float[np.ndarray, "q r"]) -> Float[np.ndarray, "q w"]:
        products = np.fft.irfft(np.conj(np.fft.rfft(x, size))[:, None] * spectrum, size)[:, :, lags - np.arange(lags)]
        return np.ascontiguousarray(np.swapaxes(products, 1, 2)).reshape(len(x), -1)

    own = [np.stack([y[lags - a : T - a, i] for a in range(width + 1)]) for i in range(y.shape[1])]
    past, among = np.concatenate([np.ones((1, rows)), *own]), np.zeros((m * lags, m * lags))
    first = with_inputs(u[lags:].T)
    slide(first, u[lags - 1 : 0 : -1].ravel(), u[: T - lags : -1].ravel(), among)
    cross = with_inputs(past)
    return np.block([[past @ past.T, cross], [cross.T, among]])


def _scores(
    data: Lagged, own: Sequence[int], starts: Sequence[Starts], width: int, free: Sequence[int]
) -> Float[np.ndarray, "f s1"]:
    """Return the BIC of all outputs for each of the starts, and for 0 to ``width`` lags of the free inputs' windows.

    The other inputs start at the same lags in all.
    """
    windows = data.windows(starts, width)
    shared = np.delete(windows[0], free, axis=1).ravel().tolist()
    bases = [[*data.base(i, own[i]), *shared] for i in range(data.outputs)]
    return reduce(np.add, (data.bic(i, base, windows[:, :, free]) for i, base in enumerate(bases)))


def _own_lags(data: Lagged, starts: Starts) -> list[int]:
    """Return the number of its own lags that explains each output best together with the inputs' windows."""
    window = data.windows([starts], _half(data)).ravel().tolist()
    added = [[[[data.of_output(i, lag)] for lag in range(1, data.width + 1)]] for i in range(data.outputs)]
    return [int(data.bic(i, [*data.base(i, 0), *window], np.array(added[i]))[0].argmin()) for i in range(data.outputs)]


def _half(data: Lagged) -> int:
    return max(1, data.width // 2)


def _price(data: Lagged) -> float:
    """Return how much better a dead time must be: decisively, after a choice among as many as the range holds."""
    return DECISIVE + 2.0 * math.log(data.reach)


def _best_start(data: Lagged, free: Sequence[int], others: Starts) -> tuple[float, Starts]:
    """Return the best common start of some inputs: from a coarse search, refined with wide windows.

    Where a window well before does as well, it counts, so that a periodic input is not found a period late.
    """

    def at(lag: int) -> Starts:
        return tuple(lag if j in free else other for j, other in enumerate(others))

    def scores(lags: Sequence[int], own: Sequence[int], width: int) -> Float[np.ndarray, " f"]:
        return np.asarray(_scores(data, own, [at(lag) for lag in lags], width, free)[:, 1:].min(axis=1))

    half = _half(data)
    coarse = range(1, data.reach + 1, max(1, half // 2))
    near = coarse[int(scores(coarse, [half] * data.outputs, half).argmin())]
    own = _own_lags(data, at(near))
    fine = range(max(1, near - half), min(data.reach, near + half) + 1)
    refined = scores(fine, own, data.width)
    best, score = fine[int(refined.argmin())], float(refined.min())
    before = range(1, best - data.width)
    if before:
        same = np.flatnonzero(scores(before, own, half) < scores([best], own, half)[0] + SAME)
        best = before[int(same[0])] if same.size else best
    return score, at(best)


def _common(data: Lagged) -> Starts:
    """Return the start of all inputs, if one dead time explains the outputs decisively better than none, and than no input."""
    none, every = (1,) * data.inputs, range(data.inputs)
    score, starts = _best_start(data, every, none)
    without = float(_scores(data, _own_lags(data, starts), [none], data.width, every).min())
    return starts if without - score > _price(data) else none


def _separate(data: Lagged, starts: Starts) -> Starts:
    """Return the starts after each input's own, where that is decisively better, has replaced the others'."""
    for _ in range(data.inputs if data.inputs > 1 else 0):
        before = starts
        for j in range(data.inputs):
            score, other = _best_start(data, [j], starts)
            now = float(_scores(data, _own_lags(data, other), [starts], data.width, [j]).min())
            # The first to differ is chosen among many; after it a better start needs no more evidence.
            if now - score > (_price(data) if len(set(starts)) == 1 else 0.0):
                starts = other
        if starts == before:
            break
    return starts


def _without_early_paths(data: Lagged, starts: Starts) -> Starts:
    """Return the starts moved to the earliest lag that explains an output in addition to the windows: there may be two paths."""
    own, found = _own_lags(data, starts), list(starts)
    for j, start in enumerate(starts):
        if start == 1:
            continue
        early = np.array([[[data.of_input(j, lag)]] for lag in range(1, start)])
        window = data.windows([starts], data.width).ravel().tolist()
        scores = np.sum([data.bic(i, [*data.base(i, own[i]), *window], early) for i in range(data.outputs)], axis=0)
        acts = np.flatnonzero(scores[:, 0] - scores[:, 1] > _price(data))
        found[j] = 1 + int(acts[0]) if acts.size else start
    return tuple(found)


def _verified(u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"], starts: Starts) -> Starts:
    """Return the starts, 1 for inputs whose dead time a model without it, fitted to its free run, does not need.

    Fitted is the output that the inputs explain best.
    """
    u, y = u[:VERIFIED_MOST], y[:VERIFIED_MOST]
    data = Lagged.of([(u, y)]) if max(starts) > 1 else None
    if data is None:
        return starts
    groups = [range(data.inputs)] if len(set(starts)) == 1 else [[j] for j in range(data.inputs)]
    for free in groups:
        none = tuple(1 if j in free else start for j, start in enumerate(starts))
        if none == starts:
            continue
        own = _own_lags(data, starts)
        regressed = [data.bic(i, data.base(i, own[i]), data.windows([starts, none], data.width)) for i in range(data.outputs)]
        i = int(np.argmax([scores[0, 0] - scores[0].min() for scores in regressed]))
        late, denominator = _free_run_score(u, y[data.lags :, i], starts, [])
        early, _ = _free_run_score(u, y[data.lags :, i], none, denominator)
        if min(regressed[i][1].min(), early) - min(regressed[i][0].min(), late) < _price(data):
            starts = none
    return starts


def _free_run_score(
    u: Float[np.ndarray, "T m"], y: Float[np.ndarray, " t"], starts: Starts, also: Sequence[float]
) -> tuple[float, Sequence[float]]:
    """Return the smallest BIC of models of an output's last samples fitted to the free run, and its denominator.

    Args:
        also: Denominator from which fits of its order and above begin.
    """
    T = len(u) - len(y)
    v = np.column_stack([u[T - start + 1 : len(u) - start + 1, j] for j, start in enumerate(starts)])
    begun = [[*also, *[0.0] * (n - len(also))] if len(also) <= n else [0.0] * n for n in ORDERS]
    return min((_output_error(y, v, start) for start in begun), key=lambda pair: pair[0])


def _output_error(y: Float[np.ndarray, " T"], v: Float[np.ndarray, "T m"], start: Sequence[float]) -> tuple[float, Sequence[float]]:
    """Return the BIC and the denominator of the transfer function that fits the free run (Steiglitz and McBride, 1965).

    Each step is a regression of signals filtered by the last denominator, whose residual is the free run's error at the end.
    """
    (T, m), n = v.shape, len(start)
    impulse = np.eye(1, T)[0]
    signals, a, best = np.column_stack([y, v, impulse, np.ones(T)]), np.array(start), (math.inf, start)
    for _ in range(STEPS):
        made = all_pole(a, signals)
        held = np.vstack([np.zeros((n, m + 3)), made])
        past = [-held[n - k : n + T - k, 0] for k in range(1, n + 1)]
        past += [held[n - k : n + T - k, 1 + j] for j in range(m) for k in range(1, n + 1)]
        X = np.column_stack([*past, *(held[n - k : n + T - k, m + 1] for k in range(n)), made[:, m + 2]])
        size = np.sqrt(np.einsum("tk,tk->k", X, X)) + 1e-300
        X /= size
        square = X.T @ X
        square[np.diag_indices_from(square)] += ROUNDING
        found = np.linalg.solve(square, X.T @ made[:, 0])
        error = made[:, 0] - X @ found
        score = T * math.log(float(error @ error) / T + ROUNDING) + math.log(T) * n * (1 + m)
        a = found[:n] / size[:n]
        radius = max(1.0, float(np.abs(np.roots([1.0, *a])).max()))
        a *= radius ** -np.arange(1.0, n + 1.0)  # a growing filter would overflow
        if not math.isfinite(score) or abs(score - best[0]) < SAME:
            break
        best = min(best, (score, a.tolist()), key=lambda pair: pair[0])
    return best
