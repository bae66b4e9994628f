"""python-control: a finite impulse response by least squares, then its eigensystem realisation."""

import importlib.metadata

import numpy as np
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

PACKAGE = "python-control"
INSTALL = "pip install control"


def missing() -> str | None:
    """Return why the package cannot be used."""
    try:
        import control  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def version() -> str:
    """Return what is installed."""
    return f"control {importlib.metadata.version('control')}"


def methods() -> dict[str, Fit]:
    """Return its one way."""
    return {"python-control": fit}


def fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order from ``2 block_rows + 1`` Markov parameters."""
    import control

    m, p = record.u.shape[1], record.y.shape[1]
    count = 2 * block_rows + 1
    if count * m > len(record.u) or min(m, p) * block_rows < order:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(record.u)} samples")
    # The first rows, whose past is unknown, are left out: their zeros would be wrong for a record that starts in motion.
    markov = control.markov(record.y.T, record.u.T, count, truncate=True).reshape(p, m, count)
    system, _ = control.eigensys_realization(markov, order, m=block_rows, n=block_rows)
    return without_offsets(*(np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D)))
