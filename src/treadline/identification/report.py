"""What the data said, and how sure: a model judged on data, with warnings that carry numbers."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from treadline.identification import validate
from treadline.models import InputOutputRecord, LinearModel

MEANINGFUL = 0.01
"""p-value below which residuals are reported to hold something that the model misses."""
STILL = 0.5
"""Ratio of what outputs move in the judging data and in the fitted data, below which a fit says little."""

LONG_ENOUGH = 20
"""Samples of a record from which its residuals are tested, over ten lags."""
NOTHING_EXPLAINED = 10.0
"""Percent of fit and of variance below which a model is none."""
EXACT_PERCENT = 1e-10
"""Share of the variance that rounding may leave."""
NEARLY_TOGETHER = 0.15
"""Share of an input's variance that tells the inputs apart, below which they count as moving together: correlation 0.85."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A recipe that was tried, and its error on data held out over the outputs' spread."""

    method: str
    lags: int
    order: int
    step: str
    constants: bool
    error: float | None
    """None where the model exploded."""
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationReport:
    """What the data said, and how sure."""

    order: int
    lags: int
    method: str
    subspace: str
    """What gave A and C first: ``okid-era``, ``era-dc`` or ``pbsid``."""
    constants: bool
    """Whether offsets were estimated; if not, rest is zero."""
    step: str
    """The last step that was taken: ``subspace``, ``inputs-again``, ``output-error`` or ``prediction-error``."""
    feedthrough: bool
    mirrored: bool
    """Whether a left and a right input act by their difference alone."""
    delays: list[int]
    """Samples after which each input shows in the outputs; 0 is feedthrough."""
    singular_values: list[float]
    gap: float | None
    """σ_n / σ_{n+1}; None where there is no σ_{n+1}."""
    noise_level: float | None
    """Singular value that noise alone would show; None where it was not asked."""
    poles: list[tuple[float, float]]
    pole_ci95: list[float] | None
    """Radius of the disc about each pole that holds the true one with 95 %."""
    fit_percent: dict[str, float]
    one_step_vaf_percent: dict[str, float]
    whiteness_p: float | None
    crosscorrelation_p: float | None
    """p-values of the residuals being white, and having nothing to do with the inputs; None where too few are judged."""
    excitation_order: int
    """Largest order that the inputs excite persistently, as far as it was looked at."""
    samples: int
    dropped: int
    candidates: list[Candidate]
    warnings: list[str]
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """How a model does on data."""

    fit_percent: dict[str, float]
    one_step_vaf_percent: dict[str, float]
    whiteness_p: float | None
    crosscorrelation_p: float | None


def judge(model: LinearModel, judged: Sequence[InputOutputRecord]) -> Judgement:
    """Return a model's figures, mean over the records; of p-values the smallest, times their number (Bonferroni).

    Records too short to test do not count.
    """
    judged = [record for record in judged if whole_samples(record) >= LONG_ENOUGH] or [max(judged, key=whole_samples)]
    with np.errstate(over="ignore", invalid="ignore"):
        residuals = [validate.one_step_residuals(model, record) for record in judged]
        vaf = np.mean([validate.vaf_percent(record.y, e) for record, e in zip(judged, residuals, strict=True)], axis=0)
        fit = np.mean([validate.fit_percent(model, record) for record in judged], axis=0)
    names = model.output_names
    # Rounding has no law: where nothing else is left, nothing speaks against the model.
    exact = bool(np.all(100.0 - vaf < EXACT_PERCENT))
    return Judgement(
        fit_percent={name: _figure(value) for name, value in zip(names, fit, strict=True)},
        one_step_vaf_percent={name: _figure(value) for name, value in zip(names, vaf, strict=True)},
        whiteness_p=1.0 if exact else known(smallest([validate.whiteness_p(e) for e in residuals])),
        crosscorrelation_p=1.0
        if exact
        else known(smallest([validate.crosscorrelation_p(e, record.u) for record, e in zip(judged, residuals, strict=True)])),
    )


def whole_samples(record: InputOutputRecord) -> int:
    """Return the number of samples of which nothing is missing."""
    return int(record.whole.sum())


def doubts(
    judgement: Judgement,
    model: LinearModel,
    fitted: Sequence[InputOutputRecord],
    judged: Sequence[InputOutputRecord],
) -> list[str]:
    """Return what a user should know before trusting the model."""
    found = []
    radius = float(np.abs(np.linalg.eigvals(model.A)).max())
    if radius > 1.0 + 1e-6:
        found.append(
            f"the model is unstable (spectral radius {radius:.4f}): closed-loop or drifting data? give --stable if the plant is "
            "known to be stable"
        )
    for name, value in judgement.fit_percent.items():
        if value < 0.0 and radius < 1.0 - 1e-3:
            found.append(f"a free run explains '{name}' worse than its mean does ({value:.0f} %)")
    if max(*judgement.fit_percent.values(), *judgement.one_step_vaf_percent.values()) < NOTHING_EXPLAINED:
        found.append("the model explains next to nothing: the inputs hardly move these outputs, or not linearly")
    if judged is not fitted:
        found += _stillness(model, fitted, judged)
    if judgement.whiteness_p is not None and judgement.whiteness_p < MEANINGFUL:
        found.append(f"the residuals are not white (p = {judgement.whiteness_p:.1e}): noise has dynamics that the model lacks")
    if judgement.crosscorrelation_p is not None and judgement.crosscorrelation_p < MEANINGFUL:
        found.append(
            f"the residuals still depend on the inputs (p = {judgement.crosscorrelation_p:.1e}): a higher order, a delay or a "
            "nonlinearity is missing"
        )
    return found


def together(records: Sequence[InputOutputRecord], names: Sequence[str], *, mirrored: bool = False) -> list[str]:
    """Return a warning where inputs move nearly together: what tells them apart is then known from little.

    Args:
        mirrored: Whether they act by their difference alone.
    """
    u = np.vstack([record.u for record in records])
    u = u[np.isfinite(u).all(axis=1)]
    values, V = np.linalg.eigh(np.corrcoef(u.T)) if u.shape[1] > 1 else (np.ones(1), np.eye(1))
    if values[0] > NEARLY_TOGETHER:
        return []
    two = np.argsort(-np.abs(V[:, 0]))[:2]
    apart = "their difference, by which they act," if mirrored else "what tells the inputs apart"
    remedy = "turn more" if mirrored else "let each move by itself"
    return [
        f"poor excitation: '{names[int(two[0])]}' and '{names[int(two[1])]}' move nearly together; {apart} has "
        f"{100.0 * float(values[0]):.0f} % of one input's variance: {remedy}"
    ]


def _stillness(model: LinearModel, fitted: Sequence[InputOutputRecord], judged: Sequence[InputOutputRecord]) -> list[str]:
    before, after = (np.nanstd(np.vstack([record.y for record in records]), axis=0) for records in (fitted, judged))
    return [
        f"'{name}' moves {ratio:.2f} times as much in the validation part as in the fitted part: its fit says little"
        for name, ratio in zip(model.output_names, after / before, strict=True)
        if ratio < STILL
    ]


def smallest(p_values: Sequence[float]) -> float:
    """Return the p-value of all of several hypotheses."""
    return min(1.0, len(p_values) * min(p_values))


def known(value: float) -> float | None:
    """Return a number, or None where there is none."""
    return float(value) if np.isfinite(value) else None


def _figure(value: float) -> float:
    """Return a number that JSON can hold: what exploded is minus a lot."""
    return float(value) if np.isfinite(value) else -1e9
