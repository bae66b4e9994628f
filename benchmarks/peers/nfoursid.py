"""nfoursid: PO-MOESP with a state sequence."""

import importlib.metadata

import numpy as np
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

PACKAGE = "nfoursid"
INSTALL = "pip install nfoursid"
MOST_SAMPLES = 20_000
"""It holds block-Hankel matrices whole."""


def missing() -> str | None:
    """Return why the package cannot be used."""
    try:
        import nfoursid.nfoursid  # noqa: F401
    except Exception as error:  # noqa: BLE001 (an old package may fail in any way with a new numpy)
        return f"{type(error).__name__}: {error}"
    return None


def version() -> str:
    """Return what is installed."""
    return f"nfoursid {importlib.metadata.version('nfoursid')}"


def methods() -> dict[str, Fit]:
    """Return its one way."""
    return {"nfoursid": fit}


def fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    m, p = record.u.shape[1], record.y.shape[1]
    if order > p * block_rows or len(record.u) > MOST_SAMPLES or len(record.u) < 2 * (m + p) * block_rows:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(record.u)} samples")
    inputs, outs = [f"u{i}" for i in range(m)], [f"y{i}" for i in range(p)]
    table = pd.DataFrame(np.hstack([record.u, record.y]), columns=[*inputs, *outs])
    work = NFourSID(table, outs, inputs, num_block_rows=block_rows)
    work.subspace_identification()
    model, _ = work.system_identification(rank=order)
    return without_offsets(model.a, model.b, model.c, model.d)
