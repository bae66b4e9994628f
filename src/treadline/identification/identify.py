"""The whole of Section IV: records in, a linear model and an honest report out.

Paper: Section IV, VI.B. Check → Gram → OKID → ERA → observer gain → validation.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification import validate
from treadline.identification.checks import channel_names, check_records
from treadline.identification.deconvolution import deconvolve
from treadline.identification.era import HankelSvd, hankel_svd, realise
from treadline.identification.gram import Gram, gram
from treadline.identification.okid import ObserverMarkov, observer_markov, solve_normal, system_markov
from treadline.identification.order import OrderChoice, choose_order, stands_out
from treadline.models import InputOutputRecord, LinearModel

METHODS = ("okid-era", "deconvolution")
LAGS_MOST = 12
"""Largest number of lags tried when none is given."""
ROWS_PER_PARAMETER = 8
"""Samples wanted per coefficient of one output."""
BLOCKS_LEAST = 8
"""Block rows of the Hankel matrix at least: two seconds at 4 Hz, on which an integrator and a lag part clearly."""
JACKKNIFE_PARTS = 10
EXACT = 1e-12
"""Residual variance over the outputs' variance at which data are free of noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationReport:
    """What the data said, and how sure."""

    order: int
    lags: int
    method: str
    feedthrough: bool
    singular_values: list[float]
    gap: float
    """σ_n / σ_{n+1}."""
    poles: list[tuple[float, float]]
    pole_ci95: list[float] | None
    """Half width of each pole's 95 % interval in the complex plane (jackknife over ten parts)."""
    fit_percent: dict[str, float]
    one_step_vaf_percent: dict[str, float]
    whiteness_p: float
    samples: int
    dropped: int
    warnings: list[str]
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identified:
    """A model and its report."""

    model: LinearModel
    report: IdentificationReport


def identify(
    records: InputOutputRecord | Sequence[InputOutputRecord],
    *,
    order: int | None = None,
    lags: int | None = None,
    method: str = "okid-era",
    feedthrough: bool | None = None,
    validation: float | InputOutputRecord | None = None,
) -> Identified:
    """Return the linear model that fits one or more experiments.

    Args:
        records: Experiments with the same channels and period; they are joined as experiments, not as one.
        order: Number of states; the largest gap of the singular values decides when left out.
        lags: Observer lags p; Schwarz's criterion decides when left out.
        feedthrough: Whether an input may act within its own sample (D); the same criterion decides when left out.
        validation: Share of each record, at its end, kept for validation, or another record; without it the report's
            figures are on the data that were fitted.

    Raises:
        RecordError: If the data cannot carry what is asked.
        SettingsError: If the method is unknown or a number is out of range.
    """
    started = time.perf_counter()
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    if not given:
        raise SettingsError("identify needs at least one record")
    if method not in METHODS:
        raise SettingsError(f"method is '{method}'; allowed: {', '.join(METHODS)}")
    if order is not None and order < 1:
        raise SettingsError(f"order is {order}; at least 1")
    if lags is not None and lags < 1:
        raise SettingsError(f"lags is {lags}; at least 1")
    check_records(given)
    fitted, judged = _split(given, validation)

    warnings: list[str] = []
    scales = _scales(fitted)
    if method == "deconvolution":
        observer, markov, used = None, _deconvolved(fitted), 0
        svd = hankel_svd(markov, (len(markov) - 1) // 2, (len(markov) - 1) // 2, *scales)
        count, dropped, has_d, parts = len(fitted[0]), 0, True, []
    else:
        parts = _parts(fitted, lags, order, scales)
        whole = _sum(parts)
        used, has_d = _structure(whole, lags, feedthrough)
        if whole.dropped and used < whole.lags:  # fewer lags look back on fewer gaps
            parts = _parts(fitted, used, order, scales)
            whole = _sum(parts)
        observer = observer_markov(_leading(whole, used, has_d))
        svd = _svd(observer, used, order, scales)
        count, dropped = whole.count, whole.dropped
    noise = _noise(parts, used, has_d, order, scales) if order is None else 0.0
    choice = _order(svd, order, _structural_order(observer, fitted), noise, warnings)
    if dropped:
        warnings.append(f"{dropped} windows with a NaN were left out, {count} are used")
    model = _model(svd, choice.order, scales, fitted, observer, markov[0] if observer is None else observer.D)
    poles = np.linalg.eigvals(model.A).astype(complex)
    radius = float(np.abs(poles).max())
    if radius > 1.0 + 1e-6:
        warnings.append(f"the model is unstable (spectral radius {radius:.4f}): closed-loop or drifting data?")
    spread = _jackknife(parts, used, has_d, choice.order, scales, poles) if len(parts) > 2 else None
    report = _judge(model, judged, warnings)
    report = replace(
        report,
        order=choice.order,
        lags=used,
        method=method,
        feedthrough=has_d,
        singular_values=[float(value) for value in svd.s],
        gap=choice.gap,
        poles=[(float(pole.real), float(pole.imag)) for pole in poles],
        pole_ci95=spread,
        samples=count,
        dropped=dropped,
        seconds=time.perf_counter() - started,
    )
    return Identified(model=replace(model, provenance={"method": method, "order": choice.order, "lags": used}), report=report)


def _split(
    records: list[InputOutputRecord], validation: float | InputOutputRecord | None
) -> tuple[list[InputOutputRecord], list[InputOutputRecord]]:
    if validation is None:
        return records, records
    if isinstance(validation, InputOutputRecord):
        check_records([records[0], validation])
        return records, [validation]
    if not 0.0 < validation < 1.0:
        raise SettingsError(f"the validation share is {validation}; it must lie between 0 and 1")
    cuts = [round(len(record) * (1.0 - validation)) for record in records]
    return (
        [validate.part(record, 0, cut) for record, cut in zip(records, cuts, strict=True)],
        [validate.part(record, cut, len(record)) for record, cut in zip(records, cuts, strict=True)],
    )


Scales = tuple[Float[np.ndarray, " m"], Float[np.ndarray, " p"]]


def _scales(records: list[InputOutputRecord]) -> Scales:
    u, y = np.vstack([record.u for record in records]), np.vstack([record.y for record in records])
    return np.nanstd(u, axis=0), np.nanstd(y, axis=0)


def _parts(records: list[InputOutputRecord], lags: int | None, order: int | None, scales: Scales) -> list[Gram]:
    """Return the Gram matrices of the data in about ten parts, at the largest number of lags wanted."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    most = lags if lags is not None else _affordable_lags(records)
    needed = max(most, -(-(order or 1) // p), 1)
    wanted = 2 * (1 + m + needed * (m + p))
    if most < needed or _usable(records, needed) <= wanted:
        lost = total - _usable(records, needed)
        raise PoorExcitation(
            f"{total} samples are too few: {m} inputs, {p} outputs and order {order or 'auto'} with {needed} lags need more "
            f"than {wanted}" + (f", and gaps cost {lost}" if lost else "")
        )
    made = []
    for record in records:
        pieces = max(1, round(JACKKNIFE_PARTS * len(record) / total))
        edges = np.linspace(most, len(record), pieces + 1).astype(int)
        for start, stop in pairwise(edges.tolist()):
            if stop > start:
                piece = validate.part(record, start - most, stop)
                made.append(gram(piece, most, feedthrough=True, input_scale=scales[0], output_scale=scales[1]))
    return made


def _usable(records: list[InputOutputRecord], lags: int) -> int:
    """Return the number of samples, less those from which some lag looks back on a gap."""
    usable = 0
    for record in records:
        gaps = np.cumsum(~np.isfinite(np.hstack([record.u, record.y])).all(axis=1))
        in_window = gaps[lags:] - np.concatenate([[0], gaps[: -lags - 1]])
        usable += len(record) - int(np.count_nonzero(in_window))
    return usable


def _affordable_lags(records: list[InputOutputRecord]) -> int:
    """Return the largest number of lags for which there are enough samples per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    enough = [lags for lags in range(1, LAGS_MOST + 1) if _usable(records, lags) >= ROWS_PER_PARAMETER * (1 + m + lags * (m + p))]
    return max(enough, default=0)


def _sum(parts: list[Gram]) -> Gram:
    whole = parts[0]
    for item in parts[1:]:
        whole = whole + item
    return whole


def _leading(whole: Gram, lags: int, feedthrough: bool) -> Gram:
    """Return the Gram matrix of fewer lags: a leading block, with or without the column of u_k."""
    m, p = whole.input_scale.size, whole.output_scale.size
    keep = np.arange(1 + m + lags * (m + p))
    if not feedthrough:
        keep = np.delete(keep, np.arange(1, 1 + m))
    return replace(whole, lags=lags, feedthrough=feedthrough, XX=whole.XX[np.ix_(keep, keep)], XY=whole.XY[keep])


def _structure(whole: Gram, lags: int | None, feedthrough: bool | None) -> tuple[int, bool]:
    """Return lags and feedthrough by Schwarz's criterion: fit against the number of coefficients."""
    tried_lags = [lags] if lags is not None else range(1, whole.lags + 1)
    tried_d = [feedthrough] if feedthrough is not None else [False, True]
    costs = {(p, has_d): _schwarz(_leading(whole, p, has_d)) for p in tried_lags for has_d in tried_d}
    return min(costs, key=lambda key: costs[key])


def _schwarz(data: Gram) -> float:
    theta, _ = solve_normal(data.XX, data.XY)
    residual = data.YY - theta.T @ data.XY
    values = np.linalg.eigvalsh(0.5 * (residual + residual.T) / data.count)
    # Residuals below rounding are all the same: exact.
    floor = 1e-20 * float(np.trace(data.YY)) / data.count
    return data.count * float(np.sum(np.log(np.maximum(values, floor)))) + theta.size * np.log(data.count)


def _svd(observer: ObserverMarkov, lags: int, order: int | None, scales: Scales) -> HankelSvd:
    m, p = observer.D.shape[1], observer.D.shape[0]
    blocks = max(lags, BLOCKS_LEAST, -(-((order or 1) + 1) // min(m, p)))
    return hankel_svd(system_markov(observer, 2 * blocks + 1), blocks, blocks, *scales)


def _structural_order(observer: ObserverMarkov | None, records: list[InputOutputRecord]) -> int | None:
    """Return the rank that p lags alone give the Hankel matrix; None where the observer is exact, so that it is real."""
    if observer is None:
        return None
    y = np.vstack([record.y for record in records])
    exact = np.trace(observer.residual_covariance) < EXACT * np.sum(np.nanvar(y, axis=0))
    return None if exact else observer.beta.shape[0] * observer.beta.shape[1]


def _noise(parts: list[Gram], lags: int, feedthrough: bool, order: int | None, scales: Scales) -> float:
    """Return the largest singular value that noise alone would show: half of what two halves of the data differ by."""
    if len(parts) < 2:
        return 0.0
    halves = [
        _svd(observer_markov(_leading(_sum(half), lags, feedthrough)), lags, order, scales) for half in (parts[::2], parts[1::2])
    ]
    return 0.5 * float(np.linalg.norm(halves[0].matrix - halves[1].matrix, 2))


def _order(svd: HankelSvd, order: int | None, structural: int | None, noise: float, warnings: list[str]) -> OrderChoice:
    # An observer of p lags has no more than p states per output: the drop after those says nothing of the system.
    choice = choose_order(svd.s[:structural], noise=noise)
    if order is not None:
        following = float(svd.s[order]) if order < svd.s.size else 0.0
        gap = float(svd.s[min(order, svd.s.size) - 1]) / following if following > 0.0 else float("inf")
        return OrderChoice(order=order, gap=gap, clear=True)
    if not stands_out(svd.s, noise):
        warnings.append(
            f"no clear gap in the singular values (the largest is {svd.s[0] / noise:.1f} times what noise alone shows); "
            "give more data, or inputs that move more"
        )
    elif not choice.clear:
        warnings.append(
            f"no clear gap in the singular values (largest ratio {choice.gap:.1f} at order {choice.order}); "
            "give --order, or more data"
        )
    return choice


def _model(
    svd: HankelSvd,
    order: int,
    scales: Scales,
    records: list[InputOutputRecord],
    observer: ObserverMarkov | None,
    D: Float[np.ndarray, "p m"],
) -> LinearModel:
    A, B, C = realise(svd, order, *scales)
    u0 = np.nanmean(np.vstack([record.u for record in records]), axis=0)
    y0 = np.nanmean(np.vstack([record.y for record in records]), axis=0)
    if observer is not None:
        u0, y0 = _rest(observer, u0, y0, scales)
    names = channel_names(records[0])
    m = records[0].u.shape[1]
    return LinearModel(
        A=A,
        B=B,
        C=C,
        D=D,
        dt_s=records[0].dt_s,
        input_offset=u0,
        output_offset=y0,
        observer_gain=None if observer is None else _observer_gain(A, C, observer),
        input_names=names[:m],
        output_names=names[m:],
    )


def _rest(
    observer: ObserverMarkov, u_mean: Float[np.ndarray, " m"], y_mean: Float[np.ndarray, " p"], scales: Scales
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " p"]]:
    """Return the operating point (input, output) nearest to the means at which the observer says nothing changes.

    (I - Σβ) y₀ - (D + Σα) u₀ = bias. Where an integrator leaves y₀ open, it is u₀ that yields: a chair whose right belt
    runs fast stands still at unequal belts. Distances count in deviations, an input's three times.
    """
    M = np.eye(y_mean.size) - observer.beta.sum(axis=0)
    N = observer.D + observer.alpha.sum(axis=0)
    missing = observer.bias - M @ y_mean + N @ u_mean
    step_u, step_y = scales[0] / 3.0, scales[1]
    change = np.linalg.pinv(np.hstack([M * step_y, -N * step_u])) @ missing
    return u_mean + change[y_mean.size :] * step_u, y_mean + change[: y_mean.size] * step_y


def _observer_gain(
    A: Float[np.ndarray, "n n"], C: Float[np.ndarray, "p n"], observer: ObserverMarkov
) -> Float[np.ndarray, "n p"] | None:
    """Return the innovation gain that, with this A and C, answers an innovation as OKID's observer does."""
    lags, p, _ = observer.beta.shape
    steps = max(lags, A.shape[0]) + 1
    response = [np.eye(p)]
    for k in range(1, steps):
        response.append(sum(observer.beta[i - 1] @ response[k - i] for i in range(1, min(k, lags) + 1)))
    rows, reach = [], C
    for _ in range(1, steps):
        rows.append(reach)
        reach = reach @ A
    gain = np.linalg.lstsq(np.vstack(rows), np.vstack(response[1:]), rcond=None)[0]
    stable = float(np.abs(np.linalg.eigvals(A - gain @ C)).max()) < 1.0
    return np.asarray(gain) if stable else None


def _jackknife(
    parts: list[Gram], lags: int, feedthrough: bool, order: int, scales: Scales, poles: Complex[np.ndarray, " n"]
) -> list[float]:
    """Return the half width of each pole's 95 % interval: the fit with each part left out in turn."""
    whole = _sum(parts)
    found = []
    for item in parts:
        rest = replace(whole, XX=whole.XX - item.XX, XY=whole.XY - item.XY, YY=whole.YY - item.YY, count=whole.count - item.count)
        svd = _svd(observer_markov(_leading(rest, lags, feedthrough)), lags, order, scales)
        found.append(_nearest(np.linalg.eigvals(realise(svd, order, *scales)[0]).astype(complex), poles))
    values = np.array(found)
    k = len(parts)
    variance = (k - 1) / k * np.sum(np.abs(values - values.mean(axis=0)) ** 2, axis=0)
    return [float(1.96 * np.sqrt(value)) for value in variance]


def _nearest(found: Complex[np.ndarray, " n"], poles: Complex[np.ndarray, " n"]) -> list[complex]:
    left = [complex(pole) for pole in found]
    ordered = []
    for pole in poles:
        best = min(left, key=lambda other: abs(other - pole))
        left.remove(best)
        ordered.append(best)
    return ordered


def _deconvolved(records: list[InputOutputRecord]) -> Float[np.ndarray, "T p m"]:
    if len(records) > 1:
        raise SettingsError("Eq. (9c) knows one experiment; give one record, or use method okid-era")
    return deconvolve(records[0].u, records[0].y)


def _judge(model: LinearModel, judged: list[InputOutputRecord], warnings: list[str]) -> IdentificationReport:
    names = model.output_names
    residuals = [validate.one_step_residuals(model, record) for record in judged]
    vaf = np.mean([validate.vaf_percent(record.y, e) for record, e in zip(judged, residuals, strict=True)], axis=0)
    fit = np.mean([validate.fit_percent(model, record) for record in judged], axis=0)
    return IdentificationReport(
        order=0,
        lags=0,
        method="",
        feedthrough=False,
        singular_values=[],
        gap=0.0,
        poles=[],
        pole_ci95=None,
        fit_percent={name: float(value) for name, value in zip(names, fit, strict=True)},
        one_step_vaf_percent={name: float(value) for name, value in zip(names, vaf, strict=True)},
        whiteness_p=min(validate.whiteness_p(e) for e in residuals),
        samples=0,
        dropped=0,
        warnings=warnings,
        seconds=0.0,
    )
