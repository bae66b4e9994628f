"""How well a model reproduces a record: free run or forecast, one-step prediction, and tests of the residuals."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.arrays import finite_or_none, spectral_radius
from treadline.core.linear_systems import (
    TESTED_LAGS,
    crosscorrelation_p,
    fair_run,
    percent_of,
    predictions,
    prefix,
    vaf_percent,
    whiteness_p,
    without_dead_time,
)
from treadline.core.printing import Plottable, Printable, p_text, percent_text
from treadline.core.state_space import InputOutputRecord, StateSpaceModel, channel_names
from treadline.core.transfer_function import is_unstable

TESTED_SAMPLES_MIN = 2 * TESTED_LAGS
"""Smallest number of samples with residual tests: two for each lag."""
FORECAST_STEPS = 10
"""Shortest forecast that is compared with persistence, and stands in place of a free run of an unstable model [samples]."""
GROWTH = 3.0
"""Growth of an unstable mode over a longer forecast, and decay of a mode that is no drift over a record, as a power of e."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FitScores:
    """How well a model reproduces data, by output: free run or forecast, one-step prediction, and tests of the residuals.

    A free run starts from a state that the first samples of a record determine, and is scored after them. An unstable model
    has no free run that means anything; a forecast of ``forecast_horizon_s``, from every sample, stands in its place.
    """

    fit_percent: dict[str, float] | None
    """Fit of the free run by output [%]: 100 (1 - ‖y - ŷ‖/‖y - mean‖); None for an unstable model."""
    fit_prefix_s: float
    """Time at the start of the record that determines the initial state and is not scored [s]."""
    forecast_percent: dict[str, float] | None
    """The same measure for forecasts; None for a stable model."""
    persistence_percent: dict[str, float] | None
    """The same measure for outputs that stay as they are over the horizon; None for a stable model."""
    forecast_horizon_s: float | None
    one_step_vaf_percent: dict[str, float]
    """Variance accounted for one step ahead [%]."""
    whiteness_p: float | None
    crosscorrelation_p: float | None
    """p-values of white residuals, and of residuals independent of the inputs; None for too few samples."""

    @property
    def percent(self) -> dict[str, float]:
        """Fit of the free run, or of the forecast for an unstable model [%]."""
        return self.fit_percent or self.forecast_percent or {}

    @property
    def in_words(self) -> list[tuple[str, str]]:
        """Each output, with its fit and its variance accounted for in words."""
        ahead = self.one_step_vaf_percent
        return [
            (name, f"{percent_text(value)}, {percent_text(ahead[name])} of the variance one step ahead")
            for name, value in self.percent.items()
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Comparison(FitScores, Printable, Plottable):
    """A model and a record that it should reproduce."""

    samples: int
    """Samples scored."""
    t_s: Float[np.ndarray, " T"]
    measured: Float[np.ndarray, "T p"]
    modelled: Float[np.ndarray, "T p"]
    """Free run, or forecast for an unstable model."""
    ahead: Float[np.ndarray, "T p"]
    """Predictions one step ahead."""

    @property
    def kind(self) -> str:
        """Kind of the modelled outputs: free run, or forecast with its horizon."""
        return "free run" if self.forecast_horizon_s is None else f"forecast, {self.forecast_horizon_s:.3g} s ahead"

    @property
    def conditions(self) -> str:
        """Kind of run, start and horizon in words."""
        if self.persistence_percent is not None:
            known = ", ".join(f"{name} {percent_text(value)}" for name, value in self.persistence_percent.items())
            ahead = f"forecast {self.forecast_horizon_s:.4g} s ahead (unstable model), {self.samples} samples"
            return f"{ahead}; outputs that stay as they are fit {known}"
        return f"free run from the state of the first {self.fit_prefix_s:.4g} s, scored on the {self.samples} samples after them"

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return conditions, fit and tests."""
        rows = [(name, f"fit {words}") for name, words in self.in_words]
        rows.append(("white residuals", p_text(self.whiteness_p)))
        rows.append(("residuals independent of the inputs", p_text(self.crosscorrelation_p)))
        return self.conditions, rows


def compare(model: StateSpaceModel, record: InputOutputRecord) -> Comparison:
    """Return the comparison of a model with a record."""
    names = channel_names(model)[1]
    unstable, steps = is_unstable(model), forecast_steps(model, len(record))
    run, scored = fair_run(model, record)
    with np.errstate(over="ignore", invalid="ignore"):
        ahead, run = predictions(model, record), predictions(model, record, steps) if unstable else run
        residuals = np.where(scored[:, None], record.y - ahead, np.nan)
    before = _persisting(record, steps)
    first = prefix(len(record), model.order, len(model.C))
    percent, stays = (dict(zip(names, percent_of(record.y[scored], item[scored]).tolist(), strict=True)) for item in (run, before))
    known = np.isfinite(residuals)
    tested = int(known.all(axis=1).sum()) >= TESTED_SAMPLES_MIN
    vaf = vaf_percent(record.y[scored], residuals[scored])
    return Comparison(
        fit_percent=None if unstable else percent,
        fit_prefix_s=first * model.dt_s,
        forecast_percent=percent if unstable else None,
        persistence_percent=stays if unstable else None,
        forecast_horizon_s=steps * model.dt_s if unstable else None,
        one_step_vaf_percent=dict(zip(names, vaf.tolist(), strict=True)),
        whiteness_p=finite_or_none(whiteness_p(residuals)) if tested else None,
        crosscorrelation_p=finite_or_none(crosscorrelation_p(residuals, without_dead_time(model, record)[1].u)) if tested else None,
        samples=int(scored.sum()),
        t_s=np.arange(len(record)) * model.dt_s,
        measured=record.y,
        modelled=run,
        ahead=ahead,
    )


def forecast_steps(model: StateSpaceModel, samples: int) -> int:
    """Return the length of a forecast: ten samples; in an unstable mode's time to grow twentyfold, up to a tenth of all."""
    if not is_unstable(model):
        return FORECAST_STEPS
    return max(FORECAST_STEPS, min(round(GROWTH / math.log(spectral_radius(model.A))), samples // 10))


def skill_percent(model: StateSpaceModel, record: InputOutputRecord) -> dict[str, float]:
    """Return the share of the squared error of the better of mean and persistence that a forecast explains, by output [%].

    The forecast is over ``forecast_steps``, and scored on the samples of ``compare``.
    """
    steps, (_, scored) = forecast_steps(model, len(record)), fair_run(model, record)
    with np.errstate(over="ignore", invalid="ignore"):
        y, forecast, before = (
            values[scored] for values in (record.y, predictions(model, record, steps), _persisting(record, steps))
        )
        known = np.isfinite(y) & np.isfinite(forecast) & np.isfinite(before)
        mean = np.sum(y, axis=0, where=known) / np.maximum(known.sum(axis=0), 1)
        error, about, moved = (np.sum((y - item) ** 2, axis=0, where=known) for item in (forecast, mean, before))
    skill = 100.0 * (1.0 - error / np.maximum(np.minimum(about, moved), 1e-300))
    return dict(zip(channel_names(model)[1], skill.tolist(), strict=True))


def _persisting(record: InputOutputRecord, steps: int) -> Float[np.ndarray, "T p"]:
    """Return the outputs some steps before; NaN at the start."""
    before = np.full(record.y.shape, np.nan)
    before[steps:] = record.y[:-steps]
    return before
