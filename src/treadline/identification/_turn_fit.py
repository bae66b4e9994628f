"""Yaw rate of a vehicle by its inputs: gains, lags and dead time with intervals, for a skid-steer vehicle in words.

The yaw rate is r = g_right x_right - g_left x_left + c + n, each x a belt speed behind a dead time and a first-order lag, and n an
autoregression; other inputs steer alike. All of it is fitted by the prediction error, which in closed loop needs no dither beyond
what the structure leaves open (Ljung, System Identification, 1999, section 13.4). The yaw rate alone shows no common scale of belts
and gauge: the scales are relative to their mean, and the gauge is the effective one, larger than the belts' distance by what slip
costs.

Turn model by names in place of a free model whose yaw gain it contradicts.

In closed loop a free model may be the controller's inverse, and from few or noisy data its steady gain is a guess. The structure (a
lag of each belt, the heading as integral of the yaw rate) has five parameters and an interval of the yaw gain. A free model within
that interval stays. One outside is replaced if belts follow the outputs, or if its free run is not better by more than its further
parameters are worth (BIC).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import LinAlgError
from scipy.signal import lfilter

from treadline.core.linear_systems import fit_percent, most_recent, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.turning import radians, turn_channels
from treadline.identification._dead_time import dead_time
from treadline.identification._drive_log import DifferentialInput, named_belts, turn_rate
from treadline.identification._gram import runs_of
from treadline.identification._intervals import Estimate, covariance_of, estimate
from treadline.identification._limits import HALF, LAGS_MOST, RECENT, ROUNDING, ROWS_PER_PARAMETER, TOLERANCE
from treadline.identification._refine import Linearised, descended

NOISE_LAGS = 6
"""Lags of the noise's autoregression: slip and measurement noise need two, the noise of a differenced heading more."""
DECAYS = (0.3, 0.8)
"""Decays of a lag per sample from which the fit starts: time constants of about one sample and of about five."""
DECAY_MOST = 0.999
"""Largest decay: a time constant of a thousand samples."""
SETTLED = 0.01
"""Share of a step that a lag leaves when its yaw gain is read."""
SAME_DECAY = 1e-3
"""Difference of decays below which two lags share a state: closer poles have eigenvectors without digits left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SkidSteer:
    """How a skid-steer vehicle turns with its belts."""

    yaw_gain_rad_m: Estimate
    """Steady yaw rate per difference of the belt speeds."""
    gauge_m: Estimate
    """Effective gauge: difference of the belt speeds per yaw rate."""
    speed_scale: dict[str, Estimate]
    """Effect of each belt on the yaw rate relative to the mean of both; empty where only the difference varies."""
    lag_s: dict[str, Estimate]
    """Time constant of each belt; empty for a regression without lags."""
    dead_time_samples: int
    """Whole samples after which a belt begins to act: 0 if it shows in the next row."""
    acts_at_once: bool
    """Whether a belt acts within its row, as in a record whose outputs are the mean of a period."""

    def in_words(self) -> list[tuple[str, str]]:
        """Return rows of names and values."""
        turns = np.isfinite(self.gauge_m.value)
        pairs = [("effective gauge", f"{_text(self.gauge_m)} m" if turns else "unknown: the belts do not turn the vehicle")]
        pairs += [(f"speed scale of {name}", _text(value)) for name, value in self.speed_scale.items()]
        pairs += [(f"lag of {name}", f"{_text(value)} s") for name, value in self.lag_s.items()]
        return pairs


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} (95 %: {estimate.low:.3g} to {estimate.high:.3g})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnFit:
    """Parameters of the fit with their covariance: gains, decays, constant, autoregression."""

    theta: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    shift: int
    """Rows between an input and the first yaw rate that it moves."""
    mixing: Float[np.ndarray, "q m"]
    """Inputs of the fit from those of the record: all of them, or the difference of the belts."""
    belts: DifferentialInput | None
    """Belts among the inputs; None if other inputs steer."""
    dt_s: float
    share: float
    """Share of the yaw rate's variance that the inputs explain."""
    lagged_gain: float | None = None
    """Yaw gain of the fit of lags, where the plain regression gives more and stands in its place."""

    @property
    def gains(self) -> Float[np.ndarray, " m"]:
        """Steady yaw rate per unit of each input of the record."""
        return self._gains(self.theta)

    @property
    def decays(self) -> Float[np.ndarray, " m"]:
        """Decay of each input's lag per sample."""
        q, m = self.mixing.shape
        return self.theta[q : 2 * q] if q == m else np.resize(self.theta[q : 2 * q], m)

    @property
    def constant(self) -> float:
        """Yaw rate at inputs of zero [rad/s]."""
        return float(self.theta[2 * len(self.mixing)])

    def _gains(self, theta: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
        return np.asarray(theta[: len(self.mixing)] @ self.mixing)

    @property
    def steps(self) -> Float[np.ndarray, "s m"]:
        """Changes of the inputs of which the yaw gain is compared: of the belts' difference, or of each input."""
        return np.eye(self.mixing.shape[1]) if self.belts is None else 0.5 * self.belts.signs

    def yaw_gain(self, step: Float[np.ndarray, " m"]) -> Estimate:
        """Return the steady yaw rate after a step of the inputs."""
        return estimate(lambda theta: float(step @ self._gains(theta)), self.theta, self.covariance)

    def described(self) -> SkidSteer | None:
        """Return the fit in words; None if other inputs than belts steer."""
        if self.belts is None:
            return None
        gain, names, signs = self.yaw_gain(self.steps[0]), self.belts.names, self.belts.signs[0]
        # Where the interval of the gain contains zero, no gauge is too large; swapped belts turn the other way by the same gauge.
        ends = (gain.high, gain.low) if gain.value > 0.0 else (-gain.low, -gain.high)
        gauge = [1.0 / number if number > 0.0 else np.inf for number in (abs(gain.value), *ends)]
        scales = {}
        for j, name in enumerate(names if len(self.mixing) > 1 else ()):
            share = partial(self._share, np.eye(2)[j] * signs, 0.5 * signs)
            scales[name] = estimate(share, self.theta, self.covariance)
        return SkidSteer(
            yaw_gain_rad_m=gain,
            gauge_m=Estimate(value=gauge[0], low=gauge[1], high=gauge[2]),
            speed_scale=scales,
            lag_s={name: self._lag(j) for j, name in enumerate(names) if not self.is_plain},
            dead_time_samples=max(0, self.shift - 1),
            acts_at_once=self.shift == 0,
        )

    def _share(self, step: Float[np.ndarray, " m"], whole: Float[np.ndarray, " m"], theta: Float[np.ndarray, " k"]) -> float:
        return float(step @ self._gains(theta)) / float(whole @ self._gains(theta))

    @property
    def is_plain(self) -> bool:
        """Whether the fit is the plain regression, without lags."""
        q = len(self.mixing)
        return not np.diag(self.covariance)[q : 2 * q].any()

    def _lag(self, belt: int) -> Estimate:
        q = len(self.mixing)
        decay = estimate(lambda theta: float(theta[q + min(belt, q - 1)]), self.theta, self.covariance)
        value, low, high = (self._time_constant(number) for number in (decay.value, decay.low, decay.high))
        return Estimate(value=value, low=low, high=high)

    def _time_constant(self, decay: float) -> float:
        if decay <= 0.0:
            return 0.0
        return np.inf if decay >= 1.0 else -self.dt_s / float(np.log(decay))


def turn_fit(records: Sequence[InputOutputRecord], *, is_difference: bool = False, is_table: bool = False) -> TurnFit | None:
    """Return the fit to records of two named belts, or other inputs and turns alone; None for others, or too few rows.

    Args:
        records: Experiments with a named yaw rate or heading.
        is_difference: Whether only the difference of the belts varies.
        is_table: Whether each row stands alone; the fit is then the regression of the yaw rate on the inputs.
    """
    belts, turn = named_belts(records[0].input_names), turn_channels(records[0].output_names)
    if turn.count == 0 or (belts is None and turn.count < len(records[0].output_names)):
        return None
    m = records[0].u.shape[1]
    mixing = belts.signs if belts is not None and is_difference else np.eye(m)
    least = NOISE_LAGS + LAGS_MOST + ROWS_PER_PARAMETER * (2 * len(mixing) + 1 + NOISE_LAGS)
    runs = [replace(run, u=run.u @ mixing.T) for run in _runs(records) if len(run) >= least]
    if not runs:
        return None
    # Belts steer by their difference; of other inputs each may be the one that steers.
    steering = np.eye(m) if belts is None else belts.signs @ np.linalg.pinv(mixing)

    def made(theta: Float[np.ndarray, " k"], covariance: Float[np.ndarray, "k k"], shift: int) -> TurnFit:
        share, dt_s = _explained(runs, theta, shift), runs[0].dt_s
        return TurnFit(theta=theta, covariance=covariance, shift=shift, mixing=mixing, belts=belts, dt_s=dt_s, share=share)

    plain = [made(*_regression(runs, shift), shift) for shift in (0, 1)]
    if is_table:
        return plain[0]
    try:
        best = _best(runs, steering)
    except LinAlgError:
        return None
    lagged = made(best.theta, np.linalg.pinv(best.square) * best.cost / (best.rows - len(best.theta)), best.shift)
    return lagged if belts is None else _larger(lagged, plain)


def _larger(lagged: TurnFit, plain: Sequence[TurnFit]) -> TurnFit:
    """Return the plain regression whose yaw gain lies above the interval of the fit of lags, else that fit.

    Noise of the inputs, an unmodelled lag and the slip that a stabilising feedback answers all lower a gain, and none raises it.
    """
    step = lagged.steps[0]
    known, most = lagged.yaw_gain(step), max(plain, key=lambda fit: fit.yaw_gain(step).value)
    return replace(most, lagged_gain=known.value) if 0.0 < known.high < most.yaw_gain(step).value else lagged


def _runs(records: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
    """Return the unbroken runs of the most recent rows, the yaw rate [rad/s] as their output."""
    runs = []
    for record in most_recent(records, RECENT):
        rate = turn_rate(record.y, record.output_names, record.dt_s)
        u = record.u[: len(rate)]
        for start, stop in runs_of(np.isfinite(u).all(axis=1) & np.isfinite(rate)):
            runs.append(InputOutputRecord(u=u[start:stop], y=rate[start:stop, None], dt_s=record.dt_s))
    return runs


def _best(runs: list[InputOutputRecord], steering: Float[np.ndarray, "s q"]) -> "_Descent":
    """Return the best descent of each steering input: from its dead time, or a row more, and a short and a long lag."""
    descents = []
    for signs in steering:
        late = dead_time([replace(run, u=run.u @ signs[:, None]) for run in runs])[0]
        for shift in range(min(late, LAGS_MOST), min(late, LAGS_MOST) + 2):
            descents += [_descended(runs, _start(runs, signs, decay, shift), shift) for decay in DECAYS]
    return min(descents, key=lambda descent: descent.cost)


def _start(runs: list[InputOutputRecord], signs: Float[np.ndarray, " q"], decay: float, shift: int) -> Float[np.ndarray, " k"]:
    """Return gain and constant by least squares for a lag and a dead time, and the autoregression of what they leave."""
    x = np.concatenate([_lagged(run.u @ signs, decay, shift) for run in runs])
    rate = np.concatenate([run.y[:, 0] for run in runs])
    X = np.column_stack([x, np.ones(len(x))])
    gain, constant = np.linalg.lstsq(X, rate, rcond=None)[0]
    windows = sliding_window_view(rate - X @ [gain, constant], NOISE_LAGS + 1)
    noise = np.linalg.lstsq(windows[:, -2::-1], windows[:, -1], rcond=None)[0]
    return np.concatenate([gain * signs, np.full(len(signs), decay), [constant], noise])


def _lagged(x: Float[np.ndarray, " T"], decay: float, shift: int) -> Float[np.ndarray, " T"]:
    """Return a signal behind a shift and a first-order lag, from its own rest."""
    late = np.concatenate([np.full(shift, x[0]), x])[: len(x)]
    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], late, zi=[decay * late[0]])[0])


# Descent ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Descent:
    theta: Float[np.ndarray, " k"]
    shift: int
    cost: float
    rows: int
    square: Float[np.ndarray, "k k"]
    right: Float[np.ndarray, " k"]
    """J'J and J'e of the residuals' derivatives."""


def _descended(runs: list[InputOutputRecord], theta: Float[np.ndarray, " k"], shift: int) -> _Descent:
    """Return the parameters with the least squared prediction error."""
    m = runs[0].u.shape[1]

    def linearised(at: _Descent) -> Linearised[_Descent]:
        def moved(step: Float[np.ndarray, " k"]) -> _Descent:
            new = at.theta + step
            new[m : 2 * m] = np.clip(new[m : 2 * m], 0.0, DECAY_MOST)
            return _normal(runs, new, shift)

        return at.square, at.right, at.square.diagonal(), moved

    return descended(_normal(runs, theta, shift), lambda at: at.cost, linearised, enough=ROUNDING**0.5)


def _explained(runs: list[InputOutputRecord], theta: Float[np.ndarray, " k"], shift: int) -> float:
    """Return the share of the yaw rate's variance that the inputs explain."""
    m = runs[0].u.shape[1]
    left = [
        run.y[:, 0] - np.column_stack([_lagged(run.u[:, j], theta[m + j], shift) for j in range(m)]) @ theta[:m] for run in runs
    ]
    total = float(np.var(np.concatenate([run.y[:, 0] for run in runs])))
    return 1.0 - float(np.var(np.concatenate(left))) / total if total > 0.0 else 0.0


def _regression(runs: list[InputOutputRecord], shift: int) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Return parameters and covariance of the yaw rate's regression on the inputs of the same row or the row before."""
    m = runs[0].u.shape[1]
    X = [np.column_stack([run.u[: len(run.u) - shift], np.ones(len(run.u) - shift)]) for run in runs]
    rates = [run.y[shift:, 0] for run in runs]
    beta = np.linalg.lstsq(np.vstack(X), np.concatenate(rates), rcond=None)[0]
    pairs = [(x, rate - x @ beta) for x, rate in zip(X, rates, strict=True)]
    linear = np.array([*range(m), 2 * m])
    theta, covariance = np.zeros(2 * m + 1 + NOISE_LAGS), np.zeros((2 * m + 1 + NOISE_LAGS,) * 2)
    theta[linear], covariance[np.ix_(linear, linear)] = beta, covariance_of(pairs, 1, sum(map(len, rates)))
    return theta, covariance


def _normal(runs: list[InputOutputRecord], theta: Float[np.ndarray, " k"], shift: int) -> _Descent:
    """Return squared prediction error, rows, J'J and J'e at some parameters."""
    m = runs[0].u.shape[1]
    gains, decays, constant, noise = theta[:m], theta[m : 2 * m], theta[2 * m], theta[2 * m + 1 :]
    whitening, first = np.concatenate([[1.0], -noise]), NOISE_LAGS + shift
    cost, rows = 0.0, 0
    square, right = np.zeros((len(theta), len(theta))), np.zeros(len(theta))
    for run in runs:
        x = np.column_stack([_lagged(run.u[:, j], decays[j], shift) for j in range(m)])
        # x⁺ = a x + (1 - a) u: dx⁺/da = a dx/da + x - u.
        late = np.vstack([np.tile(run.u[:1], (shift, 1)), run.u])[: len(run.u)]
        before = np.vstack([late[:1], x[:-1]])
        moving = np.column_stack([lfilter([1.0], [1.0, -decays[j]], before[:, j] - late[:, j]) for j in range(m)])
        left = run.y[:, 0] - x @ gains - constant
        columns = np.column_stack([left, -x, -moving * gains])
        white = lfilter(whitening, [1.0], columns, axis=0)[first:]
        past = np.column_stack([left[first - i : len(left) - i] for i in range(1, NOISE_LAGS + 1)])
        J = np.column_stack([white[:, 1:], np.full(len(white), -whitening.sum()), -past])
        cost += float(white[:, 0] @ white[:, 0])
        square, right, rows = square + J.T @ J, right - J.T @ white[:, 0], rows + len(white)
    return _Descent(theta=theta, shift=shift, cost=cost, rows=rows, square=square, right=right)


# Model of the fit -----------------------------------------------------------------------------------------------------------


def turn_model(fit: TurnFit, record: InputOutputRecord) -> LinearModel:
    """Return the model of the fit: a state per belt, the yaw rate that it causes, or one if both lags are alike; then the heading.

    With x⁺ = a x + (1 - a) u, the mean of a belt's speed over a period is α x + (1 - α) u, α = (a - 1) / ln a.
    """
    turn, names = turn_channels(record.output_names), record.output_names
    a, effects = fit.decays, np.diag(fit.gains)
    if np.ptp(a) < SAME_DECAY:
        a, effects = a.mean(keepdims=True), fit.gains[None]
    n, m, at_once = len(a), len(fit.gains), fit.shift == 0
    alpha = np.array([(decay - 1.0) / np.log(decay) if decay > 0.0 else 0.0 for decay in a])
    # A belt that acts within its row is ahead of its state by one step.
    rate, direct = (a, (1.0 - a) @ effects) if at_once else (np.ones(n), np.zeros(m))
    # Without a yaw rate the heading's change was fitted, which is the mean over the period already.
    turned, at_end = (rate, direct) if at_once or turn.yaw_rate is None else (alpha, (1.0 - alpha) @ effects)
    A, B = np.diag(np.append(a, 1.0)), np.vstack([(1.0 - a)[:, None] * effects, fit.dt_s * at_end])
    A[n, :n] = fit.dt_s * turned
    C, D = np.zeros((len(names), n + 1)), np.zeros((len(names), m))
    if turn.heading is not None:
        C[turn.heading, n] = 1.0 / radians(names[turn.heading])
    if turn.yaw_rate is not None:
        C[turn.yaw_rate, :n], D[turn.yaw_rate] = (part / radians(names[turn.yaw_rate]) for part in (rate, direct))
    states = n + (turn.heading is not None)
    mean = np.nanmean(record.u, axis=0)
    model = LinearModel(
        A=A[:states, :states],
        B=B[:states],
        C=C[:, :states],
        D=D,
        dt_s=fit.dt_s,
        # The constant yaw rate becomes inputs at which the vehicle goes straight.
        input_offset=mean - fit.gains * (fit.gains @ mean + fit.constant) / (fit.gains @ fit.gains),
        output_offset=np.zeros(len(names)),
        input_delay=(max(0, fit.shift - 1),) * m,
        input_names=record.input_names,
        output_names=names,
    )
    return model if turn.heading is None else _without_drift(model, fit, record, turn.heading)


def _without_drift(model: LinearModel, fit: TurnFit, record: InputOutputRecord, heading: int) -> LinearModel:
    """Return the model with the constant yaw rate that the measured heading shows, free of the gyro's offset."""
    whole = np.isfinite(record.u).all(axis=1)
    u = np.where(whole[:, None], record.u, model.input_offset)
    off = (record.y - simulate(model, u, np.zeros(model.order)))[:, heading] * radians(model.output_names[heading])
    t_s, there = record.dt_s * np.arange(len(record)), np.isfinite(off)
    drift_rad_s = np.polyfit(t_s[there], off[there], 1)[0]
    return replace(model, input_offset=model.input_offset - fit.gains * drift_rad_s / (fit.gains @ fit.gains))


@dataclass(frozen=True, slots=True, kw_only=True)
class Contradiction:
    """Yaw gain of a model outside the interval of the fit."""

    gain: float
    known: Estimate
    step: str
    """The step of the inputs in words."""

    @property
    def is_large(self) -> bool:
        """Whether the gain is off by more than the tolerance."""
        return abs(self.gain - self.known.value) > TOLERANCE * abs(self.known.value)

    def __str__(self) -> str:
        return (
            f"a free model turns by {self.gain:.3g} rad/s per unit of {self.step}, the fit of gain and lag by "
            f"{self.known.value:.3g} (95 %: {self.known.low:.3g} to {self.known.high:.3g})"
        )


def contradiction(model: LinearModel, fit: TurnFit, rows: int) -> Contradiction | None:
    """Return the worst yaw gain outside its interval, once the lags have settled or after some rows; None if all are inside."""
    names = ["the belts' difference"] if fit.belts is not None else [f"'{name}'" for name in model.input_names]
    found = []
    for name, step in zip(names, fit.steps, strict=True):
        known = fit.yaw_gain(step)
        gains = [gain if np.isfinite(gain) else np.inf for gain in _yaw_gains(model, fit, step, rows)]
        gains = [gain for gain in gains if not known.low <= gain <= known.high]
        found += [Contradiction(gain=gain, known=known, step=name) for gain in gains]
    return max(found, key=lambda item: abs(item.gain - item.known.value), default=None)


def _yaw_gains(model: LinearModel, fit: TurnFit, step: Float[np.ndarray, " m"], rows: int) -> tuple[float, float]:
    slowest = max(float(fit.decays.max()), SETTLED)
    settled = fit.shift + int(np.ceil(np.log(SETTLED) / np.log(slowest)))
    u = np.tile(model.input_offset + step, (max(rows, settled + 2), 1))
    y = simulate(model, u, np.zeros(model.order)) - model.output_offset
    rate = turn_rate(y, model.output_names, model.dt_s)
    return float(rate[settled]), float(rate[-1])


def fits_as_well(structured: LinearModel, model: LinearModel, records: Sequence[InputOutputRecord], *, is_large: bool) -> bool:
    """Return whether the free run of the structure is not worse than a model's by more than the BIC grants its parameters.

    Args:
        structured: Model of the structure.
        model: Free model.
        records: Experiments.
        is_large: Whether the gains are far apart; the variance of the error may then be larger by the tolerance.
    """
    turn = turn_channels(model.output_names)
    output = (turn.heading or 0) if turn.yaw_rate is None else turn.yaw_rate
    errors = []
    with np.errstate(over="ignore", invalid="ignore"):
        for one in (structured, model):
            fits = [fit_percent(one, record)[output] for record in records]
            errors.append(float(np.mean([(1.0 - 0.01 * value) ** 2 for value in fits])))
    if not np.isfinite(errors[1]):
        return True
    n, m, p = model.order, model.B.shape[1], len(model.C)
    rows = sum(len(record) for record in records)
    further = n * (m + p) + m * p - 2 * m - 1
    granted = max(further, 0) * np.log(rows) / rows
    return bool(np.log(errors[0] / errors[1]) <= (max(granted, np.log1p(TOLERANCE)) if is_large else granted))


def input_noise_warning(fit: TurnFit) -> list[str]:
    """Return a warning if the inputs explain little of the yaw rate, or the plain regression turns more than the fit of lags."""
    if fit.share < HALF:
        share = 100.0 * max(fit.share, 0.0)
        cause = f"the inputs explain {share:.0f} % of the yaw rate; slip, noise of the measured inputs or feedback hides the gain"
        return [f"{cause}; drive wider curves, where the belts turn the vehicle"]
    if fit.lagged_gain is None:
        return []
    gain = fit.yaw_gain(fit.steps[0]).value
    return [
        f"noise of the measured inputs, or feedback: the fit of lags gives a yaw gain of {fit.lagged_gain:.3g}, the regression "
        f"{gain:.3g}, taken because both causes lower it; log commands, add dither"
    ]
