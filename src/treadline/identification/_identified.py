"""Result of an identification: the model, with report and confidence intervals computed on first access."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.printing import Printable
from treadline.identification import _quality_report as reports
from treadline.identification._affine import Affine
from treadline.identification._checks import FEW_SAMPLES, excitation_order, insufficient_excitation
from treadline.identification._correlation_intervals import of_correlations
from treadline.identification._delays import input_delays
from treadline.identification._differential_input import DifferentialInput
from treadline.identification._fitting import Candidate, Fitting
from treadline.identification._model_order import OrderChoice
from treadline.identification._model_selection import CvScore
from treadline.identification._pole_intervals import MEMORY_PER_LAG, ConfidenceIntervals, of_observer, of_predicting, of_refined
from treadline.identification._quality_report import CandidateScore, IdentificationReport
from treadline.identification._structure import gap_of
from treadline.identification._threads import one_thread
from treadline.identification.era import HankelSvd
from treadline.identification.gram import Gram, Units
from treadline.identification.okid import ObserverMarkov

DEAD_TIME = 3
"""Delay in samples from which a warning suggests removing the dead time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedSystem:
    """Fitted system in standard deviations, with the data and choices that led to it."""

    candidate: Candidate
    system: Affine
    units: Units
    fitting: Fitting
    observer: ObserverMarkov
    svd: HankelSvd
    choice: OrderChoice
    noise: float | None
    scores: Sequence[CvScore]
    warnings: Sequence[str]


class Identified(Printable):
    """Identified model; the report and the intervals are computed on first access."""

    def __init__(
        self,
        *,
        model: LinearModel,
        found: FittedSystem,
        method: str,
        fitted: Sequence[InputOutputRecord],
        judged: Sequence[InputOutputRecord],
        shifts: Sequence[int],
        started: float,
        gram: Gram,
        differential: DifferentialInput | None = None,
    ) -> None:
        self.model = model
        self.fitted = fitted
        self.judged = judged
        self.gram = gram
        """Gram matrix of the data, from which a later identification can continue."""
        self._found, self._method, self._shifts, self._differential = found, method, shifts, differential
        self._seconds = time.perf_counter() - started

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return order, fit, one-step prediction, poles and warnings."""
        report = self.report
        rows = [
            (f"fit of {name}", f"{value:.1f} % free run, {report.one_step_vaf_percent[name]:.1f} % of the variance one step ahead")
            for name, value in report.fit_percent.items()
        ]
        rows.append(("poles", ", ".join(f"{complex(*pole):.4g}" for pole in report.poles)))
        rows += [("warning", warning) for warning in report.warnings]
        return f"model of order {report.order} with {report.lags} lags ({report.method}), period {self.model.dt_s:g} s", rows

    @property
    def svd(self) -> HankelSvd:
        """Decomposed Hankel matrix of the observer's system."""
        return self._found.svd

    @cached_property
    @one_thread()
    def intervals(self) -> ConfidenceIntervals | None:
        """Confidence intervals; None for data too short to estimate them. Dead time and input structure are assumed known."""
        result = self._intervals()
        return result if result is None or self._differential is None else self._differential.intervals(result, self.gram.units)

    def _intervals(self) -> ConfidenceIntervals | None:
        found = self._found
        candidate, fitting = found.candidate, found.fitting
        if candidate.method == "deconvolution" or candidate.step == "inputs-again":
            return None  # no error covariance is available for these methods
        if candidate.step == "subspace" and candidate.method != "pbsid":
            law = of_correlations if candidate.method == "era-dc" else of_observer
            observer, svd = fitting.observer(candidate.lags, candidate.order)
            # Residuals of an observer may be correlated over further lags, which the covariance needs.
            data = fitting.with_more_lags((1 + MEMORY_PER_LAG) * candidate.lags)
            return law(observer, svd, found.system, found.units, data)
        if candidate.step in ("subspace", "prediction-error") and found.system.K is not None:
            runs = fitting.predictors(4 * candidate.order + 4)
            if not runs:
                return None
            # The Gram matrix of a stream or a prior covers more samples than are kept in memory.
            share = min(1.0, sum(len(run.y) for run in runs) / fitting.data.count)
            result = of_predicting(found.system, runs, fitting.fixed, found.units)
            return result if result is None or candidate.step != "subspace" else result.narrowed(share)
        return of_refined(found.system, fitting.experiments(constants=candidate.constants), fitting.fixed, found.units)

    @cached_property
    @one_thread()
    def report(self) -> IdentificationReport:
        """Fit, validation, uncertainty and warnings of the identification."""
        started = time.perf_counter()
        found, model = self._found, self.model
        scores = reports.validation_scores(model, self.judged)
        delays = [d + shift for d, shift in zip(self._delays(), self._shifts, strict=True)]
        support = excitation_order(found.fitting.data, samples=FEW_SAMPLES)
        warnings = [*found.warnings, *self._dead_time_warning(delays), *self._excitation_warning(support)]
        warnings += reports.validation_warnings(scores, model, self.fitted, self.judged)
        poles = np.linalg.eigvals(found.system.A).astype(complex)
        radii = None if self.intervals is None else self.intervals.pole_radii()
        chain = [0.0] * (model.order - found.system.order)
        return IdentificationReport(
            order=model.order,
            lags=found.candidate.lags,
            method=self._method,
            subspace=found.candidate.method,
            constants=found.candidate.constants,
            step=found.candidate.step,
            feedthrough=found.fitting.feedthrough,
            mirrored=self._differential is not None,
            delays=delays,
            singular_values=[float(value) for value in found.svd.s],
            gap=reports.finite_or_none(gap_of(found.choice, found.svd)),
            noise_level=found.noise,
            poles=[(float(pole.real), float(pole.imag)) for pole in poles] + [(0.0, 0.0) for _ in chain],
            pole_ci95=None if radii is None else [float(radius) for radius in radii] + chain,
            fit_percent=scores.fit_percent,
            one_step_vaf_percent=scores.one_step_vaf_percent,
            whiteness_p=scores.whiteness_p,
            crosscorrelation_p=scores.crosscorrelation_p,
            excitation_order=support,
            samples=round(found.fitting.data.count),
            dropped=found.fitting.data.dropped,
            candidates=[
                CandidateScore(
                    method=scored.candidate.method,
                    lags=scored.candidate.lags,
                    order=scored.candidate.order,
                    step=scored.candidate.step,
                    constants=scored.candidate.constants,
                    error=reports.finite_or_none(scored.error),
                    chosen=scored.candidate == found.candidate,
                )
                for scored in found.scores
            ],
            warnings=warnings,
            seconds=self._seconds + time.perf_counter() - started,
        )

    def _delays(self) -> list[int]:
        delays = input_delays(self._found.observer)
        return delays if self._differential is None else delays * len(self._shifts)

    def _dead_time_warning(self, delays: Sequence[int]) -> list[str]:
        late = [
            f"'{name}' acts after {d} samples"
            for name, d, shift in zip(self.model.input_names, delays, self._shifts, strict=True)
            if d >= DEAD_TIME and not shift
        ]
        return [f"dead time: {', '.join(late)}; --delays auto removes it from the states"] if late else []

    def _excitation_warning(self, support: int) -> list[str]:
        result = reports.collinearity_warnings(self.fitted, self.model.input_names, mirrored=self._differential is not None)
        order = self._found.system.order
        if support < order and support <= self._found.fitting.data.lags:
            result.append(f"poor excitation: {insufficient_excitation(support, order)}; give inputs that vary more")
        return result
