"""Data of a fit, and the refit of the innovation gain.

Last fitting steps of a model:

``subspace``          OKID/ERA or PBSID
``inputs-again``      B, D and the offsets refitted to the free run by linear least squares, A and C kept
``output-error``      A, B, C and D fitted to the free run
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_discrete_are

from treadline.core.linear_systems import most_recent
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.state_space import Provenance
from treadline.core.turning import NAME_PRIOR
from treadline.identification._affine import INSIDE, Affine, stabilised, to_model
from treadline.identification._checks import channel_names
from treadline.identification._era import HankelSvd
from treadline.identification._gram import Gram, gram_of
from treadline.identification._limits import RECENT
from treadline.identification._modes import Experiment, with_inputs_again
from treadline.identification._okid import ObserverMarkov
from treadline.identification._refine import experiments_of, predictors_of, refit

GAIN_ENTRIES = 60
"""Entries of an innovation gain up to which its refit takes less time than the rest of a fit."""
SLOWEST_OBSERVER = 0.95
"""Observer pole allowed in every case: five seconds of memory at 4 Hz."""
GAIN_RUN = 50
"""Shortest unbroken run used to fit the innovation gain; in a shorter run the initial state explains as much."""
RECORD_PER_LAG = 10
"""Samples of the shortest record per lag of a Gram matrix built for intervals only; more lags would cost too many windows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateScore:
    """Member of the ensemble of ``best`` and its distance from the median."""

    order: int
    decay: float
    """Ratio of prior variances of successive lags."""
    distance: float | None
    """Squared distance from the median free run and impulse response, relative to their size; None for a diverging model."""
    chosen: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitting:
    """Data of a fit."""

    data: Gram
    records: Sequence[InputOutputRecord]
    feedthrough: bool

    @property
    def fixed(self) -> Bool[np.ndarray, "p m1"]:
        """Mask of the entries of D fixed at zero."""
        m = self.data.units.input_count
        fixed = np.zeros((len(self.data.units.output_scale), m + 1), dtype=bool)
        fixed[:, :m] = not self.feedthrough
        return fixed

    @property
    def experiments(self) -> list[Experiment]:
        """The samples as experiments in standard deviations; made anew, because those of a long record fill the memory."""
        return experiments_of(self.records, self.data.units)

    def with_more_lags(self, lags: int) -> Gram:
        """Return a Gram matrix with more lags if the records are complete and long enough, else the existing one."""
        lengths = [len(record) for record in self.records]
        lags = min(lags, min(lengths) // RECORD_PER_LAG)
        if lags <= self.data.lags or self.data.count != sum(length - self.data.lags for length in lengths):
            return self.data
        return gram_of(self.records, lags, self.data.units)

    def with_gain(self, system: Affine) -> Affine:
        """Return the system with an innovation gain whose observer is stable, A, B, C and D kept.

        The gain is refitted to the one-step prediction; of a large system it is its own, or a Kalman gain.
        """
        n, p = system.order, len(system.C)
        runs, slowest = [], 1.0
        if n * p <= GAIN_ENTRIES:
            # A quarter of the samples has a hundred, or nearly so, for each entry of the gain.
            runs = predictors_of(experiments_of(most_recent(self.records, RECENT // 4), self.data.units), least=GAIN_RUN)
            if not runs:  # gaps leave no long run; a stable free-run model has innovation gain zero
                return replace(system, K=np.zeros((n, p))) if system.radius < 1.0 else system
            # An observer slower than this limit and than the plant forgets a wrong initial state too late.
            slowest = max(SLOWEST_OBSERVER, system.radius) if system.radius < 1.0 - 1.0 / len(runs[0].y) else SLOWEST_OBSERVER
        start = next((one for one in _observed(system) if one.predictor().radius <= min(slowest, INSIDE)), None)
        if start is None or not runs:
            return start or min(_observed(system), key=lambda one: one.predictor().radius)
        # K enters the predictor through A - KC, B - KD and K.
        k = np.eye(n * p).reshape(n, p, n * p)
        change = np.einsum("npk,pj->njk", k, -system.block[n:])
        ways = np.pad(np.concatenate([change, k], axis=1), ((0, p), (0, 0), (0, 0)))
        return Affine.of_predictor(refit(start.predictor(), runs, lambda _: ways, ceiling=slowest))


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Structure of the data before a model is fitted."""

    lags: int
    observer: ObserverMarkov
    """OKID's observer in standard deviations."""
    svd: HankelSvd
    structural: int | None
    """Largest order possible with the observer's lags; None for noise-free data."""
    noise: float | None
    """Largest singular value of noise alone; None for a given order."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedSystem:
    """Fitted system in standard deviations, with the data and choices that led to it."""

    fitting: Fitting
    evidence: Evidence
    subspace: str
    """``okid-era``, ``pbsid``, ``deconvolution`` or ``by names``."""
    lags: int
    order: int
    system: Affine
    step: str = "subspace"
    candidates: Sequence[CandidateScore] = ()
    """Members of the ensemble, nearest to the median first."""
    warnings: Sequence[str] = ()

    def model(self, method: str, *, name_prior: bool) -> LinearModel:
        """Return the model in the record's units; its provenance has method, order, lags, last step, and what the names may say."""
        known: Provenance = {"method": method, "order": self.order, "lags": self.lags, "step": self.step, NAME_PRIOR: name_prior}
        names = channel_names(self.fitting.records[0])
        return to_model(self.system, self.fitting.data.units, self.fitting.data.dt_s, names, known)

    def reflected(self) -> "FittedSystem":
        """Return the model with unstable poles reflected, inputs and gain fitted to them; a stable model is returned unchanged."""
        system = stabilised(self.system)
        if system is self.system:
            return self
        system = with_inputs_again(system, self.fitting.experiments, self.fitting.fixed)
        return replace(self, system=self.fitting.with_gain(system))
