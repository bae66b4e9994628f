"""Report of an identification: fit, residual tests and warnings with numbers."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.printing import p_text
from treadline.identification import validate

P_VALUE_LIMIT = 0.01
"""p-value below which a residual test is reported as failed."""
LOW_MOTION_RATIO = 0.5
"""Ratio of output deviation in validation and fitted data below which a fit is not informative."""

TESTED_SAMPLES_MIN = 20
"""Smallest number of samples of a record with residual tests over ten lags."""
FIT_PERCENT_MIN = 10.0
"""Fit and variance accounted for [%] below which the model explains practically nothing."""
EXACT_PERCENT = 1e-10
"""Unexplained share of the variance [%] attributed to rounding."""
COLLINEAR_VARIANCE = 0.15
"""Variance of the weakest input combination relative to one input's, below which inputs count as collinear (0.85 correlated)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateScore:
    """Candidate and its cross-validation error relative to the outputs' standard deviation."""

    method: str
    lags: int
    order: int
    step: str
    constants: bool
    error: float | None
    """Cross-validation error; None for a diverging model."""
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationReport:
    """Fit, validation, uncertainty and warnings of an identification."""

    order: int
    lags: int
    method: str
    subspace: str
    """Subspace method that gave the initial A and C: ``okid-era``, ``era-dc`` or ``pbsid``."""
    constants: bool
    """Whether offsets were estimated; otherwise they are zero."""
    step: str
    """Last fitting step: ``subspace``, ``inputs-again``, ``output-error`` or ``prediction-error``."""
    feedthrough: bool
    mirrored: bool
    """Whether the difference of a left and a right input is the only input."""
    delays: list[int]
    """Delay of each input in samples; 0 is feedthrough."""
    singular_values: list[float]
    gap: float | None
    """Gap σ_n / σ_{n+1}; None if there is no σ_{n+1}."""
    noise_level: float | None
    """Largest singular value of noise alone; None if not computed."""
    poles: list[tuple[float, float]]
    pole_ci95: list[float] | None
    """Radius of the disc about each pole that contains the true pole with 95 % probability."""
    fit_percent: dict[str, float]
    one_step_vaf_percent: dict[str, float]
    whiteness_p: float | None
    crosscorrelation_p: float | None
    """p-values of white residuals and of residuals independent of the inputs; None for too few validation samples."""
    excitation_order: int
    """Largest order that the inputs excite persistently, up to the number of lags."""
    samples: int
    dropped: int
    candidates: list[CandidateScore]
    warnings: list[str]
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationScores:
    """Fit and residual tests of a model on validation data."""

    fit_percent: dict[str, float]
    one_step_vaf_percent: dict[str, float]
    whiteness_p: float | None
    crosscorrelation_p: float | None


def validation_scores(model: LinearModel, judged: Sequence[InputOutputRecord]) -> ValidationScores:
    """Return a model's fit and residual tests: means over the records, smallest p-values with Bonferroni correction.

    Records too short for the tests are left out.
    """
    judged = [record for record in judged if whole_samples(record) >= TESTED_SAMPLES_MIN] or [max(judged, key=whole_samples)]
    with np.errstate(over="ignore", invalid="ignore"):
        residuals = [validate.one_step_residuals(model, record) for record in judged]
        vaf = np.mean([validate.vaf_percent(record.y, e) for record, e in zip(judged, residuals, strict=True)], axis=0)
        fit = np.mean([validate.fit_percent(model, record) for record in judged], axis=0)
    names = model.output_names
    # A residual of pure rounding has no meaningful p-value; the tests count as passed.
    exact = bool(np.all(100.0 - vaf < EXACT_PERCENT))
    return ValidationScores(
        fit_percent={name: _json_number(value) for name, value in zip(names, fit, strict=True)},
        one_step_vaf_percent={name: _json_number(value) for name, value in zip(names, vaf, strict=True)},
        whiteness_p=1.0 if exact else finite_or_none(bonferroni([validate.whiteness_p(e) for e in residuals])),
        crosscorrelation_p=1.0
        if exact
        else finite_or_none(
            bonferroni([validate.crosscorrelation_p(e, record.u) for record, e in zip(judged, residuals, strict=True)])
        ),
    )


def whole_samples(record: InputOutputRecord) -> int:
    """Return the number of samples without a missing channel."""
    return int(record.whole.sum())


def validation_warnings(
    scores: ValidationScores,
    model: LinearModel,
    fitted: Sequence[InputOutputRecord],
    judged: Sequence[InputOutputRecord],
) -> list[str]:
    """Return the warnings on stability, fit and residuals."""
    found = []
    radius = float(np.abs(np.linalg.eigvals(model.A)).max())
    if radius > 1.0 + 1e-6:
        found.append(
            f"the model is unstable (spectral radius {radius:.4f}): closed-loop or drifting data? give --stable if the plant is "
            "known to be stable"
        )
    for name, value in scores.fit_percent.items():
        if value < 0.0 and radius < 1.0 - 1e-3:
            found.append(f"a free run explains '{name}' worse than its mean does ({value:.0f} %)")
    if max(*scores.fit_percent.values(), *scores.one_step_vaf_percent.values()) < FIT_PERCENT_MIN:
        found.append("the model explains next to nothing: the inputs hardly move these outputs, or not linearly")
    if judged is not fitted:
        found += _low_motion_warnings(model, fitted, judged)
    if scores.whiteness_p is not None and scores.whiteness_p < P_VALUE_LIMIT:
        found.append(f"the residuals are not white ({p_text(scores.whiteness_p)}): the model lacks dynamics of the noise")
    if scores.crosscorrelation_p is not None and scores.crosscorrelation_p < P_VALUE_LIMIT:
        found.append(
            f"the residuals still depend on the inputs ({p_text(scores.crosscorrelation_p)}): a higher order, a delay or a "
            "nonlinearity is missing"
        )
    return found


def collinearity_warnings(records: Sequence[InputOutputRecord], names: Sequence[str], *, mirrored: bool = False) -> list[str]:
    """Return a warning for nearly collinear inputs, whose separate effects are poorly determined.

    Args:
        records: Experiments.
        names: Input names.
        mirrored: Whether the inputs act by their difference alone.
    """
    u = np.vstack([record.u for record in records])
    u = u[np.isfinite(u).all(axis=1)]
    values, V = np.linalg.eigh(np.corrcoef(u.T)) if u.shape[1] > 1 else (np.ones(1), np.eye(1))
    if values[0] > COLLINEAR_VARIANCE:
        return []
    two = np.argsort(-np.abs(V[:, 0]))[:2]
    apart = "their difference, the effective input," if mirrored else "the component that separates them"
    remedy = "turn more" if mirrored else "move each input independently"
    return [
        f"poor excitation: '{names[int(two[0])]}' and '{names[int(two[1])]}' move nearly together; {apart} has "
        f"{100.0 * float(values[0]):.0f} % of one input's variance: {remedy}"
    ]


def _low_motion_warnings(model: LinearModel, fitted: Sequence[InputOutputRecord], judged: Sequence[InputOutputRecord]) -> list[str]:
    before, after = (np.nanstd(np.vstack([record.y for record in records]), axis=0) for records in (fitted, judged))
    return [
        f"'{name}' moves {ratio:.2f} times as much in the validation part as in the fitted part: its fit is not informative"
        for name, ratio in zip(model.output_names, after / before, strict=True)
        if ratio < LOW_MOTION_RATIO
    ]


def bonferroni(p_values: Sequence[float]) -> float:
    """Return the combined p-value of several tests (Bonferroni)."""
    return min(1.0, len(p_values) * min(p_values))


def finite_or_none(value: float) -> float | None:
    """Return the number, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def _json_number(value: float) -> float:
    """Return a JSON-compatible number; a diverging fit becomes -1e9."""
    return float(value) if np.isfinite(value) else -1e9
