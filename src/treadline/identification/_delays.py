"""Dead time of each input: estimated from the observer, removed from the data, restored in the model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification.okid import ObserverMarkov
from treadline.identification.validate import chi2_tail

SIGNIFICANCE = 1e-4
"""p-value below which an input's coefficients of one lag differ significantly from zero."""


def input_delays(observer: ObserverMarkov) -> list[int]:
    """Return the delay of each input in samples: 0 with feedthrough, 1 without, more with dead time.

    The delay is the first lag with coefficients significantly different from zero (Wald test against their covariance). An
    input without a significant lag has delay 1.
    """
    o = observer.scaled()
    lags, _, m = o.alpha.shape
    weight = np.linalg.pinv(o.residual_covariance)
    first = 1 + (m if o.feedthrough else 0)
    variance = np.diag(o.parameter_covariance)
    r = m + len(o.D)
    found = []
    for j in range(m):
        effects = [(lag, o.alpha[lag - 1, :, j], variance[first + (lag - 1) * r + j]) for lag in range(1, lags + 1)]
        if o.feedthrough:
            effects.insert(0, (0, o.D[:, j], variance[1 + j]))
        significant = (lag for lag, a, s in effects if chi2_tail(float(a @ weight @ a) / max(s, 1e-300), a.size) < SIGNIFICANCE)
        found.append(next(significant, 1))
    return found


def without_delays(records: Sequence[InputOutputRecord], shifts: Sequence[int]) -> list[InputOutputRecord]:
    """Return the records with each input delayed by its dead time.

    Raises:
        SettingsError: If there is not one shift per input, or a shift is negative or as long as a record.
    """
    m, most = records[0].u.shape[1], max(shifts, default=0)
    whole = all(isinstance(shift, int | np.integer) for shift in shifts)
    if not whole or len(shifts) != m or min(shifts) < 0 or most >= min(len(record) for record in records):
        raise SettingsError(f"delays are {list(shifts)}; give one integer per input ({m}), from 0 to less than a record's length")
    made = []
    for record in records:
        u = np.column_stack([record.u[most - d : len(record) - d, j] for j, d in enumerate(shifts)])
        made.append(replace(record, u=u, y=record.y[most:]))
    return made


def with_delays(model: LinearModel, shifts: Sequence[int]) -> LinearModel:
    """Return the model with each input's dead time as a chain of delay states."""
    n, m, p = model.order, model.B.shape[1], len(model.C)
    total = n + sum(shifts)
    A, B = np.zeros((total, total)), np.zeros((total, m))
    C, D = np.zeros((p, total)), np.zeros((p, m))
    A[:n, :n], C[:, :n] = model.A, model.C
    at = n
    for j, d in enumerate(shifts):
        if d == 0:
            B[:n, j], D[:, j] = model.B[:, j], model.D[:, j]
            continue
        # The last state of the chain is the delayed input.
        B[at, j] = 1.0
        A[at + 1 : at + d, at : at + d - 1] = np.eye(d - 1)
        A[:n, at + d - 1], C[:, at + d - 1] = model.B[:, j], model.D[:, j]
        at += d
    gain = None if model.observer_gain is None else np.vstack([model.observer_gain, np.zeros((total - n, p))])
    return replace(model, A=A, B=B, C=C, D=D, observer_gain=gain)
