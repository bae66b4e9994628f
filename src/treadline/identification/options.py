"""Options of an identification: what the data decide when an option is left out, and the allowed range of each option."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

from treadline.core.errors import SettingsError
from treadline.core.models import InputOutputRecord
from treadline.identification._checks import check_integers
from treadline.identification.gram import Gram

METHODS = ("best", "okid-era", "era-dc", "pbsid", "deconvolution")
SOLVERS = ("gram", "qr")
NEED_SAMPLES = ("best", "deconvolution")
"""Methods that need all samples, and therefore cannot continue from a Gram matrix."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentificationOptions:
    """Options of an identification, checked when the object is made.

    Raises:
        SettingsError: If an option is unknown, out of range, or contradicts another option.
    """

    order: int | None = None
    """Number of states. Default: with ``best`` by cross-validation, with ``pbsid`` the largest gap of the singular values or,
    where that gap is unclear, the BIC, otherwise the largest gap of the singular values."""
    lags: int | None = None
    """Observer lags p. Default: at the smallest BIC, with ``okid-era`` and ``era-dc`` at the smallest AICc."""
    method: str | None = None
    """Identification method. ``best`` compares several methods by cross-validation; ``okid-era`` is the paper's method,
    ``era-dc`` its variant with data correlations, ``pbsid`` the closed-loop subspace method, ``deconvolution`` Eq. (9c) as
    printed. Default: ``best``; with a prior, or for chunks, ``pbsid``."""
    feedthrough: bool | None = None
    """Whether an input acts within the same sample (D). Default: at the smallest BIC."""
    delays: Sequence[int] | str | None = None
    """Dead time of each input in samples, or ``auto`` to estimate it. Default: the states model the dead time."""
    solver: str = "gram"
    """Least-squares solver: ``gram`` for normal equations, or ``qr``: slower, accurate to rounding on noise-free data."""
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
        check_integers(order=self.order, lags=self.lags)
        self._check_delays()
        if isinstance(self.validation, Real) and not 0.0 < self.validation < 1.0:
            raise SettingsError(f"the validation share is {self.validation}; it must lie between 0 and 1")
        if not 0.0 < self.forgetting <= 1.0:
            raise SettingsError(f"forgetting is {self.forgetting}; it must be above 0 and at most 1")
        if self.prior is None and self.forgetting < 1.0:
            raise SettingsError("forgetting has no effect without earlier data; give a prior")
        if self.prior is not None:
            self._check_prior(self.prior)

    def _check_delays(self) -> None:
        if isinstance(self.delays, Sequence) and not isinstance(self.delays, str):
            object.__setattr__(self, "delays", tuple(self.delays))
        elif self.delays not in (None, "auto"):
            raise SettingsError(f"delays is '{self.delays}'; give auto, or one number per input")

    def _check_prior(self, prior: Gram) -> None:
        if self.lags is not None and self.lags > prior.lags:
            raise SettingsError(f"lags is {self.lags}; the prior has {prior.lags}")
        if self.method in NEED_SAMPLES:
            raise SettingsError(f"method '{self.method}' needs all samples; with a prior give okid-era, era-dc or pbsid")


DEFAULT_OPTIONS = IdentificationOptions()
"""Options that leave every choice to the data."""
