"""Stabilisation diagram: separates system poles from spurious poles.

B. Peeters and G. De Roeck, Stochastic System Identification for Operational Modal Analysis: A Review, Journal of Dynamic
Systems, Measurement, and Control 123(4), 659-667, 2001. A system pole recurs at every order above the true order; a
spurious pole varies with the order. The tolerances are customary in modal analysis: 1 % in frequency, 5 % in damping,
compared with the nearest pole of the next lower order.
"""

import numpy as np
from jaxtyping import Complex, Float

from treadline.core.transfer_function import StabilisationDiagram
from treadline.identification._era import HankelSvd
from treadline.identification._limits import LAGS_MOST, ROUNDING

FREQUENCY_TOLERANCE = 0.01
"""Largest relative change of a stable frequency."""
DAMPING_TOLERANCE = 0.05
"""Largest relative change of a stable damping."""


def stabilisation_of_svd(svd: HankelSvd, dt_s: float, most: int = LAGS_MOST, *, chosen: int = 0) -> StabilisationDiagram:
    """Return the stabilisation diagram of ERA's models of orders 1 … ``most`` from one decomposed Hankel matrix.

    In a balanced realisation the state matrix of a lower order is the leading block of a higher order's.

    Args:
        svd: Decomposed Hankel matrix.
        dt_s: Sampling period of the models [s].
        most: Highest order.
        chosen: Order of the model.
    """
    rank = min(most, int(np.sum(svd.s > ROUNDING * svd.s[0])))
    A = svd.system_matrix(rank)
    columns: list[Float[np.ndarray, "5 k"]] = [np.empty((5, 0))]
    below = np.empty((2, 0))
    for order in range(1, rank + 1):
        here = modes(np.linalg.eigvals(A[:order, :order]).astype(complex), dt_s)
        close = _change(here[0], below[0]) <= FREQUENCY_TOLERANCE
        damped = close & (_change(here[1], below[1]) <= DAMPING_TOLERANCE)
        columns.append(np.vstack([np.full(here.shape[1], order), here, close.any(axis=1), damped.any(axis=1)]))
        below = here
    order_, frequency_hz, damping, frequency_stable, damping_stable = np.hstack(columns)
    return StabilisationDiagram(
        order=order_.astype(int),
        frequency_hz=frequency_hz,
        damping=damping,
        frequency_stable=frequency_stable.astype(bool),
        damping_stable=damping_stable.astype(bool),
        nyquist_hz=0.5 / dt_s,
        chosen=chosen,
    )


def modes(poles: Complex[np.ndarray, " n"], dt_s: float) -> Float[np.ndarray, "2 k"]:
    """Return natural frequencies [Hz] and damping ratios of discrete poles, each complex pair once, without poles at zero."""
    upper = poles[(poles.imag >= -ROUNDING * np.abs(poles)) & (poles != 0.0)]
    rates = np.log(upper)
    size = np.abs(rates)
    # A perfect integrator, λ = 1, has frequency zero and no defined damping.
    damping = np.divide(-rates.real, size, out=np.zeros(size.shape), where=size > 0.0)
    return np.vstack([size / (2.0 * np.pi * dt_s), damping])


def _change(here: Float[np.ndarray, " k"], below: Float[np.ndarray, " j"]) -> Float[np.ndarray, "k j"]:
    """Return the relative distance of each value from each value of the next lower order."""
    return np.abs(here[:, None] - below) / np.maximum(np.abs(below), 1e-300)
