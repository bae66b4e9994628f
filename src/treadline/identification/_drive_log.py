"""The log of a drive before a fit: inputs that do not move, or only move with others, are left out of it, and it is tested.

Of belts that move together the difference is fitted. The tests look for feedback, single frequencies, tables, and headings against
yaw rates: ``DriveLog -> LogFindings``. Each finding is one line with a cause, a number and a remedy.

A vehicle with left-right symmetry turns only with the difference of its belt speeds: mirrored, left and right swap and a turn
changes sign. A one-sided load, a cross slope or a worn belt breaks the symmetry, so the data decide whether the difference alone is
the input. With the symmetry half of the input coefficients need no estimation, and the other half is not disturbed by the common
speed, which dominates normal driving.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import chdtrc

from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import TESTED_LAGS
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.turning import belt_signs, integral_faults, radians, turn_channels
from treadline.identification._checks import channel_names
from treadline.identification._gram import Gram, Units, gram_of, units_of
from treadline.identification._intervals import ConfidenceIntervals
from treadline.identification._limits import HALF, PREDICTABLE, RECENT, ROUNDING, ROWS_PER_PARAMETER, SIGNIFICANCE
from treadline.identification._model_order import min_bic

ROWS_MOST = RECENT // 10
"""Largest number of windows in a test, spread over all records: bounds its time to some milliseconds."""
COLUMNS_MOST = 100
"""Largest number of regressors in a test, likewise."""
SQUARE_WAVE_SHARE = 8.0 / np.pi**2
"""Share of a square wave's variance in its fundamental frequency; an input with a larger share is closer to a sinusoid."""
PERIODS_MIN = 2.0
"""Least number of periods of a sinusoid in a record: a slower one looks like a drift."""
PADDING = 8
"""Length of the transform over the record's: a frequency is met to within a sixteenth of a line, its power to within 2 %."""
DIFFERENCE = "right_less_left"
"""Name of the difference of two belt speeds."""


def turn_rate(y: Float[np.ndarray, "T p"], output_names: Sequence[str], dt_s: float) -> Float[np.ndarray, " T1"]:
    """Return the yaw rate [rad/s]; without one the heading's difference to the next row takes its place, a row less."""
    turn = turn_channels(output_names)
    if turn.yaw_rate is not None:
        return np.asarray(y[:, turn.yaw_rate] * radians(output_names[turn.yaw_rate]))
    heading = turn.heading or 0
    return np.asarray(np.diff(y[:, heading]) * radians(output_names[heading]) / dt_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DifferentialInput:
    """Two belt speeds replaced by their difference."""

    names: tuple[str, str]
    """Names of the belts."""
    signs: Float[np.ndarray, "1 2"]
    """Signs of the belts in the difference, right minus left."""

    def difference(self, records: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
        """Return the records with the difference as input."""
        return [replace(record, u=record.u @ self.signs.T, input_names=(DIFFERENCE,)) for record in records]

    def units(self, difference: Sequence[InputOutputRecord], units: Units) -> Units:
        """Return units for the difference with unchanged output units, so that model selection is not affected.

        Args:
            difference: Records with the difference as input.
            units: Units of the belts.
        """
        of_input = units_of(difference).scale[:1]
        return Units(
            shift=np.concatenate([self.signs @ units.shift[:2], units.shift[2:]]),
            scale=np.concatenate([of_input, units.output_scale]),
            input_count=1,
        )

    def model(self, model: LinearModel, about: Float[np.ndarray, " 2"]) -> LinearModel:
        """Return the model with both belts as inputs.

        Args:
            model: Model of the difference.
            about: Belt speeds near the operating point.
        """
        offset = model.input_offset - self.signs @ about
        return replace(
            model,
            B=model.B @ self.signs,
            D=model.D @ self.signs,
            input_offset=about + 0.5 * self.signs.T @ offset,
            input_delay=2 * model.input_delay,
            input_names=self.names,
            provenance={**model.provenance, "inputs": "difference"},
        )

    def intervals(self, intervals: ConfidenceIntervals) -> ConfidenceIntervals:
        """Return the intervals of the model with both belts as inputs, in the unit of the difference."""
        units = intervals.units
        both = Units(shift=np.append(0.0, units.shift), scale=np.append(units.input_scale, units.scale), input_count=2)
        return intervals.through(self.signs, both)


def find_differential_input(
    records: Sequence[InputOutputRecord], data: Gram, lags: int | None, feedthrough: bool | None
) -> DifferentialInput | None:
    """Return the input difference of a symmetric vehicle, or None for other channels or if the data contradict symmetry.

    The channel names identify the belts and the turn outputs; the BIC then compares models with both belts and with their
    difference.

    Args:
        records: Experiments.
        data: Gram matrix of the records.
        lags: Requested lags; chosen when None.
        feedthrough: Whether an input acts within the same sample; chosen when None.
    """
    differential = named_differential(records[0])
    if differential is None:
        return None
    alone = differential.difference(records)
    units = differential.units(alone, data.units)
    if not units.input_scale[0] > ROUNDING**0.5 * float(data.units.input_scale.min()):
        return None
    by_difference = min_bic(gram_of(alone, data.lags, units), lags, feedthrough)
    return differential if by_difference < min_bic(data, lags, feedthrough) else None


def named_differential(record: InputOutputRecord) -> DifferentialInput | None:
    """Return the difference identified by names: a left and a right belt, and only turn outputs."""
    if not record.output_names or turn_channels(record.output_names).count < len(record.output_names):
        return None
    return named_belts(record.input_names)


def named_belts(inputs: Sequence[str]) -> DifferentialInput | None:
    """Return the belts of a skid-steer vehicle: the only inputs, a left and a right one with otherwise the same name."""
    signs = belt_signs(inputs)
    return None if signs is None else DifferentialInput(names=(inputs[0], inputs[1]), signs=signs[None])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveLog:
    """Records to be fitted, without inputs that do not move or only move with others."""

    records: list[InputOutputRecord]
    kept: Bool[np.ndarray, " m"] | None = None
    """Mask of the inputs that remain; None for all."""
    differential: DifferentialInput | None = None
    """Belts of which only the difference can be fitted."""
    findings: tuple[str, ...] = ()
    """What was left out, and why."""

    def other(self, record: InputOutputRecord) -> InputOutputRecord:
        """Return another record, such as the one for validation, with the same inputs left out."""
        kept = self.kept
        return record if kept is None or record.u.shape[1] != len(kept) else _with_inputs(record, kept)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFindings:
    """Findings about the records of a fit."""

    lines: tuple[str, ...]
    headings: tuple[str, ...]
    """Those about a heading that is wrapped, or not the integral of the yaw rate; a faulty model repeats the latter."""
    has_feedback: bool
    """Whether the outputs significantly determine the inputs."""
    is_table: bool
    """Whether no output depends on the rows before it."""
    is_integral: bool
    """Whether the heading is the integral of the yaw rate, or only one of them was recorded."""


def examine(log: DriveLog, *, name_prior: bool = True) -> LogFindings:
    """Return the findings about a log.

    Args:
        log: Records to be fitted.
        name_prior: Whether the channels' names may identify belts, headings and yaw rates.
    """
    tested = log.records if log.differential is None else log.differential.difference(log.records)
    is_integral, integrator = _integrator(tested)
    has_feedback, feedback = _feedback(tested, name_prior=name_prior, is_integral=is_integral)
    static, is_feedback = _static(tested, name_prior=name_prior)
    headings = tuple(integrator) if name_prior else ()
    return LogFindings(
        lines=(*log.findings, *feedback, *_single_frequencies(tested), *static, *headings),
        headings=headings,
        has_feedback=has_feedback or is_feedback,
        is_table=bool(static) and not is_feedback,
        is_integral=is_integral,
    )


# Dependent inputs -------------------------------------------------------------------------------------------------------


def without_dependent_inputs(records: list[InputOutputRecord], *, name_prior: bool) -> DriveLog | None:
    """Return the log without constant and collinear inputs, or with the difference of such belts; None if all inputs are needed.

    Raises:
        PoorExcitation: If no input moves, or belts always differ by the same speed and only turns are measured.
    """
    u = np.vstack([record.u[record.whole] for record in records])
    names = channel_names(records[0])[: u.shape[1]]
    mean, moved = u.mean(axis=0), u - u.mean(axis=0)
    still = ~(moved.std(axis=0) > 1e-12 * np.abs(mean))
    kept = _independent(moved / np.where(still, 1.0, moved.std(axis=0)), ~still)
    if kept.all():
        return None
    if still.all():
        raise PoorExcitation(f"no input moves ({', '.join(names)}); give a record with motion")
    belts = named_differential(records[0]) if name_prior else None
    if belts is not None:
        return _by_difference(records, belts, moved, still)
    findings = []
    for j in np.flatnonzero(~kept):
        if still[j]:
            findings.append(
                f"constant input: '{names[j]}' is constant at {mean[j]:.4g} and left out; its effect is part of the offset"
            )
        else:
            before = np.flatnonzero(kept[:j])
            share = np.linalg.lstsq(moved[:, before], moved[:, j], rcond=None)[0] * moved[:, before].std(axis=0)
            partners = " and ".join(f"'{names[i]}'" for i in before[np.abs(share) > ROUNDING**0.5 * moved[:, j].std()])
            findings.append(
                f"collinear input: '{names[j]}' always moves with {partners} and is left out; the model holds only while it does"
            )
    return DriveLog(records=[_with_inputs(record, kept) for record in records], kept=kept, findings=tuple(findings))


def _independent(scaled: Float[np.ndarray, "T m"], moving: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Return the mask of the moving inputs that are no linear combination of those before them."""
    kept, basis = moving.copy(), np.empty((len(scaled), 0))
    for j in np.flatnonzero(moving):
        rest = scaled[:, j] - basis @ (basis.T @ scaled[:, j])
        rest -= basis @ (basis.T @ rest)
        kept[j] = rest @ rest > ROUNDING * len(scaled)
        if kept[j]:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return kept


def _by_difference(
    records: list[InputOutputRecord], belts: DifferentialInput, moved: Float[np.ndarray, "T 2"], still: Bool[np.ndarray, " 2"]
) -> DriveLog:
    one, other = (f"'{name}'" for name in belts.names)
    if not np.std(moved @ belts.signs.T) > ROUNDING**0.5 * np.std(moved):
        raise PoorExcitation(
            f"collinear inputs: {one} and {other} always differ by the same speed: nothing turns the vehicle; drive curves"
        )
    cause = (
        f"constant input: {(one, other)[int(np.argmax(still))]} is constant"
        if still.any()
        else (f"collinear inputs: {one} and {other} always move together")
    )
    finding = f"{cause}: the difference of both is the only input, as in a vehicle whose sides are equal; move each belt by itself"
    return DriveLog(records=records, differential=belts, findings=(finding,))


def _with_inputs(record: InputOutputRecord, kept: Bool[np.ndarray, " m"]) -> InputOutputRecord:
    given = channel_names(record)[: len(kept)]
    names = tuple(name for name, stays in zip(given, kept, strict=True) if stays)
    return replace(record, u=record.u[:, kept], input_names=names)


# Regressions on the past ------------------------------------------------------------------------------------------------


def _feedback(records: Sequence[InputOutputRecord], *, name_prior: bool, is_integral: bool) -> tuple[bool, list[str]]:
    """Return whether outputs significantly determine inputs, and a finding if by more than half.

    The measure is the largest canonical correlation of what both have new next to the inputs' past. That past has as many more
    rows as the outputs have regressors, so that a coloured input alone gains nothing from them. Outputs before the current row
    decide, because an input may act within the row, and a heading of the row, on which it cannot; all outputs up to the row give
    the share.
    """
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    for lags in range(TESTED_LAGS, 0, -1):
        own = lags + -(-(lags + 1) * p // m)
        if m * own + p * (lags + 1) <= _columns(records, own):
            break
    else:
        return False, []
    z = _windows(records, own)
    if len(z) < 2 * (m * own + p * (lags + 1)):  # gaps leave too few
        return False, []
    past, now = z[:, :-1, :m].reshape(len(z), -1), z[:, -1, :m]
    new = _residual(past, now)
    if np.trace(new.T @ new) <= PREDICTABLE * np.sum(np.var(now, axis=0)) * len(z):
        return False, []
    before, seen = z[:, -1 - lags : -1, m:].reshape(len(z), -1), z[:, -1 - lags :, m:]
    if name_prior and is_integral:
        before = np.column_stack([before, _answered(records, new, _residual(past, seen[:, -1]))])
    earlier, _ = _canonical(new, _residual(past, before), now)
    statistic = -len(z) * np.log1p(-min(earlier, 1.0 - 1e-12))
    if not chdtrc(before.shape[1] + m - 1, statistic) < SIGNIFICANCE:
        return False, []
    share, along = _canonical(new, _residual(past, seen.reshape(len(z), -1)), now)
    if share < HALF:
        return True, []
    by_output = [_canonical(new, _residual(past, seen[:, :, j]), now)[0] for j in range(p)]
    output, names = channel_names(records[0])[m + int(np.argmax(by_output))], channel_names(records[0])
    return True, [
        f"feedback: the outputs, above all '{output}', explain {100.0 * share:.0f} % of what is new in "
        f"{_combination(names, along)}: the model may be the controller's inverse; add dither, or drive without control"
    ]


def _answered(
    records: Sequence[InputOutputRecord], new: Float[np.ndarray, "N m"], outputs: Float[np.ndarray, "N p"]
) -> Float[np.ndarray, "N h"]:
    """Return the heading of the row, the yaw rate's integral, if the belts' difference answers it: it falls where that rises.

    In a record whose outputs are late by a row, the difference and the heading rise together.
    """
    heading, belts = turn_channels(records[0].output_names).heading, named_belts(records[0].input_names)
    signs = np.ones(1) if records[0].input_names[:1] == (DIFFERENCE,) else None if belts is None else belts.signs[0]
    if heading is None or signs is None or (new @ signs) @ outputs[:, heading] >= 0.0:
        return outputs[:, :0]
    return outputs[:, heading : heading + 1]


def _canonical(
    new: Float[np.ndarray, "N m"], seen: Float[np.ndarray, "N q"], now: Float[np.ndarray, "N m"]
) -> tuple[float, Float[np.ndarray, " m"]]:
    """Return the largest squared canonical correlation, and the weights of the inputs times their standard deviation."""
    left, s, Vt = np.linalg.svd(new, full_matrices=False)
    live = s > np.sqrt(PREDICTABLE) * np.linalg.norm(now - now.mean(axis=0))
    right, spread, _ = np.linalg.svd(seen, full_matrices=False)
    inner, values, _ = np.linalg.svd(left[:, live].T @ right[:, spread > 1e-9 * max(spread[0], 1e-300)])
    if not values.size:
        return 0.0, np.ones(now.shape[1])
    weights = (Vt[live].T / s[live]) @ inner[:, 0]
    return float(values[0] ** 2), np.asarray(weights * np.std(now, axis=0))


def _combination(names: Sequence[str], along: Float[np.ndarray, " m"]) -> str:
    """Return the inputs with at least half of the largest weight in words."""
    large = [int(j) for j in np.flatnonzero(np.abs(along) >= 0.5 * np.abs(along).max())]
    listed = " and ".join(f"'{names[j]}'" for j in large)
    return f"the difference of {listed}" if len(large) == 2 and along[large[0]] * along[large[1]] < 0.0 else listed


def _static(records: Sequence[InputOutputRecord], *, name_prior: bool) -> tuple[list[str], bool]:
    """Return a finding if no output depends on the rows before it (likelihood ratio tests), and whether it is of feedback.

    A heading integrates, so that inputs of its row can only follow it.
    """
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    lags = min(TESTED_LAGS, int(_columns(records, TESTED_LAGS) // (m + p)))
    if lags < 1:
        return [], False
    z = _windows(records, lags)
    if len(z) < 2 * lags * (m + p):
        return [], False
    now, y, past = z[:, -1, :m], z[:, -1, m:], z[:, :-1].reshape(len(z), -1)
    static = _residual(now, y)
    full = _residual(np.hstack([now, past]), y)
    before, after = np.sum(static**2, axis=0), np.sum(full**2, axis=0)
    total = np.sum((y - y.mean(axis=0)) ** 2, axis=0)
    freedom = past.shape[1]
    exact = before <= PREDICTABLE * total
    with np.errstate(divide="ignore", invalid="ignore"):
        statistic = (len(z) - m - 0.5 * freedom) * np.log(before / after)
    memory = ~exact & (chdtrc(freedom, np.maximum(statistic, 0.0)) < SIGNIFICANCE)
    if memory.any():
        return [], False
    shares = 1.0 - before / np.maximum(total, 1e-300)
    heading = turn_channels(records[0].output_names).heading if name_prior else None
    if heading is not None and shares[heading] > HALF:
        finding = (
            f"feedback: '{records[0].output_names[heading]}' and the inputs of the same row determine each other "
            f"({100.0 * shares[heading]:.0f} %), as under control; add dither, or drive without control"
        )
        return [finding], True
    share = 100.0 * float(shares.max())
    finding = (
        f"table: no output depends on the rows before it, and the inputs of the same row explain {share:.0f} % at most; a table of "
        "steady states, or rows out of order? sort them by time, or record a drive"
    )
    return [finding], False


def _columns(records: Sequence[InputOutputRecord], lags: int) -> float:
    """Return the number of regressors that the windows of a number of lags support."""
    return min(float(COLUMNS_MOST), sum(len(record) - lags for record in records) / ROWS_PER_PARAMETER)


def _windows(records: Sequence[InputOutputRecord], lags: int) -> Float[np.ndarray, "N lags1 r"]:
    """Return complete windows of inputs and outputs, oldest row first, spread over the records."""
    parts = []
    stride = max(1, sum(len(record) for record in records) // ROWS_MOST)
    for record in records:
        if len(record) > lags:
            z = np.hstack([record.u, record.y])
            parts.append(sliding_window_view(z, lags + 1, axis=0)[::stride].transpose(0, 2, 1))
    width = records[0].u.shape[1] + records[0].y.shape[1]
    z = np.concatenate(parts) if parts else np.empty((0, lags + 1, width))
    z = z[np.isfinite(z).all(axis=(1, 2))]
    scale = np.maximum(np.abs(z).max(axis=(0, 1), initial=0.0), 1e-300)
    return np.asarray(z / scale)


def _residual(regressors: Float[np.ndarray, "N q"], targets: Float[np.ndarray, "N r"]) -> Float[np.ndarray, "N r"]:
    """Return the residuals of the targets' regression on a constant and the regressors."""
    columns = regressors - regressors.mean(axis=0)
    left, s, _ = np.linalg.svd(columns, full_matrices=False)
    left = left[:, s > 1e-10 * s[0]] if s.size and s[0] > 0.0 else left[:, :0]
    rest = targets - targets.mean(axis=0)
    return np.asarray(rest - left @ (left.T @ rest))


# Frequencies and names --------------------------------------------------------------------------------------------------


def _single_frequencies(records: Sequence[InputOutputRecord]) -> Iterator[str]:
    """Yield a finding per input, or difference of belts, that is one sinusoid."""
    longest = max(records, key=len)
    u, names = longest.u[longest.whole][-PADDING * ROWS_MOST :], [f"'{name}'" for name in channel_names(longest)]
    belts = named_belts(longest.input_names)
    signals = [*zip(names, u.T, strict=False)]
    if belts is not None:
        signals.append((f"the difference of {names[0]} and {names[1]}", (u @ belts.signs.T)[:, 0]))
    found = [(name, *_sinusoid(signal)) for name, signal in signals]
    lines = [item for item in found if item[1] > SQUARE_WAVE_SHARE]
    for name, share, frequency in lines[-1:] if belts is not None else lines:
        yield (
            f"one frequency: {name} is a sinusoid, {frequency / longest.dt_s:.3g} Hz holds {100.0 * share:.0f} % of its variance; "
            "it shows gain and delay there alone: vary it"
        )


def _sinusoid(signal: Float[np.ndarray, " T"]) -> tuple[float, float]:
    """Return the share of a signal's variance in its strongest frequency, and the frequency [1/sample]."""
    x = signal - signal.mean()
    energy, count = float(x @ x), PADDING * len(x)
    power = np.abs(np.fft.rfft(x, count)) ** 2
    power[: int(PERIODS_MIN * PADDING)] = 0.0
    at = int(np.argmax(power))
    if not (energy > 0.0 and power[at] > 0.0):
        return 0.0, 0.0
    angle = 2.0 * np.pi * at / count * np.arange(len(x))
    return 1.0 - float(np.sum(_residual(np.column_stack([np.cos(angle), np.sin(angle)]), x[:, None]) ** 2)) / energy, at / count


def _integrator(records: Sequence[InputOutputRecord]) -> tuple[bool, list[str]]:
    """Return whether the heading may be the yaw rate's integral, and a finding if it was wrapped, or is not."""
    names, turn = records[0].output_names, turn_channels(records[0].output_names)
    if turn.heading is None:
        return True, []
    heading, unit = names[turn.heading], radians(names[turn.heading])
    bounds = None if turn.yaw_rate is None else _heading_over_yaw_rate(records, turn.heading, turn.yaw_rate)
    faults = [] if bounds is None else integral_faults(heading, *bounds)
    is_integral = turn.yaw_rate is None or (bounds is not None and not faults)
    jumps = sum(int(np.sum(np.abs(np.diff(record.y[:, turn.heading])) * unit > np.pi)) for record in records)
    if not heading.endswith(("_rad", "_deg")):
        return is_integral, []
    if jumps:
        remedy = "unwrap it (numpy.unwrap) and name it _unwrapped_rad"
        return is_integral, [f"wrapped angle: '{heading}' jumps by half a turn or more at {jumps} rows; {remedy}"]
    return is_integral, faults


def _heading_over_yaw_rate(records: Sequence[InputOutputRecord], heading: int, yaw_rate: int) -> tuple[float, float] | None:
    """Return bounds of the heading's change per integral of the yaw rate over ten rows; None for unrelated channels.

    The regressions either way bound the ratio when both channels are noisy (Frisch, 1934).
    """
    parts = []
    for record in records:
        # Each ten rows are integrated by themselves, so that a gap costs one of them.
        turns = 0.5 * (record.y[1:, yaw_rate] + record.y[:-1, yaw_rate]) * record.dt_s
        changes = np.diff(record.y[::TESTED_LAGS, heading])
        parts.append(np.column_stack([changes, turns[: TESTED_LAGS * len(changes)].reshape(-1, TESTED_LAGS).sum(axis=1)]))
    z = np.concatenate(parts)
    z = z[np.isfinite(z).all(axis=1)]
    if len(z) < ROWS_PER_PARAMETER:
        return None
    size = np.maximum(np.abs(z).max(axis=0), 1e-300)  # of any unit: squares of large numbers overflow
    (changed, cross), (_, turned) = np.cov((z / size).T)
    if not chdtrc(1, len(z) * cross**2 / max(changed * turned, 1e-300)) < SIGNIFICANCE:
        return None
    unit = radians(records[0].output_names[heading]) / radians(records[0].output_names[yaw_rate])
    low, high = sorted(size[0] / size[1] * unit * np.array([cross / turned, changed / cross]))
    return float(low), float(high)
