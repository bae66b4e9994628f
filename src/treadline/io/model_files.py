"""Linear models in file formats of other tools, and conversion to and from python-control.

``.json`` is the native format; ``.mat`` contains the matrices under their usual names: A, B, C, D, dt, the observer gain K, the
offsets u0 and y0, and the names of inputs and outputs. The round trip is exact.
"""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float64
from scipy.io import savemat

from treadline.core.errors import LogFormatError, ModelError, NotFinite, RecordError, SettingsError, ShapeMismatch, TreadlineError
from treadline.core.models import LinearModel, write_whole
from treadline.io.mat import load_mat

if TYPE_CHECKING:
    from control import StateSpace

_MATRICES = ("A", "B", "C", "D")


def write_model(model: LinearModel, path: Path) -> None:
    """Write a model as JSON or as a MAT file (version 5), depending on the suffix.

    Raises:
        SettingsError: If the suffix is neither ``.json`` nor ``.mat``.
    """
    if _suffix(path) == ".json":
        model.save(path)
        return
    variables: dict[str, Any] = {
        **{name: getattr(model, name) for name in _MATRICES},
        "dt": model.dt_s,
        "u0": model.input_offset,
        "y0": model.output_offset,
        "input_names": np.array(model.input_names, dtype=object),
        "output_names": np.array(model.output_names, dtype=object),
        "provenance": json.dumps(model.provenance),
    }
    if model.observer_gain is not None:
        variables["K"] = model.observer_gain
    data = io.BytesIO()
    savemat(cast("Any", data), variables, oned_as="column")
    write_whole(path, data.getvalue())


def read_model(path: Path) -> LinearModel:
    """Return the model in a JSON or MAT file.

    Raises:
        SettingsError: If the file is missing, damaged, or not a model.
    """
    if _suffix(path) == ".json":
        return LinearModel.load(path)
    if not path.is_file():
        raise SettingsError(f"{path}: no such file")
    try:
        return _model_of(load_mat(path))
    except LogFormatError as error:
        raise SettingsError(str(error)) from None
    except (ModelError, RecordError, TypeError, ValueError) as error:
        raise SettingsError(f"{path}: not a model: {error}") from None


@runtime_checkable
class StateSpaceLike(Protocol):
    """Protocol of a discrete state-space system: python-control's StateSpace, scipy's dlti, harold's State."""

    A: Any
    B: Any
    C: Any
    D: Any
    dt: Any


def to_statespace(model: LinearModel) -> "StateSpace":
    """Return the model as python-control's StateSpace.

    StateSpace cannot hold offsets (its inputs and outputs are deviations from ``input_offset`` and ``output_offset``), the observer
    gain, or dots in names (replaced by underscores).
    """
    try:
        from control import StateSpace
    except ImportError:
        raise TreadlineError("python-control is missing: pip install '.[control]' in treadline's folder") from None
    labels = {
        key: [name.replace(".", "_") for name in names]
        for key, names in (("inputs", model.input_names), ("outputs", model.output_names))
        if names
    }
    return StateSpace(*(getattr(model, name) for name in _MATRICES), model.dt_s, remove_useless_states=False, **labels)


def from_statespace(system: StateSpaceLike) -> LinearModel:
    """Return a discrete-time system as a model without offsets.

    Raises:
        ModelError: If the system is continuous, its period is unknown, or its matrices are not real or of different orders.
    """
    dt = system.dt
    if dt is None or dt is True or not dt > 0.0:
        raise ModelError(f"the system's dt is {dt}; a model has a period: sample it first, as with control.sample_system")
    try:
        matrices = _matrices(lambda name: getattr(system, name))
        return LinearModel(
            **matrices,
            dt_s=float(dt),
            input_offset=np.zeros(matrices["B"].shape[1]),
            output_offset=np.zeros(matrices["C"].shape[0]),
            input_names=tuple(getattr(system, "input_labels", None) or ()),
            output_names=tuple(getattr(system, "output_labels", None) or ()),
        )
    except (NotFinite, ShapeMismatch) as error:
        raise ModelError(f"the system is not a valid model: {error}") from None


def _model_of(found: dict[str, Any]) -> LinearModel:
    absent = [name for name in (*_MATRICES, "dt") if name not in found]
    if absent:
        raise ModelError(f"no {', '.join(absent)} (there are: {', '.join(found)}); a model has A, B, C, D and dt")
    matrices = _matrices(found.__getitem__)
    zeros = {"u0": np.zeros(matrices["B"].shape[1]), "y0": np.zeros(matrices["C"].shape[0])}
    return LinearModel(
        **matrices,
        dt_s=float(_real("dt", found["dt"]).item()),
        input_offset=_real("u0", found.get("u0", zeros["u0"])).reshape(-1),
        output_offset=_real("y0", found.get("y0", zeros["y0"])).reshape(-1),
        observer_gain=_real("K", found["K"]) if "K" in found else None,
        input_names=tuple(map(str, found.get("input_names", ()))),
        output_names=tuple(map(str, found.get("output_names", ()))),
        provenance=dict(json.loads(found.get("provenance", "{}"))),
    )


def _matrices(matrix: Callable[[str], Any]) -> dict[str, Any]:
    found = {name: _real(name, matrix(name)) for name in _MATRICES}
    for name, value in found.items():
        if value.ndim != 2:
            raise ShapeMismatch(f"{name} has {value.ndim} dimensions; a matrix has two")
    return found


def _real(name: str, value: Any) -> Float64[np.ndarray, "..."]:
    array = np.array(value)
    if array.dtype.kind not in "biuf":
        raise ModelError(f"{name} holds {array.dtype}, not real numbers")
    return array.astype(float)


def _suffix(path: Path) -> str:
    if path.is_dir():
        raise SettingsError(f"{path}: is a folder; give a file name, model.json or model.mat")
    suffix = path.suffix.lower()
    if suffix not in {".json", ".mat"}:
        raise SettingsError(f"{path}: unsupported model format '{suffix}'; supported: .json, .mat")
    return suffix
