"""Treadline's identification methods in the form of the benchmark."""

from typing import Any

import numpy as np
from systems import StateSpace

from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.identification import era
from treadline.identification._gram import gram, units_of

WAYS: dict[str, dict[str, Any]] = {
    "okid-era (gram)": {"method": "okid-era", "solver": "gram"},
    "okid-era (qr)": {"method": "okid-era", "solver": "qr"},
    "era-dc": {"method": "era-dc"},
    "pbsid": {"method": "pbsid"},
    "best": {"method": "best"},
}
"""Arguments of ``identify`` by name."""

FAILURES = (TreadlineError, np.linalg.LinAlgError)
"""What counts as a failed run; the second would be a fault of ours, and is counted, not hidden by a crash."""


def state_space(model: Any) -> StateSpace:
    """Return a ``LinearModel`` in the benchmark's own terms."""
    return StateSpace(
        A=model.A,
        B=model.B,
        C=model.C,
        D=model.D,
        input_offset=model.input_offset,
        output_offset=model.output_offset,
    )


def gram_alone(record: InputOutputRecord, lags: int) -> None:
    """Accumulate the Gram matrix, channel scales included, and nothing else."""
    gram(record, lags, units_of([record]))


def realise(markov: np.ndarray, order: int, rows: int) -> None:
    """Decompose a Hankel matrix of ``rows`` blocks and realise an order."""
    era(markov, order, rows=rows)
