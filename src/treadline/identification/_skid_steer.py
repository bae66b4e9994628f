"""Skid-steer vehicle in words: effective gauge, speed scale and lag of each belt, with intervals.

The yaw rate is r = g_right x_right - g_left x_left + c + n, each x a belt speed behind a dead time and a first-order lag, and n an
autoregression. All of it is fitted by the prediction error, which in closed loop needs no dither beyond what the structure leaves
open (Ljung, System Identification, 1999, section 13.4). The yaw rate alone shows no common scale of belts and gauge: the scales are
relative to their mean, and the gauge is the effective one, larger than the belts' distance by what slip costs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.linalg import LinAlgError, solve_toeplitz
from scipy.signal import lfilter

from treadline.core.models import InputOutputRecord
from treadline.identification._belts import DifferentialInput, named_belts, radians, turn_channels
from treadline.identification.options import LAGS_MOST

ROWS_MOST = 20_000
"""Number of most recent rows that are fitted."""
NOISE_LAGS = 6
"""Lags of the noise's autoregression: slip and measurement noise need two, the noise of a differenced heading more."""
ROWS_PER_PARAMETER = 8
"""Rows per parameter, as for automatically chosen lags."""
DECAYS = (0.0, 0.3, 0.5, 0.65, 0.75, 0.85, 0.9, 0.95, 0.975)
"""Decays of a lag per sample from which the fit may start: time constants in steps of about one and a half."""
DECAY_MOST = 0.999
"""Largest decay: a time constant of a thousand samples."""
STEPS_MOST = 20
"""Largest number of Gauss-Newton steps."""
TWO_SIDED_95 = 1.959964
"""Quantile of the normal distribution for a two-sided probability of 95 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Value with the bounds of its interval of 95 %."""

    value: float
    low: float
    high: float


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
    """Time constant of each belt."""
    dead_time_samples: int
    """Whole samples after which a belt begins to act: 0 if it shows in the next row."""
    acts_at_once: bool
    """Whether a belt acts within its row, as in a record whose outputs are the mean of a period."""

    def in_words(self) -> list[tuple[str, str]]:
        """Return rows of names and values."""
        pairs = [("effective gauge", f"{_text(self.gauge_m)} m")]
        pairs += [(f"speed scale of {name}", _text(value)) for name, value in self.speed_scale.items()]
        pairs += [(f"lag of {name}", f"{_text(value)} s") for name, value in self.lag_s.items()]
        return pairs


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} (95 %: {estimate.low:.3g} to {estimate.high:.3g})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkidSteerFit:
    """Parameters of the fit with their covariance: gains [1/m], decays, constant, autoregression."""

    theta: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    shift: int
    """Rows between a belt speed and the first yaw rate that it moves."""
    belts: DifferentialInput
    is_difference: bool
    """Whether the difference of the belts is the only input."""
    dt_s: float

    @property
    def gains(self) -> Float[np.ndarray, " 2"]:
        """Yaw rate per speed of each belt, in the order of the record [rad/m]."""
        return self._belt_gains(self.theta)

    @property
    def decays(self) -> Float[np.ndarray, " 2"]:
        """Decay of each belt's lag per sample."""
        m = self.inputs
        return np.resize(self.theta[m : 2 * m], 2)

    @property
    def constant(self) -> float:
        """Yaw rate at belts of speed zero [rad/s]."""
        return float(self.theta[2 * self.inputs])

    @property
    def inputs(self) -> int:
        """Number of inputs of the fit: the belts or their difference."""
        return 1 if self.is_difference else 2

    def _belt_gains(self, theta: Float[np.ndarray, " k"]) -> Float[np.ndarray, " 2"]:
        return theta[0] * self.belts.signs[0] if self.is_difference else theta[:2]

    @property
    def yaw_gain(self) -> Estimate:
        """Steady yaw rate per difference of the belt speeds [rad/m]."""
        return self._estimate(self._yaw_gain)

    def _yaw_gain(self, theta: Float[np.ndarray, " k"]) -> float:
        return 0.5 * float(self.belts.signs[0] @ self._belt_gains(theta))

    def _speed_scale(self, belt: int, theta: Float[np.ndarray, " k"]) -> float:
        return float(self.belts.signs[0, belt] * self._belt_gains(theta)[belt]) / self._yaw_gain(theta)

    def _estimate(self, value: Callable[[Float[np.ndarray, " k"]], float]) -> Estimate:
        """Return a function of the parameters with its interval, to first order."""
        at, steps = value(self.theta), 1e-6 * np.maximum(np.abs(self.theta), 1e-6)
        slope = np.array([(value(self.theta + step) - at) / step.sum() for step in np.diag(steps)])
        reach = TWO_SIDED_95 * float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))
        return Estimate(value=at, low=at - reach, high=at + reach)

    def described(self) -> SkidSteer:
        """Return the fit in words."""
        gain, names = self.yaw_gain, self.belts.names
        scales = {} if self.is_difference else {name: self._estimate(partial(self._speed_scale, j)) for j, name in enumerate(names)}
        # Where the interval of the gain contains zero, no gauge is too large.
        gauge = [1.0 / number if number > 0.0 else np.inf for number in (gain.value, gain.high, gain.low)]
        return SkidSteer(
            yaw_gain_rad_m=gain,
            gauge_m=Estimate(value=gauge[0], low=gauge[1], high=gauge[2]),
            speed_scale=scales,
            lag_s={name: self._lag(j) for j, name in enumerate(names)},
            dead_time_samples=max(0, self.shift - 1),
            acts_at_once=self.shift == 0,
        )

    def _lag(self, belt: int) -> Estimate:
        at = self.inputs + min(belt, self.inputs - 1)
        decay, reach = float(self.theta[at]), TWO_SIDED_95 * float(np.sqrt(max(self.covariance[at, at], 0.0)))
        value, low, high = (self._time_constant(number) for number in (decay, decay - reach, decay + reach))
        return Estimate(value=value, low=low, high=high)

    def _time_constant(self, decay: float) -> float:
        if decay <= 0.0:
            return 0.0
        return np.inf if decay >= 1.0 else -self.dt_s / float(np.log(decay))


def is_skid_steer(record: InputOutputRecord) -> bool:
    """Return whether the names tell two belts, and a yaw rate or a heading."""
    turn = turn_channels(record.output_names)
    return named_belts(record.input_names) is not None and (turn.yaw_rate is not None or turn.heading is not None)


def skid_steer(records: Sequence[InputOutputRecord], *, is_difference: bool = False, is_table: bool = False) -> SkidSteerFit | None:
    """Return the fit to records with two named belts and a named yaw rate or heading; None for others, or too few rows.

    Args:
        records: Experiments.
        is_difference: Whether only the difference of the belts varies.
        is_table: Whether each row stands alone; the fit is then the regression of the yaw rate on the belts.
    """
    belts = named_belts(records[0].input_names)
    if belts is None or not is_skid_steer(records[0]):
        return None
    runs = _runs(records)
    m = 1 if is_difference else 2
    parameters = 2 * m + 1 + NOISE_LAGS
    least = NOISE_LAGS + LAGS_MOST + ROWS_PER_PARAMETER * parameters
    runs = [run for run in runs if len(run.rate) >= least]
    if not runs:
        return None
    try:
        return _fitted(runs, belts, is_difference=is_difference, is_table=is_table)
    except LinAlgError:
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """Unbroken rows of belt speeds and yaw rate."""

    u: Float[np.ndarray, "T m"]
    rate: Float[np.ndarray, " T"]
    dt_s: float


def _runs(records: Sequence[InputOutputRecord]) -> list[_Run]:
    """Return the unbroken runs; without a yaw rate the heading's difference to the next row takes its place."""
    turn, names = turn_channels(records[0].output_names), records[0].output_names
    heading = turn.heading or 0
    runs, left = [], ROWS_MOST
    for record in reversed(records):
        if turn.yaw_rate is not None:
            u, rate = record.u, record.y[:, turn.yaw_rate] * radians(names[turn.yaw_rate])
        else:
            u, rate = record.u[:-1], np.diff(record.y[:, heading]) * radians(names[heading]) / record.dt_s
        whole = np.isfinite(u).all(axis=1) & np.isfinite(rate)
        edges = np.flatnonzero(np.diff(whole.astype(int), prepend=0, append=0)).reshape(-1, 2)
        for start, stop in edges[::-1]:
            first = max(int(start), int(stop) - left)
            left -= int(stop) - first
            runs.append(_Run(u=u[first:stop], rate=rate[first:stop], dt_s=record.dt_s))
    return runs


def _fitted(runs: list[_Run], belts: DifferentialInput, *, is_difference: bool, is_table: bool) -> SkidSteerFit:
    difference = [replace(run, u=run.u @ belts.signs.T) for run in runs]
    used = difference if is_difference else runs
    best = _regression(used) if is_table else None
    for shift, decay, gain, noise in [] if is_table else _starts(difference):
        gains = np.array([gain]) if is_difference else gain * belts.signs[0]
        constant = float(np.mean([np.mean(run.rate) - np.mean(run.u, axis=0) @ gains for run in used]))
        theta = np.concatenate([gains, np.full(len(gains), decay), [constant], noise])
        for moved in (shift, shift + 1, shift - 1):
            if 0 <= moved <= LAGS_MOST:
                found = _descended(used, theta, moved)
                if best is None or found.cost < best.cost:
                    best = found
    if best is None:
        raise LinAlgError("no start")
    variance = best.cost / (best.rows - len(best.theta))
    return SkidSteerFit(
        theta=best.theta,
        covariance=np.linalg.pinv(best.square) * variance,
        shift=best.shift,
        belts=belts,
        is_difference=is_difference,
        dt_s=runs[0].dt_s,
    )


# Start: dead time, lag and noise by correlations -------------------------------------------------------------------------


def _starts(runs: list[_Run]) -> list[tuple[int, float, float, Float[np.ndarray, " q"]]]:
    """Return shift, decay, gain and autoregression of the difference, from white noise and from the rate as noise alone."""
    reach = LAGS_MOST + NOISE_LAGS + 1
    rate = np.sum([_correlation(_centred(run.rate), _centred(run.rate), reach) for run in runs], axis=0)
    filtered = []
    for decay in DECAYS:
        lagged = [_centred(_lagged(run.u[:, 0], decay, 0)) for run in runs]
        own = np.sum([_correlation(x, x, reach) for x in lagged], axis=0)
        cross = np.sum([_correlation(x, _centred(run.rate), reach) for x, run in zip(lagged, runs, strict=True)], axis=0)
        filtered.append((decay, own, cross))
    return [
        _alternated(rate, filtered, reach, noise)
        for noise in (np.zeros(NOISE_LAGS), _autoregression(rate[reach : reach + NOISE_LAGS + 1]))
    ]


def _alternated(
    rate: Float[np.ndarray, " l"],
    filtered: list[tuple[float, Float[np.ndarray, " l"], Float[np.ndarray, " l"]]],
    reach: int,
    noise: Float[np.ndarray, " q"],
) -> tuple[int, float, float, Float[np.ndarray, " q"]]:
    """Return the best shift, decay and gain for a noise model, and the noise model of what they leave, in turns."""
    near = np.arange(NOISE_LAGS + 1)
    found = (0, 0.0, 0.0)
    for _ in range(6):
        whitening = np.concatenate([[1.0], -noise])
        weights = np.convolve(whitening, whitening[::-1])
        span = slice(reach - NOISE_LAGS, reach + NOISE_LAGS + 1)
        gains, best = 0.0, -np.inf
        for decay, own, cross in filtered:
            at = np.convolve(cross, weights, mode="valid")[reach - NOISE_LAGS :][: LAGS_MOST + 1]
            explained = at**2 / (weights @ own[span])
            shift = int(np.argmax(explained))
            if explained[shift] > best:
                best, gains = float(explained[shift]), float(at[shift] / (weights @ own[span]))
                found, chosen = (shift, decay, gains), (own, cross)
        own, cross = chosen
        shift, _, gain = found
        left = rate[reach + near] - gain * (cross[reach + shift + near] + cross[reach + shift - near]) + gain**2 * own[reach + near]
        again = _autoregression(left)
        if np.allclose(again, noise, atol=1e-3):
            break
        noise = again
    return *found, noise


def _correlation(x: Float[np.ndarray, " T"], y: Float[np.ndarray, " T"], reach: int) -> Float[np.ndarray, " l"]:
    """Return Σ x[k - lag] y[k] for lags from -reach to reach."""
    count = 1 << (2 * len(x) - 1).bit_length()
    products = np.fft.irfft(np.conj(np.fft.rfft(x, count)) * np.fft.rfft(y, count), count)
    return np.concatenate([products[-reach:], products[: reach + 1]])


def _autoregression(covariance: Float[np.ndarray, " q1"]) -> Float[np.ndarray, " q"]:
    """Return the coefficients of an autoregression by the Yule-Walker equations."""
    first = covariance[:-1].copy()
    first[0] *= 1.0 + 1e-9
    return np.asarray(solve_toeplitz(first, covariance[1:])) if first[0] > 0.0 else np.zeros(len(first))


def _centred(x: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    return x - x.mean()


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
    """J'J of the residuals' derivatives."""


def _descended(runs: list[_Run], theta: Float[np.ndarray, " k"], shift: int) -> _Descent:
    """Return the parameters with the least squared prediction error, by damped Gauss-Newton steps (Levenberg, 1944)."""
    m = runs[0].u.shape[1]
    cost, rows, square, right = _normal(runs, theta, shift)
    damping = 1e-3
    for _ in range(STEPS_MOST):
        scale = np.sqrt(np.diag(square)) + 1e-300
        scaled = square / np.outer(scale, scale)
        step = np.linalg.solve(scaled + damping * np.eye(len(theta)), right / scale) / scale
        moved = theta - step
        moved[m : 2 * m] = np.clip(moved[m : 2 * m], 0.0, DECAY_MOST)
        new = _normal(runs, moved, shift)
        if new[0] < cost:
            is_done = cost - new[0] < 1e-8 * cost
            theta, (cost, rows, square, right), damping = moved, new, max(0.2 * damping, 1e-9)
            if is_done:
                break
        else:
            damping *= 5.0
            if damping > 1e6:
                break
    return _Descent(theta=theta, shift=shift, cost=cost, rows=rows, square=square)


def _regression(runs: list[_Run]) -> _Descent:
    """Return the regression of the yaw rate on the belts of the same row."""
    m = runs[0].u.shape[1]
    theta, linear = np.zeros(2 * m + 1 + NOISE_LAGS), np.array([*range(m), 2 * m])
    _, rows, square, right = _normal(runs, theta, 0)
    square = square[np.ix_(linear, linear)]
    theta[linear] = -np.linalg.solve(square, right[linear])
    whole = np.zeros((len(theta), len(theta)))
    whole[np.ix_(linear, linear)] = square
    return _Descent(theta=theta, shift=0, cost=_normal(runs, theta, 0)[0], rows=rows, square=whole)


def _normal(
    runs: list[_Run], theta: Float[np.ndarray, " k"], shift: int
) -> tuple[float, int, Float[np.ndarray, "k k"], Float[np.ndarray, " k"]]:
    """Return squared prediction error, rows, J'J and J'e."""
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
        left = run.rate - x @ gains - constant
        columns = np.column_stack([left, -x, -moving * gains])
        white = lfilter(whitening, [1.0], columns, axis=0)[first:]
        past = np.column_stack([left[first - i : len(left) - i] for i in range(1, NOISE_LAGS + 1)])
        J = np.column_stack([white[:, 1:], np.full(len(white), -whitening.sum()), -past])
        cost += float(white[:, 0] @ white[:, 0])
        square, right, rows = square + J.T @ J, right + J.T @ white[:, 0], rows + len(white)
    return cost, rows, square, right
