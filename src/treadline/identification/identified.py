"""What an identification hands over: the model at once, and what can be said of it when it is asked."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from treadline.identification import report as reports
from treadline.identification.affine import Affine
from treadline.identification.best import Trial
from treadline.identification.checks import FEW_SAMPLES, excitation_order, too_little
from treadline.identification.delays import input_delays
from treadline.identification.era import HankelSvd
from treadline.identification.fitting import Fitting, Recipe
from treadline.identification.gram import Gram, Units
from treadline.identification.intervals import MEMORY_PER_LAG, Intervals, of_observer, of_predicting, of_refined
from treadline.identification.intervals_of_correlations import of_correlations
from treadline.identification.mirror import Mirror
from treadline.identification.okid import ObserverMarkov
from treadline.identification.order import OrderChoice
from treadline.identification.report import Candidate, IdentificationReport
from treadline.identification.structure import gap_of
from treadline.identification.threads import one_thread
from treadline.models import InputOutputRecord, LinearModel
from treadline.printing import Printable

DEAD_TIME = 3
"""Delay in samples from which a model is better off without it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """A model in units of deviations, and what it was made of."""

    recipe: Recipe
    system: Affine
    units: Units
    fitting: Fitting
    observer: ObserverMarkov
    svd: HankelSvd
    choice: OrderChoice
    noise: float | None
    trials: Sequence[Trial]
    warnings: Sequence[str]


class Identified(Printable):
    """A model and, computed when first read, its report and its intervals: neither delays who wants the model alone."""

    def __init__(
        self,
        *,
        model: LinearModel,
        found: Found,
        method: str,
        fitted: Sequence[InputOutputRecord],
        judged: Sequence[InputOutputRecord],
        shifts: Sequence[int],
        started: float,
        gram: Gram,
        mirror: Mirror | None = None,
    ) -> None:
        self.model = model
        self.fitted = fitted
        self.judged = judged
        self.gram = gram
        """The sums of the data, from which a later identification can go on."""
        self._found, self._method, self._shifts, self._mirror = found, method, shifts, mirror
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
        """The decomposed Hankel matrix of the observer's system."""
        return self._found.svd

    @cached_property
    @one_thread()
    def intervals(self) -> Intervals | None:
        """How sure the model is; None where the data are too short to tell. Dead time and a mirror count as known."""
        told = self._intervals()
        return told if told is None or self._mirror is None else self._mirror.intervals(told, self.gram.units)

    def _intervals(self) -> Intervals | None:
        found = self._found
        recipe, fitting = found.recipe, found.fitting
        if recipe.method == "deconvolution" or recipe.step == "inputs-again":
            return None  # the law of their errors is not known here
        if recipe.step == "subspace" and recipe.method != "pbsid":
            law = of_correlations if recipe.method == "era-dc" else of_observer
            observer, svd = fitting.observer(recipe.lags, recipe.order)
            # The observer's own lags, and as many more as its residuals may remember.
            data = fitting.remembering((1 + MEMORY_PER_LAG) * recipe.lags)
            return law(observer, svd, found.system, found.units, data)
        if recipe.step in ("subspace", "prediction-error") and found.system.K is not None:
            runs = fitting.predictors(4 * recipe.order + 4)
            if not runs:
                return None
            # Sums may hold more than the samples at hand, of a stream or of earlier data.
            share = min(1.0, sum(len(run.y) for run in runs) / fitting.data.count)
            told = of_predicting(found.system, runs, fitting.fixed, found.units)
            return told if told is None or recipe.step != "subspace" else told.narrowed(share)
        return of_refined(found.system, fitting.experiments(constants=recipe.constants), fitting.fixed, found.units)

    @cached_property
    @one_thread()
    def report(self) -> IdentificationReport:
        """What the data said of the model."""
        started = time.perf_counter()
        found, model = self._found, self.model
        judgement = reports.judge(model, self.judged)
        delays = [d + shift for d, shift in zip(self._delays(), self._shifts, strict=True)]
        support = excitation_order(found.fitting.data, samples=FEW_SAMPLES)
        warnings = [*found.warnings, *self._dead_time_warning(delays), *self._excitation_warning(support)]
        warnings += reports.doubts(judgement, model, self.fitted, self.judged)
        poles = np.linalg.eigvals(found.system.A).astype(complex)
        radii = None if self.intervals is None else self.intervals.pole_radii()
        chain = [0.0] * (model.order - found.system.order)
        return IdentificationReport(
            order=model.order,
            lags=found.recipe.lags,
            method=self._method,
            subspace=found.recipe.method,
            constants=found.recipe.constants,
            step=found.recipe.step,
            feedthrough=found.fitting.feedthrough,
            mirrored=self._mirror is not None,
            delays=delays,
            singular_values=[float(value) for value in found.svd.s],
            gap=reports.known(gap_of(found.choice, found.svd)),
            noise_level=found.noise,
            poles=[(float(pole.real), float(pole.imag)) for pole in poles] + [(0.0, 0.0) for _ in chain],
            pole_ci95=None if radii is None else [float(radius) for radius in radii] + chain,
            fit_percent=judgement.fit_percent,
            one_step_vaf_percent=judgement.one_step_vaf_percent,
            whiteness_p=judgement.whiteness_p,
            crosscorrelation_p=judgement.crosscorrelation_p,
            excitation_order=support,
            samples=round(found.fitting.data.count),
            dropped=found.fitting.data.dropped,
            candidates=[
                Candidate(
                    method=trial.recipe.method,
                    lags=trial.recipe.lags,
                    order=trial.recipe.order,
                    step=trial.recipe.step,
                    constants=trial.recipe.constants,
                    error=reports.known(trial.error),
                    chosen=trial.recipe == found.recipe,
                )
                for trial in found.trials
            ],
            warnings=warnings,
            seconds=self._seconds + time.perf_counter() - started,
        )

    def _delays(self) -> list[int]:
        delays = input_delays(self._found.observer)
        return delays if self._mirror is None else delays * len(self._shifts)

    def _dead_time_warning(self, delays: Sequence[int]) -> list[str]:
        late = [
            f"'{name}' acts after {d} samples"
            for name, d, shift in zip(self.model.input_names, delays, self._shifts, strict=True)
            if d >= DEAD_TIME and not shift
        ]
        return [f"dead time: {', '.join(late)}; --delays auto takes it out of the states"] if late else []

    def _excitation_warning(self, support: int) -> list[str]:
        told = reports.together(self.fitted, self.model.input_names, mirrored=self._mirror is not None)
        order = self._found.system.order
        if support < order and support <= self._found.fitting.data.lags:
            told.append(f"poor excitation: {too_little(support, order)}; give inputs that move more freely")
        return told
