"""Figures of the methods ``plot`` of a linear model and of its responses."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure

from treadline.core.errors import SettingsError
from treadline.core.files import write_whole
from treadline.core.model_scores import Comparison
from treadline.core.models import LinearModel
from treadline.core.responses import FrequencyResponse, TimeResponse
from treadline.report import _model_figures as figures
from treadline.report._model_runs import cut
from treadline.report.labels import ColumnLabel, channel

FORMATS = (".svg", ".png", ".pdf")


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


def write_comparisons(found: Mapping[str, Comparison], path: Path) -> None:
    """Write the figure of several models on one record: measured outputs in grey, a line for each model.

    Raises:
        SettingsError: If the suffix is that of no format that matplotlib writes.
        TreadlineError: If the file cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise SettingsError(f"{path}: unsupported figure format '{path.suffix}'; supported: {', '.join(FORMATS)}")
    figure = figures.several(
        {f"{Path(name).name}, {item.kind}": (item.t_s, cut(item.modelled, item.measured)[0]) for name, item in found.items()},
        next(iter(found.values())).measured,
        [channel(name) for name in next(iter(found.values())).percent],
    )
    data = BytesIO()
    figure.savefig(data, format=path.suffix[1:].lower())
    write_whole(path, data.getvalue())


def _labels(response: TimeResponse | FrequencyResponse) -> tuple[list[ColumnLabel], list[ColumnLabel]]:
    return [channel(name) for name in response.input_names], [channel(name) for name in response.output_names]
