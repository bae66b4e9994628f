"""Figures of models, responses and comparisons: what their method ``plot`` returns."""

from collections.abc import Mapping
from functools import singledispatch
from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure

from treadline.core.errors import SettingsError
from treadline.core.files import write_whole
from treadline.core.model_scores import Comparison
from treadline.core.models import LinearModel
from treadline.core.transfer_function import FrequencyResponse, TimeResponse
from treadline.report import _model_figures as figures
from treadline.report._model_runs import cut
from treadline.report.labels import ColumnLabel, channel
from treadline.report.walk_figure import walk_figure
from treadline.vehicle.walk import Walk

FORMATS = (".svg", ".png", ".pdf")


@singledispatch
def figure_of(item: object) -> Figure:
    """Return the figure of a model, a response, a comparison or a walk.

    Raises:
        TypeError: If the item is none of these.
    """
    raise TypeError(f"there is no figure of a {type(item).__name__}")


@figure_of.register
def _of_walk(walk: Walk) -> Figure:
    """Return a walk: the chair at five places, and its course."""
    return walk_figure(walk.ground, walk.chair, walk.columns)


@figure_of.register
def _of_time_response(response: TimeResponse) -> Figure:
    """Return a step or impulse response, one panel per pair of input and output."""
    dt_s = float(response.t_s[1]) if len(response.t_s) > 1 else 1.0
    return figures.time_response(response.y, None, dt_s, *_labels(response), after=response.kind)


@figure_of.register
def _of_frequency_response(response: FrequencyResponse) -> Figure:
    """Return magnitude and phase over frequency, one panel each per pair of input and output."""
    return figures.bode((response.frequency_hz, response.response), *_labels(response))


@figure_of.register
def _of_model(given: LinearModel) -> Figure:
    """Return step response, magnitude and phase of each output in three rows, one column per input."""
    response = given.bode()
    return figures.bode((response.frequency_hz, response.response), *_labels(response), step=given.step())


@figure_of.register
def _of_comparison(given: Comparison) -> Figure:
    """Return measured and modelled outputs with errors below; a free run is cut where it leaves the data."""
    shown, _ = cut(given.modelled, given.measured)
    ahead, _ = cut(given.ahead, given.measured)
    labels = [channel(name) for name in given.percent]
    return figures.fit(given.t_s, given.measured, shown, ahead, None, labels, kind=given.kind)


def write_comparisons(found: Mapping[str, Comparison], path: Path) -> None:
    """Write the figure of several models on one record: measured outputs in grey, a line for each model.

    Raises:
        SettingsError: If the suffix is that of no format that matplotlib writes.
        TreadlineError: If the file cannot be written.
    """
    figure = figures.several(
        {f"{Path(name).name}, {item.kind}": (item.t_s, cut(item.modelled, item.measured)[0]) for name, item in found.items()},
        next(iter(found.values())).measured,
        [channel(name) for name in next(iter(found.values())).percent],
    )
    save_figure(figure, path)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix.

    Raises:
        SettingsError: If the suffix is that of no format that matplotlib writes.
        TreadlineError: If the file cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise SettingsError(f"{path}: unsupported figure format '{path.suffix}'; supported: {', '.join(FORMATS)}")
    data = BytesIO()
    figure.savefig(data, format=path.suffix[1:].lower())
    write_whole(path, data.getvalue())


def _labels(response: TimeResponse | FrequencyResponse) -> tuple[list[ColumnLabel], list[ColumnLabel]]:
    return [channel(name) for name in response.input_names], [channel(name) for name in response.output_names]
