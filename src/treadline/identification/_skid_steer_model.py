"""Model of the skid-steer structure in place of a free one whose yaw gain it contradicts.

In closed loop a free model may be the controller's inverse, and from few or noisy data its steady gain is a guess. The structure (a
lag of each belt, the heading as integral of the yaw rate) has five parameters and an interval of the yaw gain. A free model within
that interval stays; one outside is replaced if the belts follow the outputs, or if its free run is not better by more than its
further parameters are worth (BIC).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from treadline.core.linear_systems import fit_percent, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._belts import radians, turn_channels
from treadline.identification._skid_steer import SkidSteerFit

SETTLED = 0.01
"""Share of a step that a lag leaves when its yaw gain is read."""
SAME_DECAY = 1e-3
"""Difference of decays below which two lags are one: a hundredth of what the shortest records resolve."""
GAIN_TOLERANCE = 0.3
"""Relative error of a yaw gain that needs a warning."""


def skid_steer_model(fit: SkidSteerFit, record: InputOutputRecord) -> LinearModel:
    """Return the model of the fit: a state per belt, the yaw rate that it causes, or one if both lags are alike; then the heading.

    With x⁺ = a x + (1 - a) u, the mean of a belt's speed over a period is α x + (1 - α) u, α = (a - 1) / ln a.
    """
    turn, names = turn_channels(record.output_names), record.output_names
    a, effects = fit.decays, np.diag(fit.gains)
    if abs(a[1] - a[0]) < SAME_DECAY:
        a, effects = a.mean(keepdims=True), fit.gains[None]
    n, at_once = len(a), fit.shift == 0
    alpha = np.array([(decay - 1.0) / np.log(decay) if decay > 0.0 else 0.0 for decay in a])
    # A belt that acts within its row is ahead of its state by one step.
    rate, direct = (a, (1.0 - a) @ effects) if at_once else (np.ones(n), np.zeros(2))
    turned, at_end = (rate, direct) if at_once else (alpha, (1.0 - alpha) @ effects)
    A, B = np.diag(np.append(a, 1.0)), np.vstack([(1.0 - a)[:, None] * effects, fit.dt_s * at_end])
    A[n, :n] = fit.dt_s * turned
    C, D = np.zeros((len(names), n + 1)), np.zeros((len(names), 2))
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
        # The constant yaw rate becomes a difference of the belts at which the vehicle goes straight.
        input_offset=mean - 0.5 * fit.belts.signs[0] * (fit.gains @ mean + fit.constant) / fit.yaw_gain.value,
        output_offset=np.zeros(len(names)),
        input_delay=(max(0, fit.shift - 1),) * 2,
        input_names=record.input_names,
        output_names=names,
    )
    return model if turn.heading is None else _without_drift(model, fit, record, turn.heading)


def _without_drift(model: LinearModel, fit: SkidSteerFit, record: InputOutputRecord, heading: int) -> LinearModel:
    """Return the model with the constant yaw rate that the measured heading shows, free of the gyro's offset."""
    whole = np.isfinite(record.u).all(axis=1)
    u = np.where(whole[:, None], record.u, model.input_offset)
    off = (record.y - simulate(model, u, np.zeros(model.order)))[:, heading] * radians(model.output_names[heading])
    t_s, there = record.dt_s * np.arange(len(record)), np.isfinite(off)
    drift_rad_s = np.polyfit(t_s[there], off[there], 1)[0]
    return replace(model, input_offset=model.input_offset - 0.5 * fit.belts.signs[0] * drift_rad_s / fit.yaw_gain.value)


def model_yaw_gains(model: LinearModel, fit: SkidSteerFit, rows: int) -> tuple[float, float]:
    """Return a model's yaw rate per difference of the belts once the lags of the fit have settled, and after some rows [rad/m]."""
    turn = turn_channels(model.output_names)
    slowest = max(float(fit.decays.max()), SETTLED)
    settled = fit.shift + int(np.ceil(np.log(SETTLED) / np.log(slowest)))
    steps = max(rows, settled + 2)
    y = simulate(model, np.tile(model.input_offset + 0.5 * fit.belts.signs[0], (steps, 1)), np.zeros(model.order))
    if turn.yaw_rate is not None:
        rate = y[:, turn.yaw_rate] * radians(model.output_names[turn.yaw_rate])
        rate -= model.output_offset[turn.yaw_rate] * radians(model.output_names[turn.yaw_rate])
    else:
        heading = turn.heading or 0
        rate = np.diff(y[:, heading]) * radians(model.output_names[heading]) / model.dt_s
    return float(rate[settled]), float(rate[-1])


def contradicting_gain(model: LinearModel, fit: SkidSteerFit, rows: int) -> float | None:
    """Return a model's yaw gain outside the interval of the fit; None if both its gains are inside."""
    gains = model_yaw_gains(model, fit, rows)
    outside = [gain for gain in gains if not fit.yaw_gain.low <= gain <= fit.yaw_gain.high]
    return max(outside, key=lambda gain: abs(gain - fit.yaw_gain.value), default=None)


def fits_as_well(structured: LinearModel, model: LinearModel, records: Sequence[InputOutputRecord]) -> bool:
    """Return whether the free run of the structure is not worse than a model's by more than the BIC grants its parameters."""
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
    return rows * np.log(errors[0] / errors[1]) <= max(further, 0) * np.log(rows)


def sign_warning(fit: SkidSteerFit) -> list[str]:
    """Return a warning if a faster right belt turns the vehicle to the right."""
    if fit.yaw_gain.high >= 0.0:
        return []
    left = fit.belts.names[int(np.argmin(fit.belts.signs))]
    return [f"yaw gain below zero: a faster '{left}' turns to the left; are the belts swapped, or angles counted clockwise?"]


def gain_warning(gain: float, fit: SkidSteerFit) -> list[str]:
    """Return a warning if a contradicting yaw gain is off by more than the tolerance."""
    if abs(gain / fit.yaw_gain.value - 1.0) <= GAIN_TOLERANCE:
        return []
    return [f"yaw gain: {_compared(gain, fit)}: feedback, noise of the inputs or too high an order; --method best may take the fit"]


def replacement_warning(gain: float, fit: SkidSteerFit, *, has_feedback: bool) -> str:
    """Return why the skid-steer model stands in the place of a free model with a contradicting yaw gain."""
    why = "feedback may have made it the controller's inverse" if has_feedback else "explains no more"
    return f"skid-steer structure taken by names: {_compared(gain, fit)}; the free model {why}; --no-name-prior keeps it"


def _compared(gain: float, fit: SkidSteerFit) -> str:
    known = fit.yaw_gain
    return (
        f"a free model turns by {gain:.3g} rad/s per m/s of belt difference, the fit of gauge and lags by {known.value:.3g} "
        f"(95 %: {known.low:.3g} to {known.high:.3g})"
    )
