"""Options of an identification: what the data decide when an option is left out, and the allowed range of each option.

The data must support the number of lags: enough samples as windows without gaps, and enough windows per coefficient.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TypedDict

import numpy as np

from treadline.core.errors import SettingsError, TooFewSamples
from treadline.core.models import InputOutputRecord
from treadline.identification._checks import check_integers
from treadline.identification._gram import Gram
from treadline.identification._limits import LAGS_MOST, ROWS_LEAST, ROWS_PER_PARAMETER

METHODS = ("best", "okid-era", "pbsid", "deconvolution")
SOLVERS = ("gram", "qr")
NEED_SAMPLES = ("best", "deconvolution")
"""Methods that need all samples, and therefore cannot continue from a Gram matrix."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentificationOptions:
    """Options of an identification, checked when the object is made.

    Raises:
        SettingsError: If an option is unknown, out of range, or contradicts another option.

    Examples:
        >>> import treadline as tl
        >>> tl.IdentificationOptions(order=2, method="okid-era").lags is None
        True
    """

    order: int | Sequence[int] | None = None
    """Number of states, or the numbers to choose from: ``range(2, 9)``. Chosen, with ``best`` as that of the ensemble's medoid,
    with ``pbsid`` at the smallest BIC, otherwise at the largest gap of the singular values. Default: any."""
    lags: int | None = None
    """Observer lags p. Default: with ``best`` as many as the data support, up to 40, with ``pbsid`` at the smallest BIC, with
    ``okid-era`` at the smallest AICc."""
    method: str | None = None
    """Identification method. ``best`` takes the model nearest to the median of an ensemble; ``okid-era`` is the paper's method,
    ``pbsid`` the closed-loop subspace method, ``deconvolution`` Eq. (9c) as printed. Default: ``best``; with a prior, or for
    chunks, ``pbsid``."""
    feedthrough: bool | None = None
    """Whether an input acts within the same sample (D). Default: at the smallest BIC."""
    delays: Sequence[int] | int | None = None
    """Dead time of each input, or of all, in samples. Default: found with ``best``; with the other methods zero, and states model
    it."""
    solver: str = "gram"
    """Least-squares solver: ``gram`` for normal equations, or ``qr``: slower, accurate to rounding on noise-free data."""
    name_prior: bool = True
    """Whether the channels' names may decide what the data leave open: a left and a right belt turn a vehicle by their difference,
    and a heading is the integral of the yaw rate."""
    stable: bool = False
    """Whether to reflect poles outside the unit circle into it."""
    validation: float | InputOutputRecord | None = None
    """Share of each record, at its end, kept for validation, or a separate record. Default: the fitted data."""
    prior: Gram | None = None
    """Gram matrix of earlier data (``Identified.gram``) to continue from."""
    forgetting: float = 1.0
    """Weight factor on earlier data per new sample; 1 forgets nothing."""

    def __post_init__(self) -> None:
        for name, value, allowed in (("method", self.method, (None, *METHODS)), ("solver", self.solver, SOLVERS)):
            if value not in allowed:
                raise SettingsError(f"{name} is '{value}'; allowed: {', '.join(item for item in allowed if item)}")
        if isinstance(self.order, Sequence) and not isinstance(self.order, str):
            object.__setattr__(self, "order", self._orders(self.order))
        else:
            check_integers(order=self.order)
        check_integers(lags=self.lags)
        self._check_delays()
        if isinstance(self.validation, Real) and not 0.0 < self.validation < 1.0:
            raise SettingsError(f"the validation share is {self.validation}; it must lie between 0 and 1")
        if not 0.0 < self.forgetting <= 1.0:
            raise SettingsError(f"forgetting is {self.forgetting}; it must be above 0 and at most 1")
        if self.prior is None and self.forgetting < 1.0:
            raise SettingsError("forgetting has no effect without earlier data; give a prior")
        if self.prior is not None:
            self._check_prior(self.prior)

    @staticmethod
    def _orders(given: Sequence[int]) -> int | tuple[int, ...]:
        if not given:
            raise SettingsError("order is empty; give a number, or numbers to choose from: range(2, 9)")
        for order in given:
            check_integers(order=order)
        orders = tuple(sorted({int(order) for order in given}))
        return orders if len(orders) > 1 else orders[0]

    @property
    def given_order(self) -> int | None:
        """The order, if it is not to be chosen."""
        return None if self.order is None or isinstance(self.order, Sequence) else int(self.order)

    @property
    def allowed_orders(self) -> Sequence[int] | None:
        """Orders to choose from; None for a given order and for any."""
        return self.order if isinstance(self.order, Sequence) else None

    @property
    def largest_order(self) -> int | None:
        """Largest order that the lags have to support; None if any will do."""
        return max(self.order) if isinstance(self.order, Sequence) else self.order

    def _check_delays(self) -> None:
        if isinstance(self.delays, Sequence) and not isinstance(self.delays, str):
            object.__setattr__(self, "delays", tuple(self.delays))
        elif self.delays is not None and (not isinstance(self.delays, int) or isinstance(self.delays, bool)):
            raise SettingsError(f"delays is {self.delays!r}; give a whole number of samples, or one per input")

    def _check_prior(self, prior: Gram) -> None:
        if self.lags is not None and self.lags > prior.lags:
            raise SettingsError(f"lags is {self.lags}; the prior has {prior.lags}")
        if self.method in NEED_SAMPLES:
            raise SettingsError(f"method '{self.method}' needs all samples; with a prior give okid-era or pbsid")


class IdentificationKeywords(TypedDict, total=False):
    """The fields of ``IdentificationOptions`` as keywords of ``treadline.identify``, for type checkers and editors."""

    order: int | Sequence[int] | None
    lags: int | None
    method: str | None
    feedthrough: bool | None
    delays: Sequence[int] | int | None
    solver: str
    name_prior: bool
    stable: bool
    validation: float | InputOutputRecord | None
    prior: Gram | None
    forgetting: float


DEFAULT_OPTIONS = IdentificationOptions()
"""Options that leave every choice to the data."""


WINDOWS_LEAVE = 0.4
"""Smallest share of the samples that must remain as windows without gaps."""
COEFFICIENTS_MOST = 640
"""Coefficients of one output for automatically chosen lags: the decomposition of their Gram matrix takes a tenth of a second."""


def max_supported_lags(
    records: Sequence[InputOutputRecord], lags: int | None, order: int | None, *, penalised: bool = False
) -> int:
    """Return the given number of lags, or the largest number that the data support.

    Args:
        records: Experiments.
        lags: Given number of lags; None for the largest.
        order: Number of states, if given.
        penalised: Whether the regression has a prior, so that it needs fewer windows per coefficient.

    Raises:
        TooFewSamples: If the data are too short for the lags or the order.
        SettingsError: If so few lags carry no such order.
    """
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    most = lags if lags is not None else _affordable_lags(records, penalised=penalised)
    needed = max(most, -(-(order or 1) // p), 1)
    if lags is not None and lags < needed:
        raise SettingsError(f"lags is {lags}; order {order} of {p} outputs needs {needed} or more")
    whole, lost = _windows(records, needed)
    if most < needed or whole <= ROWS_LEAST * _unknowns(m, p, needed):
        total = sum(len(record) for record in records)
        least = fewest_samples(m, p, lags=lags, order=order, records=len(records))
        raise TooFewSamples(
            f"{total} samples are too few: {m} inputs, {p} outputs and order {order or 'auto'} with {needed} lags need at least "
            f"{least}" + (f", and gaps cost {lost}" if lost else "")
        )
    return most


def fewest_samples(inputs: int, outputs: int, *, lags: int | None = None, order: int | None = None, records: int = 1) -> int:
    """Return the number of samples without gaps needed; the first ``lags`` samples of each record are not targets."""
    needed = max(lags or 0, -(-(order or 1) // outputs), 1)
    unknowns = _unknowns(inputs, outputs, needed)
    return (ROWS_PER_PARAMETER * unknowns if lags is None else ROWS_LEAST * unknowns + 1) + needed * records


def _unknowns(m: int, p: int, lags: int) -> int:
    """Return the number of coefficients of one output: a constant, the current inputs, and inputs and outputs of each lag."""
    return 1 + m + lags * (m + p)


def _windows(records: Sequence[InputOutputRecord], lags: int) -> tuple[int, int]:
    """Return the number of complete windows and the number lost to gaps."""
    whole = lost = 0
    for record in records:
        count = max(len(record) - lags, 0)
        holed = 0
        there = record.whole
        if count and not there.all():
            seen = np.cumsum(~there)
            holed = int(np.count_nonzero(seen[lags:] - np.concatenate([[0], seen[: -lags - 1]])))
        whole, lost = whole + count - holed, lost + holed
    return whole, lost


def _affordable_lags(records: Sequence[InputOutputRecord], *, penalised: bool) -> int:
    """Return the largest number of lags with enough windows per coefficient; 0 if there is none."""
    m, p = records[0].u.shape[1], records[0].y.shape[1]
    total = sum(len(record) for record in records)
    if _windows(records, 1)[0] < ROWS_PER_PARAMETER * _unknowns(m, p, 1):
        return 0
    for lags in range(LAGS_MOST, 0, -1):
        unknowns = _unknowns(m, p, lags)
        rows = ROWS_LEAST * unknowns + 1 if penalised else ROWS_PER_PARAMETER * unknowns
        wanted = max(rows, WINDOWS_LEAVE * total)
        if unknowns <= max(COEFFICIENTS_MOST, _unknowns(m, p, 1)) and total >= wanted and _windows(records, lags)[0] >= wanted:
            return lags
    return 0
