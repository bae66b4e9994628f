"""Other people's identification behind one signature: ``fit(record, order, block_rows) -> StateSpace``.

``python_packages`` and ``slicot`` name their packages, say why one is missing, and offer its methods. Peers take records as they
are: whoever calls removes the means first where the data have any (``centred``).
"""

from collections.abc import Callable
from dataclasses import replace

from systems import StateSpace

from treadline.core.models import InputOutputRecord

Fit = Callable[[InputOutputRecord, int, int], StateSpace]


class PeerError(Exception):
    """A peer cannot do what is asked, or says that it failed."""


def installed() -> tuple[dict[str, Fit], list[str]]:
    """Return every method that can run here, and a line per package: what it is, or how to get it."""
    from peers.python_packages import PACKAGES
    from peers.slicot import SLICOT

    found: dict[str, Fit] = {}
    lines = []
    for package in (SLICOT, *PACKAGES):
        reason = package.missing()
        if reason is None:
            found |= package.methods
            lines.append(f"{package.name}: {package.version()}")
        else:
            lines.append(f"{package.name}: not here ({reason}); {package.install}")
    return found, lines


def centred(fit: Fit) -> Fit:
    """Return a fit to the record without its means; they become the model's offsets."""

    def fitted(record: InputOutputRecord, order: int, block_rows: int) -> StateSpace:
        u_mean, y_mean = record.u.mean(axis=0), record.y.mean(axis=0)
        model = fit(replace(record, u=record.u - u_mean, y=record.y - y_mean), order, block_rows)
        return replace(model, input_offset=u_mean, output_offset=y_mean)

    return fitted
