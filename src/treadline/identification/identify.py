"""Identification of a linear model from records (Section IV): the main entry point.

Paper: Section IV, VI.B. Check → dead time → Gram matrix → OKID and ERA, PBSID or the ensemble → report.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from treadline.core import linear_systems
from treadline.core.errors import DependentInputs, PoorExcitation, SettingsError
from treadline.core.model_scores import TESTED_SAMPLES_MIN
from treadline.core.models import InputOutputRecord
from treadline.identification._checks import channel_names, check_alike, check_independent, units_of_moving, whole_samples
from treadline.identification._dead_time import dead_time, without_delays
from treadline.identification._drive_log import DriveLog, find_differential_input, without_dependent_inputs
from treadline.identification._from_gram import data_of, from_gram
from treadline.identification._gram import Gram, gram_of, units_of
from treadline.identification._identified import Identified
from treadline.identification._threads import one_thread
from treadline.identification.options import DEFAULT_OPTIONS, IdentificationOptions


@one_thread()
def identify(
    records: InputOutputRecord | Sequence[InputOutputRecord],
    options: IdentificationOptions = DEFAULT_OPTIONS,
    *,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Identified:
    """Return the linear model that fits one or more experiments.

    Args:
        records: Experiments with the same channels and period, treated as separate experiments.
        options: Order, lags, method and further choices; the data decide what is left out.
        on_progress: Called with a line of text per prior of the ensemble of ``best``.

    Raises:
        RecordError: If the data do not support the request.
        SettingsError: If the prior has other channels than the records.
    """
    started = time.perf_counter()
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    if not given:
        raise SettingsError("identify needs at least one record")
    if options.prior is not None:
        _check_prior(options.prior, given[0])
    check_alike(given)
    try:
        return _identified(DriveLog(records=given), options, on_progress, started)
    except DependentInputs:
        log = without_dependent_inputs(given, name_prior=options.name_prior)
        if log is None or options.prior is not None:
            raise
    return _identified(log, options, on_progress, started)


def _identified(log: DriveLog, options: IdentificationOptions, on_progress: Callable[[str], None], started: float) -> Identified:
    """Return the model of a log; its inputs are independent, or two belts of which the difference is fitted."""
    method, belts = options.method or ("best" if options.prior is None else "pbsid"), log.differential
    options = replace(options, method=method)
    validation = log.other(options.validation) if isinstance(options.validation, InputOutputRecord) else options.validation
    fitted, judged = _split(log.records, validation)
    units = units_of_moving(fitted if belts is None else belts.difference(fitted))
    if belts is None and method == "best":
        # Before dead times, which would move inputs apart that are one.
        check_independent(gram_of(fitted, 1, units), channel_names(fitted[0]))
    one = belts is not None and options.delays is None  # belts that are one input have one dead time
    shifts = 2 * _dead_time(belts.difference(fitted), options, method) if belts and one else _dead_time(fitted, options, method)
    moved = without_delays(fitted, shifts) if any(shifts) else fitted
    used = moved if belts is None else belts.difference(moved)
    if any(shifts):
        units = units_of_moving(used)  # without the samples before the first input acts
    data = data_of(used, replace(options, lags=1) if method == "deconvolution" else options, units)
    gram, differential = data, belts
    if method == "best" and belts is None and options.name_prior:
        differential = find_differential_input(moved, data, options.lags, options.feedthrough)
        if differential is not None:
            used = differential.difference(moved)
            data = data_of(used, options, differential.units(used, data.units))
    found = from_gram(data, used, options, method=method, on_progress=on_progress, records_are_complete=options.prior is None)
    if options.stable:
        found = found.reflected()
    model = found.model(method, name_prior=options.name_prior)
    if differential is not None:
        model = differential.model(model, units_of(moved).shift[:2])
    result = Identified(
        free=replace(model, input_delay=tuple(shifts)),
        found=found,
        method=method,
        fitted=fitted,
        judged=judged,
        seconds=time.perf_counter() - started,
        gram=found.fitting.data if gram is data else gram,
        differential=differential,
        log=log,
        name_prior=options.name_prior,
        again=None if options.prior is not None else partial(_anew, log.records, options),
    )
    by_data = options.order is None and options.delays is None and not options.stable
    return result.with_structure() if method == "best" and by_data else result


def _anew(records: list[InputOutputRecord], options: IdentificationOptions, **changes: Any) -> Identified:
    """Return the identification of records with some options changed."""
    return identify(records, replace(options, **changes))


def _dead_time(records: Sequence[InputOutputRecord], options: IdentificationOptions, method: str) -> list[int]:
    """Return the dead time of each input in samples: given, or found with ``best``; the other methods model it by states."""
    inputs = records[0].u.shape[1]
    if options.delays is None:
        return dead_time(records) if method == "best" else [0] * inputs
    delays = [options.delays] * inputs if isinstance(options.delays, int) else list(options.delays)
    without_delays(records, delays)
    return [int(delay) for delay in delays]


def _split(
    records: list[InputOutputRecord], validation: float | InputOutputRecord | None
) -> tuple[list[InputOutputRecord], list[InputOutputRecord]]:
    if validation is None:
        return records, records
    if isinstance(validation, InputOutputRecord):
        check_alike([records[0], validation])
        _check_judged([validation])
        return records, [validation]
    cuts = [round(len(record) * (1.0 - validation)) for record in records]
    judged = [linear_systems.part(record, cut, len(record)) for record, cut in zip(records, cuts, strict=True)]
    _check_judged(judged)
    return [linear_systems.part(record, 0, cut) for record, cut in zip(records, cuts, strict=True)], judged


def _check_judged(judged: Sequence[InputOutputRecord]) -> None:
    fewest = min(whole_samples(record) for record in judged)
    if fewest < TESTED_SAMPLES_MIN:
        raise PoorExcitation(
            f"a validation part has {fewest} complete samples; at least {TESTED_SAMPLES_MIN} are needed: enlarge it"
        )


def _check_prior(prior: Gram, record: InputOutputRecord) -> None:
    names, units = channel_names(record), prior.units
    has_other_names = prior.names not in ((), names)  # a fit of the belts' difference has one input
    if has_other_names or (units.input_count, len(units.scale)) != (record.u.shape[1], len(names)):
        its = ", ".join(prior.names) or f"{len(units.scale)} channels, {units.input_count} of them inputs"
        remedy = "identify from all logs without a prior"
        raise SettingsError(f"the prior has {its}; the record has {', '.join(names)}; {remedy}")
    if abs(prior.dt_s - record.dt_s) > 1e-9 * prior.dt_s:
        raise SettingsError(f"the prior's period is {prior.dt_s:g} s, the record's {record.dt_s:g} s")
