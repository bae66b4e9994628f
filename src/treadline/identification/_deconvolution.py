"""Direct deconvolution, Eq. (9c) as printed: the impulse response by inversion of the input matrix.

Included for comparison. The method assumes zero initial state and no noise. Its matrix, triangular Toeplitz in the
inputs, has a condition number of about 1e17 at 50 random samples of one input; with two inputs it has half the rank
required. OKID with an observer replaces it.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.core.errors import PoorExcitation, SettingsError
from treadline.core.models import InputOutputRecord
from treadline.identification._era import HankelSvd
from treadline.identification._gram import Units
from treadline.identification._okid import ObserverMarkov

CONDITION_LIMIT = 1e8
"""Condition number above which single-precision data leave no correct digit in the solution."""


def input_matrix(u: Float[np.ndarray, "T m"]) -> Float[np.ndarray, "a T"]:
    """Return the input matrix of Eq. (9c): block row i holds the inputs delayed by i samples.

    Paper: Eq. (9c).
    """
    samples, m = u.shape
    matrix = np.zeros((samples * m, samples))
    for delay in range(samples):
        matrix[delay * m : (delay + 1) * m, delay:] = u[: samples - delay].T
    return matrix


def deconvolve(u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]) -> Float[np.ndarray, "T p m"]:
    """Return the Markov parameters ``Y_0 … Y_{T-1}`` by Eq. (9c).

    Paper: Eq. (9c).

    Raises:
        PoorExcitation: If the input matrix is ill-conditioned, as for most records.
    """
    samples, m = u.shape
    matrix = input_matrix(u)
    if m > 1:
        rank = int(np.linalg.matrix_rank(matrix))
        raise PoorExcitation(
            f"Eq. (9c) asks for {samples * m} Markov rows of a matrix of rank {rank}: {m} inputs need {m} independent "
            "experiments; use method okid-era"
        )
    condition = float(np.linalg.cond(matrix))
    if condition > CONDITION_LIMIT:
        raise PoorExcitation(
            f"the matrix of inputs in Eq. (9c) has condition {condition:.1e} at {samples} samples; use method okid-era"
        )
    flat = np.linalg.solve(matrix.T, y)
    return np.moveaxis(flat.reshape(samples, m, y.shape[1]), 1, 2)


def observer_of(records: Sequence[InputOutputRecord], units: Units) -> tuple[ObserverMarkov, HankelSvd]:
    """Return the impulse response of Eq. (9c) as an observer without feedback, in standard deviations, and its Hankel matrix.

    Raises:
        SettingsError: If there is more than one experiment.
        PoorExcitation: If the input matrix is ill-conditioned.
    """
    if len(records) > 1:
        raise SettingsError(f"Eq. (9c) takes one experiment, not {len(records)}; give one record, or use method okid-era")
    markov = deconvolve(records[0].u, records[0].y) * units.input_scale / units.output_scale[:, None]
    _, p, m = markov.shape
    blocks = (len(markov) - 1) // 2
    lags, q = 2 * blocks, 1 + m + 2 * blocks * (m + p)
    observer = ObserverMarkov(
        bias=np.zeros(p),
        D=markov[0],
        alpha=np.ascontiguousarray(markov[1 : 1 + lags]),
        beta=np.zeros((lags, p, p)),
        residual_covariance=np.zeros((p, p)),
        information=np.eye(q),
        count=float(len(markov)),
        feedthrough=True,
    )
    return observer, HankelSvd(markov=markov, rows=blocks, columns=blocks)
