"""modred: OKID as in Juang's book (first rows padded with zeros: it wants records that start at rest), then ERA."""

import importlib.metadata

import numpy as np
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

PACKAGE = "modred"
INSTALL = 'pip install "setuptools<81" wheel future && pip install --no-build-isolation modred'


def missing() -> str | None:
    """Return why the package cannot be used."""
    try:
        import modred  # noqa: F401
    except Exception as error:  # noqa: BLE001 (an old package may fail in any way with a new numpy)
        return f"{type(error).__name__}: {error}"
    return None


def version() -> str:
    """Return what is installed."""
    return f"modred {importlib.metadata.version('modred')}"


def methods() -> dict[str, Fit]:
    """Return its one way."""
    return {"modred OKID/ERA": fit}


def fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order; it takes as many lags as Markov parameters, 3 more than two blocks."""
    import modred

    m, p = record.u.shape[1], record.y.shape[1]
    count = 2 * block_rows + 3
    if (m + p) * (count + 1) > len(record.u) or min(m, p) * block_rows < order:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(record.u)} samples")
    markov = modred.OKID(record.u.T, record.y.T, count)
    _, sampled = modred.era.make_sampled_format(np.arange(count - 1), markov[1:])
    A, B, C = modred.ERA(verbosity=0).compute_model(sampled, order)
    return without_offsets(*(np.asarray(matrix) for matrix in (A, B, C, markov[0])))
