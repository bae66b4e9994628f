"""Figures of the methods ``plot`` of a linear model and of its responses."""

from matplotlib.figure import Figure

from treadline.core.model_scores import Comparison
from treadline.core.models import LinearModel
from treadline.core.responses import FrequencyResponse, TimeResponse
from treadline.report import _model_figures as figures
from treadline.report._model_runs import cut
from treadline.report.labels import ColumnLabel, channel


def time_response(response: TimeResponse) -> Figure:
    """Return a step or impulse response, one panel per pair of input and output."""
    dt_s = float(response.t_s[1]) if len(response.t_s) > 1 else 1.0
    return figures.time_response(response.y, None, dt_s, *_labels(response), after=response.kind)


def bode(response: FrequencyResponse) -> Figure:
    """Return magnitude and phase over frequency, one panel each per pair of input and output."""
    return figures.bode((response.frequency_hz, response.response), *_labels(response))


def model(given: LinearModel) -> Figure:
    """Return step response, magnitude and phase of each output in three rows, one column per input."""
    response = given.bode()
    return figures.bode((response.frequency_hz, response.response), *_labels(response), step=given.step())


def comparison(given: Comparison) -> Figure:
    """Return measured and modelled outputs with errors below; a free run is cut where it leaves the data."""
    shown, _ = cut(given.modelled, given.measured)
    ahead, _ = cut(given.ahead, given.measured)
    labels = [channel(name) for name in given.percent]
    return figures.fit(given.t_s, given.measured, shown, ahead, None, labels, kind=given.kind)


def _labels(response: TimeResponse | FrequencyResponse) -> tuple[list[ColumnLabel], list[ColumnLabel]]:
    return [channel(name) for name in response.input_names], [channel(name) for name in response.output_names]
