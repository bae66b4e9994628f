"""Which poles a system has, and which the noise adds: the stabilisation diagram.

B. Peeters and G. De Roeck, Stochastic System Identification for Operational Modal Analysis: A Review, Journal of Dynamic
Systems, Measurement, and Control 123(4), 659-667, 2001. A pole of the system comes back at every order above the true
one; a pole that noise or surplus states made wanders from order to order. Tolerances are those customary in modal
analysis: 1 % in frequency, 5 % in damping, against the nearest pole of the order below.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from treadline.identification.era import HankelSvd

FREQUENCY_TOLERANCE = 0.01
DAMPING_TOLERANCE = 0.05
ORDER_MOST = 40
"""Highest order of a diagram: beyond, its rows cannot be told apart."""
ROUNDING = 1e-12
"""Relative size at which a singular value is rounding, and an imaginary part too."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stabilisation:
    """The poles of every order in one list, a complex pair once."""

    order: Int[np.ndarray, " k"]
    frequency_hz: Float[np.ndarray, " k"]
    """Natural frequency ``|ln λ| / (2π T)``; of a real pole, its corner frequency."""
    damping: Float[np.ndarray, " k"]
    """``-Re ln λ / |ln λ|``: 1 for a decaying real pole, negative for one that grows."""
    frequency_stable: Bool[np.ndarray, " k"]
    """Whether the order below has a pole within 1 % in frequency."""
    damping_stable: Bool[np.ndarray, " k"]
    """Whether one of those is within 5 % in damping too."""


def stabilisation(
    state_matrix: Callable[[int], Float[np.ndarray, "n n"]],
    orders: Iterable[int],
    dt_s: float,
    *,
    frequency_tolerance: float = FREQUENCY_TOLERANCE,
    damping_tolerance: float = DAMPING_TOLERANCE,
) -> Stabilisation:
    """Return the stabilisation diagram of the models ``A = state_matrix(order)``.

    Args:
        orders: Rising; each is held against the one before it.
        dt_s: Sampling period of the models.
        frequency_tolerance: Largest change of a stable frequency, as a share of it.
        damping_tolerance: Largest change of a stable damping, as a share of it.
    """
    columns: list[Float[np.ndarray, "5 k"]] = [np.empty((5, 0))]
    below = np.empty((2, 0))
    for order in orders:
        here = modes(np.linalg.eigvals(state_matrix(order)).astype(complex), dt_s)
        close = _change(here[0], below[0]) <= frequency_tolerance
        damped = close & (_change(here[1], below[1]) <= damping_tolerance)
        columns.append(np.vstack([np.full(here.shape[1], order), here, close.any(axis=1), damped.any(axis=1)]))
        below = here
    order_, frequency_hz, damping, frequency_stable, damping_stable = np.hstack(columns)
    return Stabilisation(
        order=order_.astype(int),
        frequency_hz=frequency_hz,
        damping=damping,
        frequency_stable=frequency_stable.astype(bool),
        damping_stable=damping_stable.astype(bool),
    )


def modes(poles: Complex[np.ndarray, " n"], dt_s: float) -> Float[np.ndarray, "2 k"]:
    """Return natural frequencies [Hz] and dampings of discrete poles, a complex pair once; poles at zero have neither."""
    upper = poles[(poles.imag >= -ROUNDING * np.abs(poles)) & (poles != 0.0)]
    rates = np.log(upper)
    size = np.abs(rates)
    # A perfect integrator, λ = 1, has frequency zero and no damping of its own.
    damping = np.divide(-rates.real, size, out=np.zeros(size.shape), where=size > 0.0)
    return np.vstack([size / (2.0 * np.pi * dt_s), damping])


def _change(here: Float[np.ndarray, " k"], below: Float[np.ndarray, " j"]) -> Float[np.ndarray, "k j"]:
    """Return how far each value lies from each of the order below, as a share of the latter."""
    return np.abs(here[:, None] - below) / np.maximum(np.abs(below), 1e-300)


def stabilisation_of_svd(svd: HankelSvd, dt_s: float, most: int = ORDER_MOST) -> Stabilisation:
    """Return the stabilisation diagram of ERA's models of orders 1 … ``most``, all from one decomposed Hankel matrix.

    The realisation is balanced: the state matrix of a lower order is the leading block of a higher one's.
    """
    rank = min(most, int(np.sum(svd.s > ROUNDING * svd.s[0])))
    A = svd.system_matrix(rank)
    return stabilisation(lambda order: A[:order, :order], range(1, rank + 1), dt_s)
