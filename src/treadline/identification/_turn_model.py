"""Turn model by names in place of a free model whose yaw gain it contradicts.

In closed loop a free model may be the controller's inverse, and from few or noisy data its steady gain is a guess. The structure (a
lag of each belt, the heading as integral of the yaw rate) has five parameters and an interval of the yaw gain. A free model within
that interval stays. One outside is replaced if belts follow the outputs, or if its free run is not better by more than its further
parameters are worth (BIC).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.core.linear_systems import fit_percent, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.turning import radians, turn_channels
from treadline.identification._belts import turn_rate
from treadline.identification._intervals import Estimate
from treadline.identification._limits import HALF, TOLERANCE
from treadline.identification._skid_steer import TurnFit

SETTLED = 0.01
"""Share of a step that a lag leaves when its yaw gain is read."""
SAME_DECAY = 1e-3
"""Difference of decays below which two lags share a state: closer poles have eigenvectors without digits left."""


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
