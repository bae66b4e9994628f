"""Figures of models, responses and comparisons: what their method ``plot`` returns."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from treadline.core.errors import SettingsError
from treadline.core.files import write_whole
from treadline.core.model_scores import Comparison
from treadline.core.models import LinearModel
from treadline.core.transfer_function import FrequencyResponse, StabilisationDiagram, TimeResponse
from treadline.report import _model_figures as figures
from treadline.report._model_runs import cut
from treadline.report.labels import ColumnLabel, channel
from treadline.report.walk_figure import walk_figure
from treadline.vehicle.walk import Walk

FORMATS = (".svg", ".png", ".pdf")


def figure_of(item: object) -> Figure:
    """Return the figure of a model, a response, a comparison, a stabilisation diagram, a walk, or of a picture.

    A model has step response, magnitude and phase of each output in three rows, one column per input. A free run of a comparison is
    cut where it leaves the data.

    Raises:
        TypeError: If the item is none of these.
    """
    match item:
        case Walk():
            return walk_figure(item.ground, item.chair, item.columns)
        case TimeResponse():
            dt_s = float(item.t_s[1]) if len(item.t_s) > 1 else 1.0
            return figures.time_response(item.y, None, dt_s, *_labels(item), after=item.kind)
        case FrequencyResponse():
            return figures.bode((item.frequency_hz, item.response), *_labels(item))
        case LinearModel():
            response = item.bode()
            return figures.bode((response.frequency_hz, response.response), *_labels(response), step=item.step())
        case StabilisationDiagram():
            return figures.stabilisation(item)
        case Comparison():
            shown, ahead = (cut(values, item.measured)[0] for values in (item.modelled, item.ahead))
            labels = [channel(name) for name in item.percent]
            return figures.fit(item.t_s, item.measured, shown, ahead, None, labels, kind=item.kind)
        case np.ndarray():
            figure = Figure(figsize=(item.shape[1] / 100.0, item.shape[0] / 100.0))
            figure.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False, xticks=[], yticks=[]).imshow(item)
            return figure
    raise TypeError(f"there is no figure of a {type(item).__name__}")


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
