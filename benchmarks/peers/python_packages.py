"""Peers from the Python package index: modred, nfoursid, python-control and SIPPY (University of Pisa)."""

import contextlib
import importlib
import importlib.metadata
import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from systems import StateSpace, without_offsets

from peers import Fit, PeerError
from treadline.core.models import InputOutputRecord

HANKEL_MOST = 20_000
"""Longest record [samples] given to SIPPY and nfoursid: they hold block-Hankel matrices whole, SIPPY their pseudo-inverses too."""
SIMULATED = 10
"""Number of block rows at which a method without block rows takes part."""


def modred_fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order by OKID as in Juang's book (first rows padded with zeros: for records from rest), then ERA.

    It takes as many lags as Markov parameters, 3 more than two blocks.
    """
    import modred

    m, p = _channels(record)
    count = 2 * block_rows + 3
    _require((m + p) * (count + 1) <= len(record.u) and min(m, p) * block_rows >= order, record, order, block_rows)
    markov = modred.OKID(record.u.T, record.y.T, count)
    _, sampled = modred.era.make_sampled_format(np.arange(count - 1), markov[1:])
    A, B, C = modred.ERA(verbosity=0).compute_model(sampled, order)
    return without_offsets(*(np.asarray(matrix) for matrix in (A, B, C, markov[0])))


def nfoursid_fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order by PO-MOESP with a state sequence."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    m, p = _channels(record)
    _require(order <= p * block_rows and _fits_hankel(record, block_rows), record, order, block_rows)
    inputs, outs = [f"u{i}" for i in range(m)], [f"y{i}" for i in range(p)]
    table = pd.DataFrame(np.hstack([record.u, record.y]), columns=[*inputs, *outs])
    work = NFourSID(table, outs, inputs, num_block_rows=block_rows)
    work.subspace_identification()
    model, _ = work.system_identification(rank=order)
    return without_offsets(model.a, model.b, model.c, model.d)


def control_fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the eigensystem realisation of ``2 block_rows + 1`` Markov parameters, a finite impulse response by least squares."""
    import control

    m, p = _channels(record)
    count = 2 * block_rows + 1
    _require(count * m <= len(record.u) and min(m, p) * block_rows >= order, record, order, block_rows)
    # The first rows, whose past is unknown, are left out: their zeros would be wrong for a record that starts in motion.
    markov = control.markov(record.y.T, record.u.T, count, truncate=True).reshape(p, m, count)
    system, _ = control.eigensys_realization(markov, order, m=block_rows, n=block_rows)
    return without_offsets(*(np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D)))


def sippy_fit(record: InputOutputRecord, order: int, block_rows: int, *, method: str) -> StateSpace:
    """Return the model of an order; both horizons are ``block_rows``."""
    from sippy_unipi import system_identification

    _require(order <= block_rows and _fits_hankel(record, block_rows), record, order, block_rows)
    horizons = {"SS_f": block_rows, "SS_p": block_rows}
    with contextlib.redirect_stdout(io.StringIO()):
        model = system_identification(
            record.y.T, record.u.T, method, SS_fixed_order=order, SS_D_required=True, tsample=record.dt_s, **horizons
        )
    return without_offsets(*(np.asarray(matrix) for matrix in (model.A, model.B, model.C, model.D)))


def jax_fit(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
    """Return the model of an order by gradient descent on the simulation error, from a random start; no block rows, so one try."""
    import jax
    from jax_sysid.models import LinearModel

    if block_rows != SIMULATED:
        raise PeerError("fits no block rows")
    jax.config.update("jax_enable_x64", True)
    u_scale, y_scale = record.u.std(axis=0), record.y.std(axis=0)
    m, p = _channels(record)
    model = LinearModel(order, p, m, feedthrough=True)
    model.optimization(adam_epochs=0, lbfgs_epochs=1000, iprint=-1)
    with contextlib.redirect_stdout(io.StringIO()):
        model.fit(record.y / y_scale, record.u / u_scale)
    A, B, C, D = (np.asarray(matrix) for matrix in model.ssdata())
    return without_offsets(A, B / u_scale, y_scale[:, None] * C, y_scale[:, None] * D / u_scale)


def _channels(record: InputOutputRecord) -> tuple[int, int]:
    return record.u.shape[1], record.y.shape[1]


def _fits_hankel(record: InputOutputRecord, block_rows: int) -> bool:
    return 2 * sum(_channels(record)) * block_rows <= len(record.u) <= HANKEL_MOST


def _require(suits: bool, record: InputOutputRecord, order: int, block_rows: int) -> None:
    if not suits:
        raise PeerError(f"{block_rows} block rows do not suit order {order} and {len(record.u)} samples")


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonPackage:
    """A package of the index: the module that it offers, how to get it, and its methods by name."""

    name: str
    module: str
    distribution: str
    install: str
    methods: Mapping[str, Fit]

    def missing(self) -> str | None:
        """Return why the package cannot be used."""
        try:
            importlib.import_module(self.module)
        except Exception as error:  # noqa: BLE001 (an old package may fail in any way with a new numpy)
            return f"{type(error).__name__}: {error}"
        return None

    def version(self) -> str:
        """Return what is installed."""
        return f"{self.distribution} {importlib.metadata.version(self.distribution)}"


SIPPY_METHODS = ("N4SID", "MOESP", "CVA")
"""PARSIM-K is slow. PARSIM-S and PARSIM-P of sippy_unipi 1.0.1 add the response to the measured outputs to every column of the
regression for B, D and x0 instead of taking it off once, which costs 3 to 7 % even without noise."""
PACKAGES = (
    PythonPackage(
        name="python-control",
        module="control",
        distribution="control",
        install="pip install control",
        methods={"python-control": control_fit},
    ),
    PythonPackage(
        name="modred",
        module="modred",
        distribution="modred",
        install='pip install "setuptools<81" wheel future && pip install --no-build-isolation modred',
        methods={"modred OKID/ERA": modred_fit},
    ),
    PythonPackage(
        name="SIPPY",
        module="sippy_unipi",
        distribution="sippy_unipi",
        install="pip install sippy_unipi",
        methods={f"SIPPY {name}": partial(sippy_fit, method=name) for name in SIPPY_METHODS},
    ),
    PythonPackage(
        name="nfoursid",
        module="nfoursid.nfoursid",
        distribution="nfoursid",
        install="pip install nfoursid",
        methods={"nfoursid": nfoursid_fit},
    ),
    PythonPackage(
        name="jax-sysid",
        module="jax_sysid.models",
        distribution="jax-sysid",
        install="pip install jax-sysid",
        methods={"jax-sysid": jax_fit},
    ),
)
