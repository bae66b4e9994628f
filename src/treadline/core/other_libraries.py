"""A linear model for other programs: objects of python-control and SciPy, text to paste into Python or MATLAB, and a MAT file."""

import io
import json
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy import signal
from scipy.io import savemat

from treadline.core.errors import ModelError
from treadline.core.files import write_whole
from treadline.core.state_space import StateSpaceModel

LIBRARIES = ("control", "scipy")
ROUNDING = 1e-12
"""Size, relative to the largest, below which a coefficient of a polynomial is rounding error."""


def statespace(model: StateSpaceModel, library: str | None = None, *, in_continuous_time: bool = False) -> Any:
    """Return ``control.StateSpace`` or ``scipy.signal.StateSpace``, as ``LinearModel.to_statespace`` and ``to_continuous`` state.

    Raises:
        ModelError: If the library is neither, or python-control is not installed.
    """
    there = find_spec("control") is not None
    chosen = library or ("control" if there else "scipy")
    if chosen not in LIBRARIES:
        raise ModelError(f"library is {library!r}; allowed: {', '.join(LIBRARIES)}")
    if in_continuous_time:
        from treadline.core.sampling import continuous as matrices_of
    else:
        matrices_of = with_delay_states
    matrices = matrices_of(model)
    if chosen == "scipy":
        return signal.StateSpace(*matrices, **({} if in_continuous_time else {"dt": model.dt_s}))
    if not there:
        raise ModelError("python-control is not installed: pip install control, or give library='scipy'")
    import control

    names = {"inputs": list(model.input_names), "outputs": list(model.output_names)}
    period_s = 0 if in_continuous_time else model.dt_s
    return control.StateSpace(*matrices, period_s, **{key: value for key, value in names.items() if value})


def with_delay_states(model: StateSpaceModel) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, D with the dead time of each input as a chain of states, the last of which is the delayed input."""
    n, total = model.order, model.order + sum(model.input_delay)
    A, B, C, D = np.eye(total, k=-1), np.zeros((total, model.B.shape[1])), np.zeros((len(model.C), total)), model.D.copy()
    A[: n + 1, :] = 0.0
    A[:n, :n], C[:, :n] = model.A, model.C
    first = n
    for j, delay in enumerate(model.input_delay):
        if delay == 0:
            B[:n, j] = model.B[:, j]
            continue
        A[first, :], B[first, j] = 0.0, 1.0
        first += delay
        A[:n, first - 1], C[:, first - 1], D[:, j] = model.B[:, j], model.D[:, j], 0.0
    return A, B, C, D


def as_python(model: StateSpaceModel) -> str:
    """Return Python text that makes the model anew, to the last digit."""
    arrays = {name: getattr(model, name) for name in ("A", "B", "C", "D", "input_offset", "output_offset")}
    if model.observer_gain is not None:
        arrays["observer_gain"] = model.observer_gain
    rows = [f"    {name}=np.array({value.tolist()!r}).reshape({value.shape})," for name, value in arrays.items()]
    named = {
        "dt_s": model.dt_s,
        "input_delay": model.input_delay,
        "input_names": model.input_names,
        "output_names": model.output_names,
    }
    rows += [f"    {name}={value!r}," for name, value in named.items()]
    return "\n".join(["import numpy as np", "import treadline as tl", "", "model = tl.LinearModel(", *rows, ")"])


def as_matlab(model: StateSpaceModel) -> str:
    """Return MATLAB text that makes a state-space object of the Control System Toolbox; offsets are variables next to it."""
    rows = [f"{name} = {_matlab(getattr(model, name))};" for name in "ABCD"]
    rows += [f"u0 = {_matlab(model.input_offset[:, None])};  % inputs at the operating point: model input is u - u0"]
    rows += [f"y0 = {_matlab(model.output_offset[:, None])};  % outputs there: measured output is y0 + model output"]
    if model.observer_gain is not None:
        rows.append(f"K = {_matlab(model.observer_gain)};  % x[k+1] = A*x[k] + B*(u[k] - u0) + K*(y[k] - yhat[k])")
    delay = f", 'InputDelay', {list(model.input_delay)}" if any(model.input_delay) else ""
    rows.append(f"model = ss(A, B, C, D, {model.dt_s!r}{delay});")
    for name, given in (("InputName", model.input_names), ("OutputName", model.output_names)):
        quoted = ", ".join("'" + item.replace("'", "''").replace("\n", " ") + "'" for item in given)
        rows += [f"model.{name} = {{{quoted}}};"] if given else []
    return "\n".join(rows)


def _matlab(matrix: np.ndarray) -> str:
    if matrix.size == 0:
        return f"zeros({matrix.shape[0]}, {matrix.shape[1]})"
    return "[" + "; ".join(" ".join(repr(float(value)) for value in row) for row in matrix) + "]"


def transfer_function(model: StateSpaceModel) -> Any:
    """Return ``scipy.signal.TransferFunction`` from the first input to the first output; dead time becomes poles at zero."""
    numerator, denominator = transfer_functions(model)[0][2:]
    live = np.flatnonzero(np.abs(numerator) > ROUNDING * np.abs(numerator).max())
    numerator = numerator[live[0] if live.size else -1 :]  # SciPy warns of leading zeros
    return signal.TransferFunction(numerator, np.append(denominator, np.zeros(model.input_delay[0])), dt=model.dt_s)


def transfer_functions(model: StateSpaceModel) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """Return output, input, numerator and denominator of each pair, coefficients of falling powers of z."""
    found = []
    for j in range(model.B.shape[1]):
        numerators, denominator = signal.ss2tf(model.A, model.B, model.C, model.D, input=j)
        found += [(i, j, numerators[i], denominator) for i in range(model.C.shape[0])]
    return found


def as_transfer_function(model: StateSpaceModel, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    """Return text with the transfer function of each pair, rounded to six digits."""
    rows = [f"z is one sample of {model.dt_s:g} s ahead"]
    for i, j, numerator, denominator in transfer_functions(model):
        late = f" z^-{model.input_delay[j]}" if model.input_delay[j] else ""
        rows.append(f"{outputs[i]} / {inputs[j]} = ({_polynomial(numerator)}) / ({_polynomial(denominator)}){late}")
    return "\n".join(rows)


def _polynomial(coefficients: np.ndarray) -> str:
    """Return a polynomial in z as text; coefficients that are rounding errors of the largest are left out."""
    size, degree = float(np.abs(coefficients).max(initial=0.0)), len(coefficients) - 1
    text = ""
    for k, value in enumerate(coefficients.tolist()):
        if abs(value) <= ROUNDING * size:
            continue
        power = degree - k
        sign = "-" if value < 0.0 else "+"
        factor = "" if power and abs(value) == 1.0 else f"{abs(value):.6g} "
        body = (factor + (f"z^{power}" if power > 1 else "z" if power else "")).strip()
        text += f" {sign} {body}" if text else f"{'-' if value < 0.0 else ''}{body}"
    return text or "0"


def write_mat(model: StateSpaceModel, path: Path) -> None:
    """Write a model as a MAT file, as ``LinearModel.save`` states."""
    gain = {} if model.observer_gain is None else {"K": model.observer_gain}
    names = {key: np.array(getattr(model, key), dtype=object) for key in ("input_names", "output_names")}
    variables: dict[str, Any] = {**{name: getattr(model, name) for name in "ABCD"}, **gain, **names}
    variables |= {"dt": model.dt_s, "u0": model.input_offset, "y0": model.output_offset}
    variables |= {"input_delay": np.array(model.input_delay, dtype=float), "provenance": json.dumps(dict(model.provenance))}
    data = io.BytesIO()
    savemat(cast("Any", data), variables, oned_as="column")
    write_whole(path, data.getvalue())
