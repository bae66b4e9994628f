"""Result of an identification: the model, its report and confidence intervals computed on first access.

The report has fit, residual tests and warnings with numbers. Its figures are of data that were not fitted: those given for
validation, else the last third of each record, judged by a model of the first two thirds; the result itself is fitted to all.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache as cached
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from treadline.core import linear_systems
from treadline.core.arrays import finite_or_none, spectral_radius
from treadline.core.errors import RecordError
from treadline.core.model_scores import TESTED_SAMPLES_MIN, Comparison, FitScores, compare, skill_percent
from treadline.core.models import EXPLAINED, VEHICLE, InputOutputRecord, LinearModel
from treadline.core.printing import Printable, p_text, percent_text, plain
from treadline.core.transfer_function import StabilisationDiagram, is_unstable
from treadline.core.turning import NAME_PRIOR, YAW_GAIN, turn_channels, turn_faults
from treadline.identification._affine import of_model
from treadline.identification._checks import FEW_SAMPLES, excitation_order, insufficient_excitation, whole_samples
from treadline.identification._dead_time import without_delays
from treadline.identification._drive_log import DifferentialInput, DriveLog, LogFindings, examine
from treadline.identification._era import HankelSvd
from treadline.identification._fitting import CandidateScore, FittedSystem, Fitting
from treadline.identification._gram import Gram, units_of
from treadline.identification._intervals import MEMORY_PER_LAG, ConfidenceIntervals, of_observer, of_predicting, of_refined
from treadline.identification._limits import HALF, RECENT, ROUNDING
from treadline.identification._model_order import gap_at
from treadline.identification._operating_points import second_operating_point
from treadline.identification._refine import predictors_of
from treadline.identification._threads import one_thread
from treadline.identification._turn_fit import (
    Contradiction,
    SkidSteer,
    TurnFit,
    contradiction,
    fits_as_well,
    input_noise_warning,
    turn_fit,
    turn_model,
)
from treadline.identification.stabilisation import stabilisation_of_svd

P_VALUE_LIMIT = 0.01
"""p-value below which a residual test is reported as failed."""
LOW_MOTION_RATIO = 0.5
"""Ratio of output deviation in validation and fitted data below which a fit is not informative."""

FIT_PERCENT_MIN = 10.0
"""Fit and variance accounted for [%] below which the model explains practically nothing."""
HELD_OUT = 1.0 / 3.0
"""Share of each record, at its end, that judges where no data are given for validation."""
COLLINEAR_VARIANCE = 0.15
"""Variance of the weakest input combination relative to one input's, below which inputs count as collinear (0.85 correlated)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationReport(FitScores):
    """Fit, validation, uncertainty and warnings of an identification."""

    order: int
    lags: int
    method: str
    subspace: str
    """Where A and C come from: ``okid-era``, ``pbsid``, ``deconvolution`` or ``by names``."""
    step: str
    """Last fitting step: ``subspace``, ``inputs-again`` or ``output-error``, or ``structure`` by names."""
    feedthrough: bool
    mirrored: bool
    """Whether the difference of a left and a right input is the only input."""
    delays: list[int]
    """Dead time of each input in samples."""
    singular_values: list[float]
    gap: float | None
    """Gap σ_n / σ_{n+1}; None if there is no σ_{n+1}."""
    noise_level: float | None
    """Largest singular value of noise alone; None if not computed."""
    poles: list[tuple[float, float]]
    pole_ci95: list[float] | None
    """Radius of the disc about each pole that contains the true pole with 95 % probability."""
    companion_percent: dict[str, float] | None
    """Fit of a free run of the stable companion of an unstable model by output [%]; None for a stable model."""
    judged_on: str
    """Data that the figures are of, in words."""
    judged_samples: int
    fit_conditions: str
    """What the fit is of, in words: a free run and its start, or, of an unstable model, a forecast and its horizon."""
    excitation_order: int
    """Largest order that the inputs excite persistently, up to the number of lags."""
    samples: int
    dropped: int
    candidates: list[CandidateScore]
    warnings: list[str]
    seconds: float
    skid_steer: SkidSteer | None = None
    """Effective gauge, speed scales and lags, for two belts and a yaw rate or heading by their names."""

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return dict(plain(asdict(self)))


def tested(judged: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
    """Return the most recent samples; records too short for the tests are left out where others are not."""
    recent = linear_systems.most_recent(judged, RECENT)
    return [record for record in recent if whole_samples(record) >= TESTED_SAMPLES_MIN] or [max(recent, key=whole_samples)]


def validation_scores(found: Sequence[Comparison]) -> dict[str, Any]:
    """Return fit and residual tests as fields of the report: means, and smallest p-values with Bonferroni correction."""
    vaf = mean_by_output([one.one_step_vaf_percent for one in found])
    # A residual of pure rounding has no meaningful p-value; the tests count as passed.
    exact = all(100.0 - value < 100.0 * ROUNDING for value in vaf.values())
    white, crossed = [one.whiteness_p for one in found], [one.crosscorrelation_p for one in found]
    longest = max(found, key=lambda one: one.samples)
    percents = {name: [getattr(one, name) for one in found] for name in ("fit_percent", "forecast_percent", "persistence_percent")}
    return {
        **{name: None if getattr(longest, name) is None else mean_by_output(given) for name, given in percents.items()},
        "fit_prefix_s": longest.fit_prefix_s,
        "forecast_horizon_s": longest.forecast_horizon_s,
        "fit_conditions": longest.conditions + (f", mean of {len(found)} records" if len(found) > 1 else ""),
        "one_step_vaf_percent": vaf,
        "whiteness_p": 1.0 if exact else bonferroni(white),
        "crosscorrelation_p": 1.0 if exact else bonferroni(crossed),
    }


def mean_by_output(percents: Sequence[dict[str, float] | None]) -> dict[str, float]:
    """Return the mean percentage of each output; -1e9, a JSON value, for a diverging one."""
    known = [one for one in percents if one is not None]
    mean = np.array([list(one.values()) for one in known]).mean(axis=0)
    return dict(zip(known[0], np.where(mean > -1e9, mean, -1e9).tolist(), strict=True))  # also for NaN


def _low_motion_warnings(model: LinearModel, fitted: Sequence[InputOutputRecord], judged: Sequence[InputOutputRecord]) -> list[str]:
    before, after = (np.nanstd(np.vstack([record.y for record in records]), axis=0) for records in (fitted, judged))
    return [
        f"'{name}' moves {ratio:.2f} times as much in the validation part as in the fitted part: its fit is not informative"
        for name, ratio in zip(model.output_names, after / before, strict=True)
        if ratio < LOW_MOTION_RATIO
    ]


def _percents(percent: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {percent_text(value)}" for name, value in percent.items())


def bonferroni(p_values: Sequence[float | None]) -> float | None:
    """Return the combined p-value of several tests (Bonferroni); None if one has no p-value."""
    known = [value for value in p_values if value is not None]
    return min(1.0, len(known) * min(known)) if known and len(known) == len(p_values) else None


class JudgedProvenance(Mapping[str, Any]):
    """Provenance of a model with figures that are computed when they are first read; a copy or a pickle is a plain ``dict``."""

    def __init__(self, known: Mapping[str, Any], judge: Callable[[], dict[str, Any]]) -> None:
        self._known, self._judge = known, cached(judge)

    def _all(self) -> dict[str, Any]:
        return {**self._known, **self._judge()}

    def __getitem__(self, key: str) -> Any:
        return self._known[key] if key in self._known else self._judge()[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return dict, (self._all(),)


@dataclass(kw_only=True, eq=False, repr=False)
class Identified(Printable):
    """Identified model; the report and the intervals are computed on first access.

    Methods of the model are methods of the result: ``found.step()`` is ``found.model.step()``.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> u = np.random.default_rng(0).normal(size=(200, 1))
        >>> y = 0.1 * np.vstack([[0.0], np.cumsum(u, axis=0)[:-1]])
        >>> found = tl.identify(u, y, 0.25, order=1, method="okid-era", lags=2)
        >>> found.model.order, found.report.method
        (1, 'okid-era')
    """

    free: LinearModel
    """Model as fitted, without the share of each output's variance that it explains."""
    found: FittedSystem
    method: str
    fitted: Sequence[InputOutputRecord]
    judged: Sequence[InputOutputRecord]
    gram: Gram
    """Gram matrix of the data, from which a later identification can continue."""
    log: DriveLog
    seconds: float
    """Time of the fit, without the report [s]."""
    name_prior: bool = True
    differential: DifferentialInput | None = None
    """Belts of which the difference alone was fitted."""
    again: Callable[..., "Identified"] | None = None
    """Identification of the same records with other options, given by name; None if the records are not kept."""

    @property
    def svd(self) -> HankelSvd:
        """Decomposed Hankel matrix of the observer's system."""
        return self.found.evidence.svd

    @property
    def _is_structure(self) -> bool:
        return self.found.step == "structure"

    @cached_property
    def _recent(self) -> list[InputOutputRecord]:
        return linear_systems.most_recent(self.fitted, RECENT)

    @cached_property
    def judge(self) -> "Identified":
        """The identification whose figures are reported: that of the first two thirds where no validation data were given.

        The result itself where data were given, or are too few to hold a third back.
        """
        if self.again is None or self.judged is not self.fitted:
            return self
        try:
            return self.again(validation=HELD_OUT)
        except RecordError:
            return self

    @cached_property
    def companion(self) -> LinearModel | None:
        """The same model with its unstable poles reflected, and inputs fitted to the free run; None for a stable model."""
        if self.again is None or not is_unstable(self.free):
            return None
        model = self.found.reflected().model(self.method, name_prior=self.name_prior)
        if self.differential is not None:
            model = self.differential.model(model, self.free.input_offset)
        return replace(model, input_delay=self.free.input_delay)

    @cached_property
    def _compared(self) -> list[Comparison]:
        return [compare(self.judge.free, record) for record in tested(self.judge.judged)]

    @cached_property
    def _explained(self) -> dict[str, float]:
        """The share of each output's variance that a free run explains, or a forecast more than persistence, the larger [%].

        The free run of a heading drifts with the smallest disturbance: of the paper's ten excitations it explains 0 to 16 %. One
        step ahead any integral is explained, by what it was; over the horizon the inputs have to move it.
        """
        run = mean_by_output([one.percent for one in self._compared])
        ahead = mean_by_output([skill_percent(self.judge.free, record) for record in tested(self.judge.judged)])
        return {name: round(max(ahead[name], 100.0 * (1.0 - (1.0 - 0.01 * run[name]) ** 2)), 1) for name in run}

    @cached_property
    def model(self) -> LinearModel:
        """The model; ``tune`` reads from its provenance the share of each output's variance that it explains."""
        drove = {VEHICLE: self.fitted[0].vehicle} if self.fitted[0].vehicle else {}
        return replace(self.free, provenance=JudgedProvenance({**self.free.provenance, **drove}, self._figures))

    def _figures(self) -> dict[str, Any]:
        fit = self._turn_fit
        gain = None if fit is None or fit.belts is None else fit.yaw_gain(fit.steps[0])
        return {EXPLAINED: self._explained} | ({} if gain is None else {YAW_GAIN: [gain.low, gain.high]})

    @cached_property
    @one_thread()
    def findings(self) -> LogFindings:
        """Findings about the records: feedback, single frequencies, tables, dependent inputs, headings against yaw rates."""
        return examine(replace(self.log, records=list(self.fitted)), name_prior=self.name_prior)

    @cached_property
    @one_thread()
    def _turn_fit(self) -> TurnFit | None:
        if not self.name_prior or turn_channels(self.fitted[0].output_names).count == 0:
            return None
        belts = self.log.differential
        return turn_fit(self.fitted, is_difference=belts is not None, is_table=self.findings.is_table)

    @cached_property
    def _contradiction(self) -> Contradiction | None:
        """Yaw gain of the free model outside the interval of the fit by names; the result that takes the structure keeps it."""
        fit = self._turn_fit
        # A slow pole in place of the integrator spoils the gain of a named method late, where a controller does not need it.
        rows = max(len(record) for record in self._recent) if self.method == "best" else 0
        return None if fit is None else contradiction(self.free, fit, rows)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or not hasattr(LinearModel, name):
            raise AttributeError(f"a result of an identification has no '{name}', nor has its model")
        return getattr(self.model, name)

    def compare(self, u: ArrayLike | InputOutputRecord | None = None, y: ArrayLike | None = None) -> Comparison:
        """Return how well the model reproduces measured data, or, without any, what the report's figures are of."""
        return max(self._compared, key=lambda one: one.samples) if u is None else self.model.compare(u, y)

    def stabilisation(self) -> StabilisationDiagram:
        """Return the poles of every order up to 40; ``stabilisation().plot()`` draws the diagram: true poles stay where they are.

        Examples:
            >>> import numpy as np
            >>> import treadline as tl
            >>> u = np.random.default_rng(0).normal(size=(200, 1))
            >>> y = 0.1 * np.vstack([[0.0], np.cumsum(u, axis=0)[:-1]])
            >>> tl.identify(u, y, 0.25, order=1, method="okid-era", lags=2).stabilisation().order
            array([1])
        """
        return stabilisation_of_svd(self.svd, self.free.dt_s, chosen=self.model.order)

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return order, fit, one-step prediction, poles and warnings."""
        report = self.report
        rows = [(f"fit of {name}", words) for name, words in report.in_words]
        rows.append(("fit", f"of {report.judged_on}: {report.fit_conditions}"))
        rows += [] if report.companion_percent is None else [("stable companion", _percents(report.companion_percent))]
        rows.append(("poles", ", ".join(f"{complex(*pole):.4g}" for pole in report.poles)))
        rows += [] if report.skid_steer is None else report.skid_steer.in_words()
        rows += [("warning", warning) for warning in report.warnings]
        return f"model of order {report.order} with {report.lags} lags ({report.method}), period {self.model.dt_s:g} s", rows

    @cached_property
    @one_thread()
    def intervals(self) -> ConfidenceIntervals | None:
        """Confidence intervals; None for data too short to estimate them. Dead time and input structure are assumed known."""
        result = self._intervals()
        return result if result is None or self.differential is None else self.differential.intervals(result)

    def _intervals(self) -> ConfidenceIntervals | None:
        found, fitting, units = self.found, self.found.fitting, self.found.fitting.data.units
        if found.subspace == "deconvolution" or self._is_structure:
            return None  # no error covariance is available for these
        if found.subspace == "okid-era":
            # Residuals of an observer may be correlated over further lags, which the covariance needs.
            data = fitting.with_more_lags((1 + MEMORY_PER_LAG) * found.lags)
            return of_observer(found.evidence.observer, found.evidence.svd, found.system, units, data)
        if found.step == "subspace" and found.system.K is not None:
            runs = predictors_of(fitting.experiments, 4 * found.order + 4)
            if not runs:
                return None
            # The Gram matrix of a stream or a prior covers more samples than are kept in memory.
            share = min(1.0, sum(len(run.y) for run in runs) / fitting.data.count)
            result = of_predicting(found.system, runs, fitting.fixed, units)
            return None if result is None else replace(result, ways=np.sqrt(share) * result.ways)
        return of_refined(found.system, fitting.experiments, fitting.fixed, units)

    @cached_property
    @one_thread()
    def report(self) -> IdentificationReport:
        """Fit, validation, uncertainty and warnings of the identification."""
        started = time.perf_counter()
        found, model = self.found, self.model
        support = excitation_order(found.fitting.data, samples=FEW_SAMPLES)
        fit = self._turn_fit
        others = [line for line in self.findings.lines if line not in self.findings.headings]
        warnings = [*others, *self._turn_warnings(), *found.warnings, *self._excitation_warning(support)]
        poles = np.linalg.eigvals(found.system.A).astype(complex)
        radii = None if self.intervals is None else self.intervals.pole_radii()
        report = IdentificationReport(
            order=model.order,
            lags=found.lags,
            method=self.method,
            subspace=found.subspace,
            step=found.step,
            feedthrough=found.fitting.feedthrough,
            mirrored=self.differential is not None,
            delays=list(model.input_delay),
            singular_values=[float(value) for value in found.evidence.svd.s],
            gap=finite_or_none(gap_at(found.evidence.svd.s[: found.evidence.structural], found.order)),
            noise_level=None if found.evidence.noise is None else finite_or_none(found.evidence.noise),
            poles=[(float(pole.real), float(pole.imag)) for pole in poles],
            pole_ci95=None if radii is None else [float(radius) for radius in radii],
            **validation_scores(self._compared),
            companion_percent=self._companion_percent(),
            judged_on=self._judged_on(),
            judged_samples=sum(len(record) for record in self.judge.judged),
            excitation_order=support,
            samples=round(found.fitting.data.count),
            dropped=found.fitting.data.dropped,
            candidates=list(found.candidates),
            warnings=warnings,
            seconds=self.seconds + time.perf_counter() - started,
            skid_steer=None if fit is None else fit.described(),
        )
        return replace(report, warnings=self._hardly_turns() or [*warnings, *self._validation_warnings(report)])

    def _companion_percent(self) -> dict[str, float] | None:
        """Return the fit of a free run of the companion of the model that is judged; None for a stable one."""
        companion = self.judge.companion
        return None if companion is None else mean_by_output([compare(companion, one).percent for one in tested(self.judge.judged)])

    def _judged_on(self) -> str:
        if self.judge is not self:
            return "the last third, by a model of the first two"
        return "the fitted data" if self.judged is self.fitted else "the validation data"

    def _validation_warnings(self, report: IdentificationReport) -> list[str]:
        """Return the warnings on stability, fit and residuals."""
        found = []
        radius = spectral_radius(self.model.A)
        if is_unstable(self.model):
            given = report.companion_percent
            run = "" if given is None else f"; a free run of its stable companion (--stable) fits {_percents(given)}"
            found.append(f"the model is unstable (spectral radius {radius:.4f}): closed-loop or drifting data?{run}")
        for name, value in report.percent.items():
            if value < 0.0 and radius < 1.0 - 1e-3:
                found.append(f"a free run explains '{name}' worse than its mean does ({value:.0f} %)")
        if max(*report.percent.values(), *report.one_step_vaf_percent.values()) < FIT_PERCENT_MIN:
            found.append("the model explains next to nothing: the inputs hardly move these outputs, or not linearly")
        if radius < 1.0 - 1e-3:
            found += second_operating_point(self.free, self.fitted, self.judged)
        if self.judged is not self.fitted:
            found += _low_motion_warnings(self.model, self.fitted, self.judged)
        white, crossed = report.whiteness_p, report.crosscorrelation_p
        if white is not None and white < P_VALUE_LIMIT:
            found.append(f"the residuals are not white ({p_text(white)}): the model lacks dynamics of the noise")
        if crossed is not None and crossed < P_VALUE_LIMIT:
            found.append(
                f"the residuals still depend on the inputs ({p_text(crossed)}): a higher order, a delay or nonlinearity is missing"
            )
        return found

    def _hardly_turns(self) -> list[str]:
        """Return the one cause of a model that explains less than half: an input left out, or belts or a vehicle that hardly turn.

        Residuals, order and gain of such a model say nothing of their own.
        """
        fit = self._turn_fit
        if (fit is None and not self.log.findings) or max(self._explained.values()) >= 100.0 * HALF:
            return []
        if fit is None:
            return [f"{self.log.findings[0]}; it explains nothing: move each input by itself"]
        cause = [f"{line}; record a drive with curves to both sides" for line in self._collinearity()]
        lines = () if cause and self.findings.is_table else self.findings.lines
        return [*lines, *(f"the vehicle hardly turns: {line}" for line in cause or input_noise_warning(fit))]

    def with_structure(self) -> "Identified":
        """Return the result with the turn model by names, if that contradicts a model of feedback or one that fits no better."""
        fit, names = self._turn_fit, self.fitted[0].output_names
        if fit is None or self._contradiction is None or turn_channels(names).count < len(names):
            return self
        structured = turn_model(fit, max(self._recent, key=len))
        if not (self.findings.is_table or self._prefers(structured, fit)):
            return self
        moved = without_delays(self.fitted, structured.input_delay)
        units, fitting = units_of(moved), replace(self.found.fitting, feedthrough=fit.shift == 0)
        inputs = np.maximum(units.input_scale, ROUNDING**0.5 * units.input_scale.max())  # one belt may be constant
        units = replace(units, scale=np.append(inputs, units.output_scale))
        system = of_model(structured, units)
        with suppress(np.linalg.LinAlgError):  # a table: no output shows the state
            system = Fitting(data=replace(self.gram, units=units), records=moved, feedthrough=fitting.feedthrough).with_gain(system)
        model = replace(
            structured,
            observer_gain=None if system.K is None else system.K / units.output_scale,
            provenance={"method": self.method, "order": structured.order, "step": "structure", NAME_PRIOR: True},
        )
        found = replace(self.found, subspace="by names", order=structured.order, step="structure", system=system, fitting=fitting)
        result = replace(self, free=model, found=found, differential=None)
        # What was found about the records, and about the free model, still holds.
        vars(result).update({name: vars(self)[name] for name in ("findings", "_turn_fit", "_contradiction") if name in vars(self)})
        return result

    def _prefers(self, structured: LinearModel, fit: TurnFit) -> bool:
        """Return whether names and data speak for the structure."""
        if not self.findings.is_integral:
            return False
        if self.findings.has_feedback and fit.belts is not None:
            return True
        is_large = self._contradiction is not None and self._contradiction.is_large
        return fits_as_well(structured, self.free, self._recent, is_large=is_large)

    def _turn_warnings(self) -> list[str]:
        """Return how the model's yaw gain agrees with the skid-steer fit."""
        fit, off = self._turn_fit, self._contradiction
        # A model with a fault says what its log says, but for a heading that was wrapped.
        faults = turn_faults(self.model) if self.name_prior else []
        faults += [line for line in self.findings.headings if not faults or line.startswith("wrapped")]
        if fit is None:
            return faults
        if off is None or not (self._is_structure or off.is_large):
            return [*faults, *input_noise_warning(fit)]
        if not self._is_structure:
            line = f"yaw gain: {off}: feedback, noise of the inputs or too high an order; tune no model before they agree"
        else:
            why = "whose steady gain is a guess" if off.is_large else "which explains no more"
            why = "which feedback may have made the controller's inverse" if self.findings.has_feedback else why
            line = f"the model is a gain and a lag, by the columns' names: {off}; --no-name-prior keeps the free model, {why}"
        return [*faults, *input_noise_warning(fit), line]

    def _collinearity(self) -> list[str]:
        """Return which inputs are nearly collinear, so that their separate effects are poorly determined."""
        u, names = np.vstack([record.u for record in self.fitted]), self.model.input_names
        if self.log.differential is not None or len(names) == 1:
            return []
        values, V = np.linalg.eigh(np.corrcoef(u[np.isfinite(u).all(axis=1)].T))
        if values[0] > COLLINEAR_VARIANCE:
            return []
        one, other = (names[int(k)] for k in np.argsort(-np.abs(V[:, 0]))[:2])
        apart = "the component that separates them" if self.differential is None else "their difference, the effective input,"
        return [f"'{one}' and '{other}' move nearly together; {apart} has {100.0 * float(values[0]):.0f} % of one input's variance"]

    def _excitation_warning(self, support: int) -> list[str]:
        remedy = "move each input independently" if self.differential is None else "turn more"
        result = [f"poor excitation: {line}: {remedy}" for line in self._collinearity()]
        if support < (order := self.found.system.order) and support <= self.found.fitting.data.lags:
            result.append(f"poor excitation: {insufficient_excitation(support, order)}; give inputs that vary more")
        return result
