"""Treadline's identification methods in the form of the benchmark."""

from typing import Any

import numpy as np

from treadline.core.errors import TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.identification import era
from treadline.identification._gram import gram_of, units_of

WAYS: dict[str, dict[str, Any]] = {
    "okid-era (gram)": {"method": "okid-era", "solver": "gram"},
    "okid-era (qr)": {"method": "okid-era", "solver": "qr"},
    "pbsid": {"method": "pbsid"},
    "best": {"method": "best"},
}
"""Arguments of ``identify`` by name."""

FAILURES = (TreadlineError, np.linalg.LinAlgError)
"""What counts as a failed run; the second would be a fault of ours, and is counted, not hidden by a crash."""


def gram_alone(record: InputOutputRecord, lags: int) -> None:
    """Accumulate the Gram matrix, channel scales included, and nothing else."""
    gram_of([record], lags, units_of([record]))


def realise(markov: np.ndarray, order: int, rows: int) -> None:
    """Decompose a Hankel matrix of ``rows`` blocks and realise an order."""
    era(markov, order, rows=rows)
