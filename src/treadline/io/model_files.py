"""Linear models as files: JSON, or a MAT file for MATLAB.

A MAT file holds the matrices under their usual names: A, B, C, D, dt, the observer gain K, the offsets u0 and y0, the dead time
input_delay of each input in samples (MATLAB's InputDelay), and the names of inputs and outputs.
"""

import io
import json
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.io import savemat

from treadline.core.errors import SettingsError
from treadline.core.files import write_whole
from treadline.core.models import LinearModel


def write_model(model: LinearModel, path: Path) -> None:
    """Write a model as JSON or as a MAT file (version 5), depending on the suffix.

    Raises:
        SettingsError: If the suffix is neither ``.json`` nor ``.mat``.
    """
    if path.is_dir():
        raise SettingsError(f"{path}: is a folder; give a file name, model.json or model.mat")
    suffix = path.suffix.lower()
    if suffix not in {".json", ".mat"}:
        raise SettingsError(f"{path}: unsupported model format '{suffix}'; supported: .json, .mat")
    if suffix == ".json":
        model.save(path)
        return
    variables: dict[str, Any] = {
        **{name: getattr(model, name) for name in "ABCD"},
        "dt": model.dt_s,
        "u0": model.input_offset,
        "y0": model.output_offset,
        "input_delay": np.array(model.input_delay, dtype=float),
        "input_names": np.array(model.input_names, dtype=object),
        "output_names": np.array(model.output_names, dtype=object),
        "provenance": json.dumps(dict(model.provenance)),
    }
    if model.observer_gain is not None:
        variables["K"] = model.observer_gain
    data = io.BytesIO()
    savemat(cast("Any", data), variables, oned_as="column")
    write_whole(path, data.getvalue())
