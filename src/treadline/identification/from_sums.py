"""Sums in, a model out: which lags, which order, which way; ``identify`` and ``identify_stream`` end here.

Paper: Section IV.B. OKID → singular values → order → ERA, PBSID or whatever data held out prefer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from treadline.identification.affine import Affine
from treadline.identification.best import Trial, best
from treadline.identification.checks import channel_names, check_excitation, check_independent
from treadline.identification.deconvolution import observer_of
from treadline.identification.era import HankelSvd
from treadline.identification.fitting import Fitting, Recipe
from treadline.identification.gram import Gram, GramBuilder, Units, gram_of
from treadline.identification.identified import Found
from treadline.identification.okid import ObserverMarkov, scaled_observer
from treadline.identification.order import OrderChoice, gap_at, stands_out
from treadline.identification.realisation import realised
from treadline.identification.structure import choose_structure, gap_of, noise_level, settle_order, structural_order
from treadline.identification.windows import carried_lags
from treadline.models import InputOutputRecord

OBSERVERS = ("okid-era", "era-dc")
"""Methods whose model is the observer's own."""
SURE_GAP = 10.0
"""Ratio of singular values from which a clear order is beyond doubt: the search stays near it."""
PBSID_LAGS = 10
"""Fewest lags of PBSID where they are not given: its states are seen through them."""


def made_by(method: str, recipe: Recipe, shifts: Sequence[int] = ()) -> dict[str, str | float]:
    """Return what a model was made by."""
    return {"method": method, "order": recipe.order + sum(shifts), "lags": recipe.lags, "step": recipe.step}


def sums_of(
    records: Sequence[InputOutputRecord],
    lags: int | None,
    order: int | None,
    solver: str,
    units: Units,
    prior: Gram | None = None,
    forgetting: float = 1.0,
) -> tuple[Gram, Gram | None]:
    """Return the sums of all records, and where the order is open those of their first halves."""
    if prior is not None:
        new = gram_of(records, prior.lags, prior.units, solver=solver)
        return prior.forgotten(forgetting ** sum(len(record) for record in records)) + new, None
    most, names = carried_lags(records, lags, order), channel_names(records[0])
    if order is not None:
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
    # What stood at each middle, less what stood before that record.
    first = marks[0][0]
    for (half, _), (_, earlier) in zip(marks[1:], marks, strict=False):
        first = first + (half - earlier)
    return whole, first


def from_sums(
    data: Gram,
    half: Gram | None,
    records: Sequence[InputOutputRecord],
    *,
    order: int | None,
    lags: int | None,
    method: str,
    feedthrough: bool | None,
    warnings: list[str],
    told: Callable[[str], None] = lambda _: None,
    again: bool = True,
) -> Found:
    """Return the model of some data.

    Args:
        data: Their sums.
        half: The sums of about half of them, for the noise's singular values; None where the order is given.
        records: Samples for the steps that need them.
        warnings: Takes what a user should know.
        told: Is told what ``best`` tries.
        again: Whether the records are all of the data, so that sums of fewer lags can be made of them.
    """
    if method == "deconvolution":
        return _printed(Fitting(data=data, records=records, feedthrough=True), order, warnings)
    check_independent(data, channel_names(records[0]))
    used, has_d = choose_structure(data, lags, feedthrough, is_model=method in OBSERVERS)
    if again and data.dropped and used < data.lags and method != "best":
        # Fewer lags look back on fewer gaps: the data again.
        data, half = sums_of(records, used, order, "gram" if data.root is None else "qr", data.units)
    if order is not None:
        check_excitation(data, order)
    fitting = Fitting(data=data, records=records, feedthrough=has_d)
    seen = _seen(fitting, half, used, order, warnings)
    if method == "best" and seen.structural is not None:
        found = _by_best(fitting, seen, order, warnings, told)
    else:
        # Without noise there is nothing to choose: OKID/ERA is exact.
        found = _by_name(fitting, seen, "okid-era" if method == "best" else method, lags, order, warnings)
    if data.dropped:
        warnings.append(f"{data.dropped} windows with a NaN were left out, {data.count:.0f} are used")
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What the sums show before any model is made."""

    lags: int
    observer: ObserverMarkov
    svd: HankelSvd
    structural: int | None
    """Order that the structure allows at most, None where the data have no noise."""
    noise: float | None
    """Largest singular value that noise alone makes; None where the order was given."""
    choice: OrderChoice


def _seen(fitting: Fitting, half: Gram | None, lags: int, order: int | None, warnings: list[str]) -> _Seen:
    observer, svd = fitting.observer(lags, order)
    structural = structural_order(observer)
    noise = None
    if order is None and half is not None:
        noise = noise_level(scaled_observer(half, lags, feedthrough=fitting.feedthrough), observer, svd)
    choice = settle_order(svd, order, structural, noise or 0.0, warnings)
    return _Seen(lags=lags, observer=observer, svd=svd, structural=structural, noise=noise, choice=choice)


def _by_best(fitting: Fitting, seen: _Seen, order: int | None, warnings: list[str], told: Callable[[str], None]) -> Found:
    """Return what data held out prefer."""
    names, sure = channel_names(fitting.records[0]), _sure(seen.choice, seen.svd)
    chosen = best(fitting, lags=seen.lags, order=order, guess=seen.choice.order, sure=sure, names=names, told=told)
    recipe = chosen.recipe
    if stands_out(seen.svd.s, seen.noise or 0.0):
        warnings.clear()  # the singular values' doubt is settled by data held out
    # What is reported is of the lags that were taken; the noise was seen with others, unless they are the same.
    observer, svd = fitting.observer(recipe.lags, recipe.order)
    noise = seen.noise if recipe.lags == seen.lags else None
    choice = OrderChoice(order=recipe.order, gap=gap_at(svd.s[: structural_order(observer)], recipe.order), clear=True)
    told_of = replace(seen, observer=observer, svd=svd, noise=noise, choice=choice)
    return _found(fitting, recipe, chosen.system, told_of, warnings, chosen.trials)


def _by_name(fitting: Fitting, seen: _Seen, method: str, lags: int | None, order: int | None, warnings: list[str]) -> Found:
    """Return what one method makes of the sums."""
    choice, recipe = seen.choice, _recipe(method, seen.lags, lags, seen.choice.order, fitting.data)
    if order is None and recipe.method == "pbsid" and seen.structural is not None and not _sure(choice, seen.svd):
        choice = _by_schwarz(fitting, seen.svd, choice, recipe.lags, warnings)
        recipe = replace(recipe, order=choice.order)
    system = _asked(fitting, recipe)
    if lags is None and recipe.method != "pbsid" and seen.structural is not None:
        # An observer of few lags answers noise as those few lags let it: its gain is fitted for itself.
        system = fitting.with_gain(system)
    return _found(fitting, recipe, system, replace(seen, choice=choice), warnings)


def _found(
    fitting: Fitting, recipe: Recipe, system: Affine, seen: _Seen, warnings: list[str], trials: Sequence[Trial] = ()
) -> Found:
    return Found(
        recipe=recipe,
        system=system,
        units=fitting.units(constants=recipe.constants),
        fitting=fitting,
        observer=seen.observer,
        svd=seen.svd,
        choice=seen.choice,
        noise=seen.noise,
        trials=trials,
        warnings=warnings,
    )


def _printed(fitting: Fitting, order: int | None, warnings: list[str]) -> Found:
    """Return the model that ERA makes of Eq. (9c)'s impulse response."""
    units = fitting.units(constants=False)
    observer, svd = observer_of(fitting.records, units)
    choice = settle_order(svd, order, None, 0.0, warnings)
    return Found(
        recipe=Recipe(method="deconvolution", lags=0, order=choice.order),
        system=realised(observer, svd, choice.order),
        units=units,
        fitting=fitting,
        observer=observer,
        svd=svd,
        choice=choice,
        noise=None,
        trials=[],
        warnings=warnings,
    )


def _recipe(method: str, used: int, lags: int | None, order: int, data: Gram) -> Recipe:
    if method == "pbsid" and lags is None:
        used = min(max(used, PBSID_LAGS, order), data.lags)
    return Recipe(method=method, lags=used, order=order)


def _asked(fitting: Fitting, recipe: Recipe) -> Affine:
    system = fitting.model(recipe)
    if system is None:
        raise fitting.observer(recipe.lags, recipe.order)[1].refusal(recipe.order)
    return system


def _by_schwarz(fitting: Fitting, svd: HankelSvd, choice: OrderChoice, lags: int, warnings: list[str]) -> OrderChoice:
    """Return the order that Schwarz's criterion takes where the gap leaves doubt."""
    order = fitting.schwarz_order(lags)
    if order != choice.order:
        gap = f"the largest gap of the singular values, {choice.gap:.1f}, is at order {choice.order}"
        warnings.append(f"order {order} by Schwarz's criterion; {gap}")
    return OrderChoice(order=order, gap=gap_at(svd.s, order), clear=False)


def _sure(choice: OrderChoice, svd: HankelSvd) -> bool:
    return choice.clear and gap_of(choice, svd) > SURE_GAP
