"""Identification of a linear model from records (Section IV): the main entry point.

Paper: Section IV, VI.B. Check → Gram matrix → OKID → ERA or PBSID → refinement → report.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification import validate
from treadline.identification.affine import Affine, to_model
from treadline.identification.checks import (
    channel_names,
    check_alike,
    check_independent,
    check_integers,
    check_records,
)
from treadline.identification.delays import input_delays, with_delays, without_delays
from treadline.identification.differential_input import DifferentialInput, find_differential_input
from treadline.identification.fitting import with_inputs_again
from treadline.identification.from_gram import from_gram, gram_with_half, provenance_of
from treadline.identification.gram import Gram, Units
from treadline.identification.identified import FittedSystem, Identified
from treadline.identification.okid import observer_markov
from treadline.identification.reduction import stabilised
from treadline.identification.report import whole_samples
from treadline.identification.structure import choose_structure
from treadline.identification.threads import one_thread
from treadline.models import InputOutputRecord

METHODS = ("best", "okid-era", "era-dc", "pbsid", "deconvolution")
SOLVERS = ("gram", "qr")
VALIDATION_SAMPLES_MIN = 20
"""Smallest number of complete samples of a validation part: its residuals are tested over ten lags."""


@one_thread()
def identify(
    records: InputOutputRecord | Sequence[InputOutputRecord],
    *,
    order: int | None = None,
    lags: int | None = None,
    method: str | None = None,
    feedthrough: bool | None = None,
    delays: Sequence[int] | str | None = None,
    solver: str = "gram",
    stable: bool = False,
    validation: float | InputOutputRecord | None = None,
    prior: Gram | None = None,
    forgetting: float = 1.0,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Identified:
    """Return the linear model that fits one or more experiments.

    Args:
        records: Experiments with the same channels and period, treated as separate experiments.
        order: Number of states. When left out, the largest gap of the singular values decides, with ``pbsid`` the BIC if the
            gap is unclear, with ``best`` cross-validation.
        lags: Observer lags p. When left out, the BIC decides, with ``okid-era`` and ``era-dc`` the AICc.
        method: ``best`` compares several methods by cross-validation; ``okid-era`` is the paper's method, ``era-dc`` its
            variant with data correlations, ``pbsid`` the closed-loop subspace method, ``deconvolution`` Eq. (9c) as
            printed. Default ``best``, with a prior ``pbsid``.
        feedthrough: Whether an input acts within the same sample (D); the BIC decides when left out.
        delays: Dead time of each input in samples, ``auto`` to estimate it, None to model it with states.
        solver: ``gram`` for normal equations, or ``qr``: slower, accurate to rounding on noise-free data.
        stable: Whether to reflect poles outside the unit circle into it.
        validation: Share of each record, at its end, kept for validation, or a separate record. When left out, the report
            is computed on the fitted data.
        prior: Gram matrix of earlier data (``Identified.gram``) to continue from.
        forgetting: Weight factor on earlier data per new sample; 1 forgets nothing.
        on_progress: Called with a line of text per candidate that ``best`` scores.

    Raises:
        RecordError: If the data do not support the request.
        SettingsError: If an option is unknown or out of range.
    """
    started = time.perf_counter()
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    method = method or ("best" if prior is None else "pbsid")
    _check_options(given, method, solver, order, lags, forgetting, prior)
    units = check_records(given)
    fitted, judged = _split(given, validation)
    if validation is not None:
        units = check_records(fitted)
    warnings: list[str] = []
    shifts = _dead_time(fitted, delays, lags, order, feedthrough, units)
    moved = without_delays(fitted, shifts) if any(shifts) else fitted
    data, half = gram_with_half(moved, 1 if method == "deconvolution" else lags, order, solver, units, prior, forgetting)
    differential = _differential_input(moved, data, lags, feedthrough) if method == "best" else None
    taken = moved if differential is None else differential.difference(moved)
    data_pair = (
        (data, half) if differential is None else gram_with_half(taken, lags, order, solver, differential.units(taken, data.units))
    )
    found = from_gram(
        *data_pair,
        taken,
        order=order,
        lags=lags,
        method=method,
        feedthrough=feedthrough,
        warnings=warnings,
        on_progress=on_progress,
        records_are_complete=prior is None,
    )
    if stable:
        found = replace(found, system=_stable(found))
    model = to_model(found.system, found.units, data.dt_s, channel_names(taken[0]), provenance_of(method, found.candidate, shifts))
    if differential is not None:
        model = differential.model(model, found.candidate.constants * data.units.shift[:2])
    if any(shifts):
        model = with_delays(model, shifts)
    return Identified(
        model=model,
        found=found,
        method=method,
        fitted=fitted,
        judged=judged,
        shifts=shifts,
        started=started,
        gram=found.fitting.data if differential is None else data,
        differential=differential,
    )


def _differential_input(
    moved: Sequence[InputOutputRecord], data: Gram, lags: int | None, feedthrough: bool | None
) -> DifferentialInput | None:
    check_independent(data, channel_names(moved[0]))
    return find_differential_input(moved, data, lags, feedthrough)


def _stable(found: FittedSystem) -> Affine:
    system = stabilised(found.system)
    if system is found.system:
        return system
    constants = found.candidate.constants
    system = with_inputs_again(system, found.fitting.experiments(constants=constants), found.fitting.fixed)
    return found.fitting.with_gain(system, constants=constants)


def _dead_time(
    records: Sequence[InputOutputRecord],
    delays: Sequence[int] | str | None,
    lags: int | None,
    order: int | None,
    feedthrough: bool | None,
    units: Units,
) -> list[int]:
    """Return the shift of each input in samples."""
    m = records[0].u.shape[1]
    if delays is None:
        return [0] * m
    if not isinstance(delays, str):
        without_delays(records, delays)
        return [int(delay) for delay in delays]
    if delays != "auto":
        raise SettingsError(f"delays is '{delays}'; give auto, or one number per input")
    data, _ = gram_with_half(records, lags, order, "gram", units)
    used, has_d = choose_structure(data, lags, feedthrough)
    # Without feedthrough the model itself contains a delay of one sample.
    return [max(0, d - 1) for d in input_delays(observer_markov(data, used, feedthrough=has_d))]


def _split(
    records: list[InputOutputRecord], validation: float | InputOutputRecord | None
) -> tuple[list[InputOutputRecord], list[InputOutputRecord]]:
    if validation is None:
        return records, records
    if isinstance(validation, InputOutputRecord):
        check_alike([records[0], validation])
        _check_judged([validation])
        return records, [validation]
    if not 0.0 < validation < 1.0:
        raise SettingsError(f"the validation share is {validation}; it must lie between 0 and 1")
    cuts = [round(len(record) * (1.0 - validation)) for record in records]
    judged = [validate.part(record, cut, len(record)) for record, cut in zip(records, cuts, strict=True)]
    _check_judged(judged)
    return [validate.part(record, 0, cut) for record, cut in zip(records, cuts, strict=True)], judged


def _check_judged(judged: Sequence[InputOutputRecord]) -> None:
    fewest = min(whole_samples(record) for record in judged)
    if fewest < VALIDATION_SAMPLES_MIN:
        raise PoorExcitation(
            f"a validation part has {fewest} complete samples; at least {VALIDATION_SAMPLES_MIN} are needed: enlarge it"
        )


def _check_options(
    records: Sequence[InputOutputRecord],
    method: str,
    solver: str,
    order: int | None,
    lags: int | None,
    forgetting: float,
    prior: Gram | None,
) -> None:
    if not records:
        raise SettingsError("identify needs at least one record")
    for name, value, allowed in (("method", method, METHODS), ("solver", solver, SOLVERS)):
        if value not in allowed:
            raise SettingsError(f"{name} is '{value}'; allowed: {', '.join(allowed)}")
    check_integers(order=order, lags=lags)
    if not 0.0 < forgetting <= 1.0:
        raise SettingsError(f"forgetting is {forgetting}; it must be above 0 and at most 1")
    if prior is None and forgetting < 1.0:
        raise SettingsError("forgetting has no effect without earlier data; give a prior")
    if prior is not None:
        _check_prior(prior, records[0], method, lags)


def _check_prior(prior: Gram, record: InputOutputRecord, method: str, lags: int | None) -> None:
    if lags is not None and lags > prior.lags:
        raise SettingsError(f"lags is {lags}; the prior has {prior.lags}")
    if method in ("best", "deconvolution"):
        raise SettingsError(f"method '{method}' needs all samples; with a prior give okid-era, era-dc or pbsid")
    if prior.units.input_count != record.u.shape[1] or len(prior.units.scale) != record.u.shape[1] + record.y.shape[1]:
        raise SettingsError(
            f"the prior has {prior.units.input_count} inputs of {len(prior.units.scale)} channels, the record "
            f"{record.u.shape[1]} of {record.u.shape[1] + record.y.shape[1]}"
        )
    if prior.names and prior.names != channel_names(record):
        raise SettingsError(f"the prior has channels {', '.join(prior.names)}; the record has {', '.join(channel_names(record))}")
    if abs(prior.dt_s - record.dt_s) > 1e-9 * prior.dt_s:
        raise SettingsError(f"the prior's period is {prior.dt_s:g} s, the record's {record.dt_s:g} s")
