"""The printed Eq. (9c): the impulse response by inverting the matrix of inputs.

Kept so that anyone can see what it does. It asks for zero initial state and no noise; its matrix, triangular
Toeplitz in the inputs, has a condition of about 1e17 at 50 random samples of one input, and with two inputs has half
the rank it needs. OKID with an observer takes its place.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.errors import PoorExcitation, SettingsError
from treadline.identification.era import HankelSvd, hankel_svd
from treadline.identification.gram import Units
from treadline.identification.okid import ObserverMarkov
from treadline.models import InputOutputRecord

CONDITION_LIMIT = 1e8
"""Beyond it, data of single precision leave no digit of the answer."""


def input_matrix(u: Float[np.ndarray, "T m"]) -> Float[np.ndarray, "a T"]:
    """Return the matrix of Eq. (9c): row block i holds the inputs delayed by i samples.

    Paper: Eq. (9c).
    """
    samples, m = u.shape
    matrix = np.zeros((samples * m, samples))
    for delay in range(samples):
        matrix[delay * m : (delay + 1) * m, delay:] = u[: samples - delay].T
    return matrix


def deconvolve(u: Float[np.ndarray, "T m"], y: Float[np.ndarray, "T p"]) -> Float[np.ndarray, "T p m"]:
    """Return the Markov parameters ``Y_0 … Y_{T-1}`` that Eq. (9c) gives.

    Paper: Eq. (9c).

    Raises:
        PoorExcitation: If the matrix of inputs has no usable inverse, which is the rule.
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
    """Return Eq. (9c)'s impulse response as an observer without feedback, in units of deviations, and its Hankel matrix.

    Raises:
        SettingsError: If there is more than one experiment.
        PoorExcitation: If the matrix of inputs has no usable inverse.
    """
    if len(records) > 1:
        raise SettingsError("Eq. (9c) knows one experiment; give one record, or use method okid-era")
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
        units=Units(shift=np.zeros(m + p), scale=np.ones(m + p), input_count=m),
        feedthrough=True,
    )
    return observer, hankel_svd(markov, blocks, blocks, np.ones(m), np.ones(p))
