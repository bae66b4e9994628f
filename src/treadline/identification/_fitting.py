"""Data of a fit with the intermediate results that models share, the refit of the innovation gain.

Last fitting steps of a model:

``subspace``          OKID/ERA or PBSID
``inputs-again``      B, D and the offsets refitted to the free run by linear least squares, A and C kept
``output-error``      A, B, C and D fitted to the free run
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_discrete_are

from treadline.core.linear_systems import most_recent
from treadline.core.models import InputOutputRecord
from treadline.identification._affine import Affine
from treadline.identification._era import HankelSvd
from treadline.identification._gram import Gram, gram_of
from treadline.identification._model_order import bic_order
from treadline.identification._modes import Experiment
from treadline.identification._okid import ObserverMarkov, regression, scaled_observer
from treadline.identification._realisation import StateMap, block_rows, markov_svd, pbsid, realised, state_map
from treadline.identification._refine import (
    Directions,
    experiments_of,
    predictors_of,
    refit,
)

GAIN_SAMPLES = 5_000
"""Number of most recent samples used to fit the innovation gain: a hundred for each of its entries, or nearly so."""
GAIN_ENTRIES = 60
"""Entries of an innovation gain up to which its refit takes less time than the rest of a fit."""
SLOWEST_OBSERVER = 0.95
"""Observer pole allowed in every case: five seconds of memory at 4 Hz."""
GAIN_RUN = 50
"""Shortest unbroken run used to fit the innovation gain; in a shorter run the initial state explains as much."""
RECORD_PER_LAG = 10
"""Samples of the shortest record per lag of a Gram matrix built for intervals only; more lags would cost too many windows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """How a model was fitted: method, lags, order and last fitting step."""

    method: str
    """``okid-era``, ``pbsid`` or ``deconvolution``."""
    lags: int
    order: int
    step: str = "subspace"


@dataclass(kw_only=True, eq=False)
class Fitting:
    """Data of a fit, with the intermediate results that models share."""

    data: Gram
    records: Sequence[InputOutputRecord]
    feedthrough: bool
    _observers: dict[int, tuple[ObserverMarkov, HankelSvd]] = field(default_factory=dict)
    _maps: dict[int, StateMap] = field(default_factory=dict)

    @property
    def fixed(self) -> Bool[np.ndarray, "p m1"]:
        """Mask of the entries of D fixed at zero."""
        m = self.data.units.input_count
        fixed = np.zeros((len(self.data.units.output_scale), m + 1), dtype=bool)
        fixed[:, :m] = not self.feedthrough
        return fixed

    @cached_property
    def experiments(self) -> list[Experiment]:
        """The samples as experiments in standard deviations."""
        return experiments_of(self.records, self.data.units)

    def predictors(self, least: int) -> list[Experiment]:
        """Return the samples with the outputs as additional inputs, in unbroken runs of at least ``least`` samples."""
        return predictors_of(self.experiments, least)

    def with_more_lags(self, lags: int) -> Gram:
        """Return a Gram matrix with more lags if the records are complete and long enough, else the existing one."""
        lengths = [len(record) for record in self.records]
        lags = min(lags, min(lengths) // RECORD_PER_LAG)
        if lags <= self.data.lags or self.data.count != sum(length - self.data.lags for length in lengths):
            return self.data
        return gram_of(self.records, lags, self.data.units)

    def with_gain(self, system: Affine) -> Affine:
        """Return the system with the innovation gain refitted to the one-step prediction, A, B, C and D kept."""
        n, p = system.order, len(system.C)
        recent = experiments_of(most_recent(self.records, GAIN_SAMPLES), self.data.units)
        runs = predictors_of(recent, least=GAIN_RUN)
        if not runs:  # gaps leave no long run; a stable free-run model has innovation gain zero
            return replace(system, K=np.zeros((n, p))) if system.radius < 1.0 else system
        # An observer slower than this limit and than the plant forgets a wrong initial state too late.
        slowest = max(SLOWEST_OBSERVER, system.radius) if system.radius < 1.0 - 1.0 / len(runs[0].y) else SLOWEST_OBSERVER
        start = next((one for one in _observed(system) if one.predictor().radius <= min(slowest, 1.0 - 1e-6)), None)
        if start is None:
            return system
        # K enters the predictor through A - KC, B - KD and K.
        k = np.eye(n * p).reshape(n, p, n * p)
        change = np.einsum("npk,pj->njk", k, -system.block[n:])
        ways = Directions(S=np.pad(np.concatenate([change, k], axis=1), ((0, p), (0, 0), (0, 0))))
        return Affine.of_predictor(refit(start.predictor(), runs, lambda _: ways, ceiling=slowest))

    def observable(self, system: Affine) -> Affine:
        """Return the system with an innovation gain whose observer is stable.

        The gain is refitted, or, of a large system, its own or a Kalman gain.
        """
        if system.order * len(system.C) <= GAIN_ENTRIES:
            return self.with_gain(system)
        if system.K is not None and system.predictor().radius < 1.0:
            return system
        return replace(system, K=_kalman_gain(system))

    def subspace(self, method: str, lags: int, order: int) -> Affine:
        """Return the subspace model from the Gram matrix alone.

        Raises:
            PoorExcitation: If the order is above the rank of the data.
        """
        if method == "pbsid":
            return pbsid(self.data, self._state_map(lags), order, lags, feedthrough=self.feedthrough)
        return realised(*self.observer(lags, order), order)

    def observer(self, lags: int, order: int | None) -> tuple[ObserverMarkov, HankelSvd]:
        """Return OKID's observer in standard deviations and its Hankel matrix, long enough for an order."""
        if lags not in self._observers or self._observers[lags][1].rows < block_rows(self._observers[lags][0], order):
            observer = scaled_observer(self.data, lags, feedthrough=self.feedthrough)
            self._observers[lags] = observer, markov_svd(observer, order)
        return self._observers[lags]

    def bic_order(self, lags: int, allowed: Sequence[int] | None = None) -> int:
        """Return the PBSID order with the smallest BIC, of all or of those allowed."""
        return bic_order(self.data, self._state_map(lags), lags, feedthrough=self.feedthrough, allowed=allowed)

    def _state_map(self, lags: int) -> StateMap:
        if lags not in self._maps:
            theta = regression(self.data, lags, feedthrough=self.feedthrough).theta
            self._maps[lags] = state_map(self.data, lags, theta)
        return self._maps[lags]


def _observed(system: Affine) -> Iterator[Affine]:
    """Yield the system with its own innovation gain, a Kalman gain, and none."""
    if system.K is not None:
        yield system
    yield replace(system, K=_kalman_gain(system))
    yield replace(system, K=np.zeros((system.order, len(system.C))))


def _kalman_gain(system: Affine) -> Float[np.ndarray, "n p"] | None:
    """Return the Kalman gain for input disturbances and measurement noise of a tenth of the standard deviations."""
    Q = 0.01 * (system.B @ system.B.T + 1e-3 * np.eye(system.order))
    R = 0.01 * np.eye(len(system.C))
    try:
        P = solve_discrete_are(system.A.T, system.C.T, Q, R)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(system.A @ P @ system.C.T @ np.linalg.inv(system.C @ P @ system.C.T + R))


def last_samples(experiments: Sequence[Experiment], samples: int) -> list[Experiment]:
    """Return the experiments cut to the last samples."""
    kept: list[Experiment] = []
    for item in reversed(experiments):
        if samples > 0:
            kept.insert(0, item.part(max(0, len(item.y) - samples), len(item.y)))
            samples -= len(item.y)
    return kept
