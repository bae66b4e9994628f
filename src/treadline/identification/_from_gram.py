"""Model from a Gram matrix: choice of lags, order and method; shared by ``identify`` and ``identify_chunks``.

Paper: Section IV.B. OKID → singular values → order → ERA, PBSID or the ensemble. Also in single steps: ``okid`` followed by
``era``; or ``pbsid``.

>>> observer = okid(record, lags=20)
>>> A, B, C, D = era(system_markov(observer, 41), order=2)
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._affine import to_model
from treadline.identification._checks import (
    channel_names,
    check_alike,
    check_excitation,
    check_independent,
    check_integers,
    units_of_moving,
)
from treadline.identification._deconvolution import observer_of
from treadline.identification._ensemble import candidates_of, ensemble
from treadline.identification._fitting import Evidence, FittedSystem, Fitting
from treadline.identification._gram import Gram, Units, gram_of
from treadline.identification._model_order import (
    OrderChoice,
    bic_order,
    choose_structure,
    no_system,
    noise_level,
    settle_order,
    structural_order,
)
from treadline.identification._okid import ObserverMarkov, observer_markov, regression, scaled_observer
from treadline.identification._realisation import BLOCKS_LEAST, StateMap, markov_svd, realised, state_map
from treadline.identification._realisation import pbsid as realised_by_pbsid
from treadline.identification._refine import cost
from treadline.identification._threads import one_thread
from treadline.identification.options import IdentificationOptions, max_supported_lags

EXACT_RUN = 1e-6
"""Squared free-run error relative to the variance below which data count as free of noise: a thousandth of the deviation."""


def data_of(records: Sequence[InputOutputRecord], options: IdentificationOptions, units: Units) -> Gram:
    """Return the Gram matrix of the records, with as many lags as they support; added to a prior, in its units and lags."""
    prior, solver = options.prior, options.solver
    if prior is not None:
        new = gram_of(records, prior.lags, prior.units, solver=solver)
        return prior.forgotten(options.forgetting ** sum(len(record) for record in records)) + new
    most = max_supported_lags(records, options.lags, options.largest_order, penalised=options.method == "best")
    return replace(gram_of(records, most, units, solver=solver), names=channel_names(records[0]))


def from_gram(
    data: Gram,
    records: Sequence[InputOutputRecord],
    options: IdentificationOptions,
    *,
    method: str,
    warnings: Sequence[str] = (),
    on_progress: Callable[[str], None] = lambda _: None,
    records_are_complete: bool = True,
) -> FittedSystem:
    """Return the model identified from a Gram matrix.

    Args:
        data: Gram matrix of all data.
        records: Samples for the steps that need them.
        options: Order, lags and feedthrough; the data decide what is left out.
        method: Name of the method, settled by the caller.
        warnings: Warnings about the data so far; the result has these and its own.
        on_progress: Called with a line of text per prior of the ensemble.
        records_are_complete: Whether the records hold all data, so that a Gram matrix with fewer lags can be built from them.
    """
    order, allowed, collected = options.given_order, options.allowed_orders, list(warnings)
    if method == "deconvolution":
        return _by_deconvolution(data, records, options, collected)
    check_independent(data, channel_names(records[0]))
    used, has_d = choose_structure(data, options.lags, options.feedthrough, is_model=method == "okid-era")
    if records_are_complete and data.dropped and used < data.lags and method != "best":
        # Windows with fewer lags overlap fewer gaps, so the Gram matrix is rebuilt.
        data = data_of(records, replace(options, lags=used), data.units)
    if order is not None or allowed is not None:
        check_excitation(data, order or min(allowed or [1]))
    fitting = Fitting(data=data, records=records, feedthrough=has_d)
    evidence = _evidence_of(fitting, used, options)
    if method == "best":
        exact = _exact(fitting, evidence, options, collected) if evidence.structural is None else None
        found = exact or _by_ensemble(fitting, evidence, allowed if order is None else [order], collected, on_progress)
    else:
        found = (_by_pbsid if method == "pbsid" else _by_okid)(fitting, evidence, options, collected)
    if data.dropped:
        collected.append(f"{data.dropped} windows with a NaN were left out, {data.count:.0f} are used")
    return found


def _evidence_of(fitting: Fitting, lags: int, options: IdentificationOptions) -> Evidence:
    observer = scaled_observer(fitting.data, lags, feedthrough=fitting.feedthrough)
    svd = markov_svd(observer, options.largest_order)
    noise = noise_level(observer, svd) if options.given_order is None else None
    return Evidence(lags=lags, observer=observer, svd=svd, structural=structural_order(observer), noise=noise)


def _by_ensemble(
    fitting: Fitting, evidence: Evidence, orders: Sequence[int] | None, warnings: list[str], on_progress: Callable[[str], None]
) -> FittedSystem:
    """Return the model made of the ensemble's medoid."""
    found = ensemble(fitting, orders, on_progress)
    warnings += no_system(evidence.svd.s, evidence.noise or 0.0)
    names = channel_names(fitting.records[0])[fitting.data.units.input_count :]
    for name, explained in zip(names, found.explained, strict=True):
        if not explained:
            warnings.append(
                f"the inputs explain no more of '{name}' than chance does: the model predicts its mean; move the inputs more"
            )
    return FittedSystem(
        fitting=fitting,
        evidence=evidence,
        subspace="pbsid",
        lags=fitting.data.lags,
        order=found.selection.chosen.order,
        system=fitting.with_gain(found.system),
        step=found.step,
        candidates=candidates_of(found.selection),
        warnings=warnings,
    )


def _exact(fitting: Fitting, evidence: Evidence, options: IdentificationOptions, warnings: list[str]) -> FittedSystem | None:
    """Return the OKID/ERA model of data without noise; None if its free run does not repeat them.

    An observer predicts smooth data a step ahead almost without error, whatever its model is worth.
    """
    found = _by_okid(fitting, evidence, options, warnings)
    experiments = fitting.experiments
    values = sum(int(item.there.sum()) * item.y.shape[1] for item in experiments)
    return found if cost(found.system, experiments) < EXACT_RUN * values else None


def _order(evidence: Evidence, options: IdentificationOptions, warnings: list[str]) -> OrderChoice:
    return settle_order(evidence.svd.s[: evidence.structural], evidence.noise or 0.0, warnings, options.allowed_orders)


def _by_okid(fitting: Fitting, evidence: Evidence, options: IdentificationOptions, warnings: list[str]) -> FittedSystem:
    """Return the model by OKID and ERA."""
    order = options.given_order or _order(evidence, options, warnings).order
    system = realised(evidence.observer, evidence.svd, order)
    if options.lags is None and evidence.structural is not None:
        # An observer with few lags restricts its gain, so the innovation gain is refitted separately.
        system = fitting.with_gain(system)
    return FittedSystem(
        fitting=fitting, evidence=evidence, subspace="okid-era", lags=evidence.lags, order=order, system=system, warnings=warnings
    )


def _by_pbsid(fitting: Fitting, evidence: Evidence, options: IdentificationOptions, warnings: list[str]) -> FittedSystem:
    """Return the model by PBSID; of open orders the one of smallest BIC, for data without noise that of the largest gap."""
    data, has_d = fitting.data, fitting.feedthrough

    def mapped(order: int) -> tuple[int, StateMap]:
        lags = min(max(evidence.lags, BLOCKS_LEAST, order), data.lags) if options.lags is None else evidence.lags
        return lags, state_map(data, lags, regression(data, lags, feedthrough=has_d).theta)

    choice = None if options.given_order else _order(evidence, options, warnings)
    order = choice.order if choice else options.given_order or 1
    lags, states = mapped(order)
    if choice is not None and evidence.structural is not None:
        order = bic_order(data, states, lags, feedthrough=has_d, allowed=options.allowed_orders)
        if order != choice.order:
            gap = f"the largest gap of the singular values, {choice.gap:.1f}, is at order {choice.order}"
            warnings.append(f"order {order} by BIC; {gap}")
            lags, states = mapped(max(order, lags))
    system = realised_by_pbsid(data, states, order, lags, feedthrough=has_d)
    if not system.predictor().radius < 1.0:
        system = fitting.with_gain(system)
    return FittedSystem(
        fitting=fitting, evidence=evidence, subspace="pbsid", lags=lags, order=order, system=system, warnings=warnings
    )


def _by_deconvolution(
    data: Gram, records: Sequence[InputOutputRecord], options: IdentificationOptions, warnings: list[str]
) -> FittedSystem:
    """Return the ERA model of the impulse response by Eq. (9c)."""
    data = replace(data, units=replace(data.units, shift=np.zeros_like(data.units.shift)))
    observer, svd = observer_of(records, data.units)
    evidence = Evidence(lags=0, observer=observer, svd=svd, structural=None, noise=None)
    order = options.given_order or _order(evidence, options, warnings).order
    return FittedSystem(
        fitting=Fitting(data=data, records=records, feedthrough=True),
        evidence=evidence,
        subspace="deconvolution",
        lags=0,
        order=order,
        system=realised(observer, svd, order),
        warnings=warnings,
    )


@one_thread()
def okid(
    records: InputOutputRecord | Sequence[InputOutputRecord], *, lags: int, feedthrough: bool = True, solver: str = "gram"
) -> ObserverMarkov:
    """Return the observer's Markov parameters for one or more experiments by least squares.

    Paper: Eq. (9a), (9b).

    Raises:
        RecordError: If the data do not support as many lags.
        SettingsError: If lags is not an integer, at least 1.
    """
    return observer_markov(_sums(records, lags, None, solver), feedthrough=feedthrough)


@one_thread()
def pbsid(
    records: InputOutputRecord | Sequence[InputOutputRecord],
    *,
    order: int,
    lags: int = 10,
    feedthrough: bool = True,
    solver: str = "gram",
) -> LinearModel:
    """Return the model of an order by PBSID_opt (Chiuso, 2007).

    Raises:
        RecordError: If the data do not support as many lags or states.
        SettingsError: If order or lags is not an integer, at least 1.
    """
    data = _sums(records, lags, order, solver)
    states = state_map(data, lags, regression(data, lags, feedthrough=feedthrough).theta)
    found = realised_by_pbsid(data, states, order, lags, feedthrough=feedthrough)
    first = records if isinstance(records, InputOutputRecord) else records[0]
    return to_model(found, data.units, data.dt_s, channel_names(first))


def _sums(records: InputOutputRecord | Sequence[InputOutputRecord], lags: int, order: int | None, solver: str) -> Gram:
    check_integers(order=order, lags=lags)
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    check_alike(given)
    return gram_of(given, max_supported_lags(given, lags, order), units_of_moving(given), solver=solver)
