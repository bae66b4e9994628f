"""Model from a Gram matrix: choice of lags, order and method; shared by ``identify`` and ``identify_chunks``.

Paper: Section IV.B. OKID → singular values → order → ERA, PBSID or cross-validation. Also in single steps: ``okid`` followed by
``era``; or ``pbsid``.

>>> observer = okid(record, lags=20)
>>> A, B, C, D = era(system_markov(observer, 41), order=2)
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from treadline.core.errors import PoorExcitation
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._affine import Affine, to_model
from treadline.identification._checks import channel_names, check_excitation, check_independent, check_integers, check_records
from treadline.identification._deconvolution import observer_of
from treadline.identification._era import HankelSvd
from treadline.identification._fitting import Candidate, Fitting
from treadline.identification._gram import Gram, GramBuilder, Units, gram_of
from treadline.identification._identified import Evidence, FittedSystem
from treadline.identification._model_order import (
    OrderChoice,
    choose_structure,
    gap_at,
    gap_of,
    noise_level,
    settle_order,
    stands_out,
    structural_order,
)
from treadline.identification._model_selection import select_model
from treadline.identification._okid import ObserverMarkov, observer_markov, scaled_observer
from treadline.identification._realisation import pbsid as realised_by_pbsid
from treadline.identification._realisation import realised, state_map
from treadline.identification._threads import one_thread
from treadline.identification.options import IdentificationOptions, max_supported_lags

OBSERVERS = ("okid-era", "era-dc")
"""Methods whose model is a realisation of the OKID observer."""
CLEARLY_SEPARATED_GAP = 10.0
"""Ratio of singular values above which the order is clear enough to limit the search to its neighbours."""
PBSID_LAGS = 10
"""Smallest default number of lags for PBSID, which needs enough past to reconstruct the state."""


def provenance_of(method: str, candidate: Candidate) -> dict[str, str | float]:
    """Return the provenance entries of a model: method, order, lags and last step."""
    return {"method": method, "order": candidate.order, "lags": candidate.lags, "step": candidate.step}


def gram_with_half(records: Sequence[InputOutputRecord], options: IdentificationOptions, units: Units) -> tuple[Gram, Gram | None]:
    """Return the Gram matrix of all records and, for an open order, the Gram matrix of their first halves."""
    prior, solver = options.prior, options.solver
    if prior is not None:
        new = gram_of(records, prior.lags, prior.units, solver=solver)
        return prior.forgotten(options.forgetting ** sum(len(record) for record in records)) + new, None
    most, names = max_supported_lags(records, options.lags, options.order), channel_names(records[0])
    if options.order is not None:
        return replace(gram_of(records, most, units, solver=solver), names=names), None
    builder = GramBuilder(most, units, records[0].dt_s, solver=solver)
    marks = []
    for record in records:
        builder.begin()
        middle = len(record) // 2
        builder.add(record.u[:middle], record.y[:middle])
        before = builder.finish()
        builder.add(record.u[middle:], record.y[middle:])
        marks.append((before, builder.finish()))
    whole = replace(marks[-1][1], names=names)
    # Difference of the Gram matrices at the middle and at the beginning of each record.
    first = marks[0][0]
    for (half, _), (_, earlier) in zip(marks[1:], marks, strict=False):
        first = first + (half - earlier)
    return whole, first


def from_gram(
    data: Gram,
    half: Gram | None,
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
        half: Gram matrix of about half of the data, for the noise floor of the singular values; None for a given order.
        records: Samples for the steps that need them.
        options: Order, lags and feedthrough; the data decide what is left out.
        method: Name of the method, settled by the caller.
        warnings: Warnings about the data so far; the result has these and its own.
        on_progress: Called with a line of text per scored candidate.
        records_are_complete: Whether the records hold all data, so that a Gram matrix with fewer lags can be built from them.
    """
    order, collected = options.order, list(warnings)
    if method == "deconvolution":
        return _by_deconvolution(Fitting(data=data, records=records, feedthrough=True), order, collected)
    check_independent(data, channel_names(records[0]))
    used, has_d = choose_structure(data, options.lags, options.feedthrough, is_model=method in OBSERVERS)
    if records_are_complete and data.dropped and used < data.lags and method != "best":
        # Windows with fewer lags overlap fewer gaps, so the Gram matrix is rebuilt.
        data, half = gram_with_half(records, replace(options, lags=used), data.units)
    if order is not None:
        check_excitation(data, order)
    fitting = Fitting(data=data, records=records, feedthrough=has_d)
    evidence = _evidence_of(fitting, half, used, order, collected)
    if method == "best" and evidence.structural is not None:
        names = channel_names(records[0]) if options.name_prior else ()
        found = _by_cross_validation(fitting, evidence, order, collected, names, on_progress)
    else:
        # Without noise no selection is needed: OKID/ERA is exact.
        found = _by_method(fitting, evidence, "okid-era" if method == "best" else method, options, collected)
    if data.dropped:
        collected.append(f"{data.dropped} windows with a NaN were left out, {data.count:.0f} are used")
    return found


def _evidence_of(fitting: Fitting, half: Gram | None, lags: int, order: int | None, warnings: list[str]) -> Evidence:
    observer, svd = fitting.observer(lags, order)
    structural = structural_order(observer)
    noise = None
    if order is None and half is not None:
        noise = noise_level(scaled_observer(half, lags, feedthrough=fitting.feedthrough), observer, svd)
    choice = settle_order(svd, order, structural, noise or 0.0, warnings)
    return Evidence(lags=lags, observer=observer, svd=svd, structural=structural, noise=noise, choice=choice)


def _by_cross_validation(
    fitting: Fitting,
    evidence: Evidence,
    order: int | None,
    warnings: list[str],
    names: Sequence[str],
    on_progress: Callable[[str], None],
) -> FittedSystem:
    """Return the model selected by cross-validation."""
    order_is_clear = _is_clearly_separated(evidence.choice, evidence.svd)
    chosen = select_model(
        fitting,
        lags=evidence.lags,
        order=order,
        suggested_order=evidence.choice.order,
        order_is_clear=order_is_clear,
        names=names,
        on_progress=on_progress,
    )
    candidate = chosen.candidate
    if stands_out(evidence.svd.s, evidence.noise or 0.0):
        warnings.clear()  # cross-validation replaces the order rule of the singular values
    # Report the observer of the selected lags; the noise level is valid only for the lags it was computed with.
    observer, svd = fitting.observer(candidate.lags, candidate.order)
    noise = evidence.noise if candidate.lags == evidence.lags else None
    choice = OrderChoice(order=candidate.order, gap=gap_at(svd.s[: structural_order(observer)], candidate.order), clear=True)
    reported = replace(evidence, observer=observer, svd=svd, noise=noise, choice=choice)
    units = fitting.units(constants=candidate.constants)
    return FittedSystem(
        candidate=candidate,
        system=chosen.system,
        units=units,
        fitting=fitting,
        evidence=reported,
        scores=chosen.scores,
        warnings=warnings,
    )


def _by_method(
    fitting: Fitting, evidence: Evidence, method: str, options: IdentificationOptions, warnings: list[str]
) -> FittedSystem:
    """Return the model by a single named method."""
    choice, used = evidence.choice, evidence.lags
    if method == "pbsid" and options.lags is None:
        used = min(max(used, PBSID_LAGS, choice.order), fitting.data.lags)
    candidate = Candidate(method=method, lags=used, order=choice.order)
    if (
        options.order is None
        and candidate.method == "pbsid"
        and evidence.structural is not None
        and not _is_clearly_separated(choice, evidence.svd)
    ):
        choice = _order_by_bic(fitting, evidence.svd, choice, candidate.lags, warnings)
        candidate = replace(candidate, order=choice.order)
    system = _model_or_raise(fitting, candidate)
    if options.lags is None and candidate.method != "pbsid" and evidence.structural is not None:
        # An observer with few lags restricts its gain, so the innovation gain is refitted separately.
        system = fitting.with_gain(system)
    evidence = replace(evidence, choice=choice)
    return FittedSystem(
        candidate=candidate, system=system, units=fitting.units(), fitting=fitting, evidence=evidence, warnings=warnings
    )


def _by_deconvolution(fitting: Fitting, order: int | None, warnings: list[str]) -> FittedSystem:
    """Return the ERA model of the impulse response by Eq. (9c)."""
    units = fitting.units(constants=False)
    observer, svd = observer_of(fitting.records, units)
    choice = settle_order(svd, order, None, 0.0, warnings)
    return FittedSystem(
        candidate=Candidate(method="deconvolution", lags=0, order=choice.order),
        system=realised(observer, svd, choice.order),
        units=units,
        fitting=fitting,
        evidence=Evidence(lags=0, observer=observer, svd=svd, structural=None, noise=None, choice=choice),
        warnings=warnings,
    )


def _model_or_raise(fitting: Fitting, candidate: Candidate) -> Affine:
    system = fitting.model(candidate)
    if system is None:
        raise fitting.observer(candidate.lags, candidate.order)[1].refusal(candidate.order)
    return system


def _order_by_bic(fitting: Fitting, svd: HankelSvd, choice: OrderChoice, lags: int, warnings: list[str]) -> OrderChoice:
    """Return the order with the smallest BIC, for singular values without a clear gap."""
    order = fitting.bic_order(lags)
    if order != choice.order:
        gap = f"the largest gap of the singular values, {choice.gap:.1f}, is at order {choice.order}"
        warnings.append(f"order {order} by BIC; {gap}")
    return OrderChoice(order=order, gap=gap_at(svd.s, order), clear=False)


def _is_clearly_separated(choice: OrderChoice, svd: HankelSvd) -> bool:
    return choice.clear and gap_of(choice, svd) > CLEARLY_SEPARATED_GAP


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
    states = state_map(data, lags, feedthrough=feedthrough)
    if order > len(states.s):
        raise PoorExcitation(f"order {order} is above the rank {len(states.s)} that {lags} lags show; ask for less")
    found = realised_by_pbsid(data, states, order, lags, feedthrough=feedthrough)
    first = records if isinstance(records, InputOutputRecord) else records[0]
    return to_model(found, data.units, data.dt_s, channel_names(first))


def _sums(records: InputOutputRecord | Sequence[InputOutputRecord], lags: int, order: int | None, solver: str) -> Gram:
    check_integers(order=order, lags=lags)
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    units = check_records(given)
    return gram_of(given, max_supported_lags(given, lags, order), units, solver=solver)
