"""The whole of Section IV: records in, a linear model and an honest report out.

Paper: Section IV, VI.B. Check → Gram → OKID → ERA → observer gain → validation.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.errors import SettingsError
from treadline.identification import validate
from treadline.identification.checks import check_records
from treadline.identification.deconvolution import deconvolve
from treadline.identification.era import hankel_svd
from treadline.identification.intervals import pole_intervals
from treadline.identification.okid import observer_markov
from treadline.identification.realisation import markov_svd, model_of
from treadline.identification.structure import choose_structure, noise_level, settle_order, structural_order
from treadline.identification.windows import joined, leading, parts_of, scales_of
from treadline.models import InputOutputRecord, LinearModel

METHODS = ("okid-era", "deconvolution")


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
    scales = scales_of(fitted)
    if method == "deconvolution":
        observer, markov, used = None, _deconvolved(fitted), 0
        svd = hankel_svd(markov, (len(markov) - 1) // 2, (len(markov) - 1) // 2, *scales)
        count, dropped, has_d, parts = len(fitted[0]), 0, True, []
    else:
        parts = parts_of(fitted, lags, order, scales)
        whole = joined(parts)
        used, has_d = choose_structure(whole, lags, feedthrough)
        if whole.dropped and used < whole.lags:  # fewer lags look back on fewer gaps
            parts = parts_of(fitted, used, order, scales)
            whole = joined(parts)
        observer = observer_markov(leading(whole, used, has_d))
        svd = markov_svd(observer, used, order, scales)
        count, dropped = whole.count, whole.dropped
    noise = noise_level(parts, used, has_d, order, scales) if order is None else 0.0
    choice = settle_order(svd, order, structural_order(observer, fitted), noise, warnings)
    if dropped:
        warnings.append(f"{dropped} windows with a NaN were left out, {count} are used")
    model = model_of(svd, choice.order, scales, fitted, observer, markov[0] if observer is None else observer.D)
    poles = np.linalg.eigvals(model.A).astype(complex)
    radius = float(np.abs(poles).max())
    if radius > 1.0 + 1e-6:
        warnings.append(f"the model is unstable (spectral radius {radius:.4f}): closed-loop or drifting data?")
    spread = pole_intervals(parts, used, has_d, choice.order, scales, poles) if len(parts) > 2 else None
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
