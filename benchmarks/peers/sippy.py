"""SIPPY (University of Pisa): N4SID, MOESP, CVA and PARSIM-K.

PARSIM-S and PARSIM-P are left out: sippy_unipi 1.0.1 adds the response to the measured outputs to every column of the
regression for B, D and x0 instead of taking it off once, which costs 3 to 7 % even without noise.
"""

import contextlib
import importlib.metadata
import io
from functools import partial

import numpy as np
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

PACKAGE = "SIPPY"
INSTALL = "pip install sippy_unipi"
MOST_SAMPLES = 20_000
"""It holds block-Hankel matrices and their pseudo-inverses whole."""


def missing() -> str | None:
    """Return why the package cannot be used."""
    try:
        import sippy_unipi  # noqa: F401
    except Exception as error:  # noqa: BLE001 (an old package may fail in any way with a new numpy)
        return f"{type(error).__name__}: {error}"
    return None


def version() -> str:
    """Return what is installed."""
    return f"sippy_unipi {importlib.metadata.version('sippy_unipi')}"


def methods() -> dict[str, Fit]:
    """Return its ways by name."""
    return {f"SIPPY {name}": partial(fit, method=name) for name in ("N4SID", "MOESP", "CVA", "PARSIM-K")}


def fit(record: InputOutputRecord, order: int, block_rows: int, *, method: str = "N4SID") -> StateSpace:
    """Return the model of an order; both horizons are ``block_rows``."""
    from sippy_unipi import system_identification

    if order > block_rows or len(record.u) > MOST_SAMPLES or len(record.u) < 2 * sum(_channels(record)) * block_rows:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(record.u)} samples")
    horizons = {"SS_f": block_rows, "SS_p": block_rows}
    with contextlib.redirect_stdout(io.StringIO()):
        model = system_identification(
            record.y.T, record.u.T, method, SS_fixed_order=order, SS_D_required=True, tsample=record.dt_s, **horizons
        )
    return without_offsets(*(np.asarray(matrix) for matrix in (model.A, model.B, model.C, model.D)))


def _channels(record: InputOutputRecord) -> tuple[int, int]:
    return record.u.shape[1], record.y.shape[1]
