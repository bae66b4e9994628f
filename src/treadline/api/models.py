"""``tl.identify``, ``tl.load_model`` and ``tl.tune``: from arrays to a linear model, from a model to a controller."""

from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from treadline.control import tune as tuned
from treadline.core.errors import RecordError, SettingsError
from treadline.core.models import ControllerDesign, InputOutputRecord, LinearModel, Reconstruct
from treadline.identification import IdentificationOptions, Identified
from treadline.identification import identify as identified


def identify(
    u: Any,
    y: Any,
    dt: float,
    options: IdentificationOptions | None = None,
    **keywords: Any,
) -> Identified:
    """Return the linear model x[k+1] = Ax[k] + Bu[k], y[k] = Cx[k] + Du[k] that fits recorded data.

    Args:
        u: Inputs: array of one row per sample, or a data frame, whose column names are kept.
        y: Outputs, likewise, sampled together with ``u``.
        dt: Sampling period [s].
        options: Options of the identification; the data decide what is left out.
        keywords: Fields of ``IdentificationOptions``, instead of ``options``: ``order=2, method="okid-era", validation=0.3``.

    Returns:
        ``.model``, the ``LinearModel``, and ``.report``, its quality with warnings.

    Raises:
        RecordError: If the data cannot carry what is asked.
        SettingsError: If an option is unknown or out of range.
    """
    (inputs, input_names), (outputs, output_names) = _columns("u", u), _columns("y", y)
    record = InputOutputRecord(u=inputs, y=outputs, dt_s=dt, input_names=input_names, output_names=output_names)
    return identified(record, _options(options, keywords))


def _options(options: IdentificationOptions | None, keywords: dict[str, Any]) -> IdentificationOptions:
    """Return the options, given as one object or as keywords."""
    if options is not None and keywords:
        raise SettingsError(f"{', '.join(keywords)} and options are given; put every option into one IdentificationOptions")
    known = [item.name for item in fields(IdentificationOptions)]
    for name in keywords:
        if name not in known:
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
            raise SettingsError(f"identify has no option '{name}'; {hint}")
    return IdentificationOptions(**keywords) if options is None else options


def load_model(path: str | Path) -> LinearModel:
    """Return the model in a JSON file that ``treadline identify`` wrote.

    Raises:
        SettingsError: If the file is missing, not JSON, or not a model.
    """
    return LinearModel.load(Path(path))


def tune(
    model: LinearModel | Identified | str | Path,
    *,
    state_weight: Sequence[float] | None = None,
    output_weight: Sequence[float] | None = None,
    input_weight: Sequence[float] | None = None,
    period_s: float | None = None,
    reconstruct: Reconstruct = "observer",
    vehicle: str = "wheelchair",
) -> ControllerDesign:
    """Return the LQR gain (Eq. 10) and the observer of a model.

    Args:
        model: Model, result of ``tl.identify``, or model file.
        state_weight: Diagonal of Q on the states, as in Eq. (13).
        output_weight: Diagonal of Q on the outputs instead: heading, yaw rate; 1, 0 when left out.
        input_weight: Diagonal of R, or one number for all inputs; 0.02 when left out.
        period_s: Control period [s], a multiple of 0.01; another period than the model's resamples the model.
        reconstruct: State reconstruction: ``observer``, or ``static`` for Eq. (11b).
        vehicle: Name of the chair that the controller is for; another chair rejects it.

    Raises:
        ModelError: If the model cannot be stabilised or observed, or a weight is not definite.
        SettingsError: If weights are given twice, or the period is no multiple of 0.01 s.
    """
    if isinstance(model, Identified):
        model = model.model
    return tuned(
        load_model(model) if isinstance(model, str | Path) else model,
        state_weight=state_weight,
        output_weight=output_weight,
        input_weight=input_weight,
        period_s=period_s,
        reconstruct=reconstruct,
        vehicle=vehicle,
    )


def _columns(name: str, given: Any) -> tuple[Any, tuple[str, ...]]:
    """Return samples and column names; only a data frame or a series (pandas, polars) has names."""
    if not hasattr(given, "to_numpy"):
        return given, ()
    values = np.asarray(given.to_numpy())
    try:
        values = values.astype(float)
    except (TypeError, ValueError):
        raise RecordError(f"{name}: a column of the data frame holds no numbers; select the columns that were measured") from None
    columns = getattr(given, "columns", None)
    series = getattr(given, "name", None)
    names = [series] if columns is None and series is not None else [] if columns is None else list(columns)
    return values, tuple(str(item) for item in names)
